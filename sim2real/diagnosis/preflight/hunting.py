"""Moments at which a servo's loop hunts: its joint swings to and fro while no command does.

    logs, found = mark_hunting(logs, driven)    # rows get `flag.hunting`; a finding for each joint
    tell_simulated(found, driven, [("As given", measure_all(logs, specs))])  # does the model hunt?

A loop that has become unstable swings until something bounds it: play, dry friction, the motor's
limit. How it begins says what made it unstable, and a simulation can follow that. Later the phase
hangs on every small error, and the right cause is as far off as a wrong one: windows end where it
goes on, and begin where the loop is at rest again (`data/windows.py`). Whether a model hunts in its
own time, how fast and how far, is reported in addition.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import uniform_filter1d
from scipy.signal import find_peaks

from hardware.log import Log
from sim2real.diagnosis.data.noise_floor import count_of
from sim2real.diagnosis.data.pairs import name_of
from sim2real.diagnosis.data.recording import HUNTING, episode_rows, flagged, powered
from sim2real.diagnosis.data.replay import Gap
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings


class Hunt(NamedTuple):
    """One stretch of hunting in an episode."""

    first: float  # s: its first turn
    last: float  # s: its last turn
    frequency: float  # Hz
    swing: float  # rad or m from side to side, the median

    @property
    def seconds(self) -> float:
        """Its duration [s]."""
        return self.last - self.first


def mark_hunting(
    logs: Sequence[Log], driven: Mapping[str, str], settings: Settings = DEFAULT
) -> tuple[list[Log], list[Finding]]:
    """Return the logs with hunting rows flagged, and what was found. Others come back as they are.

    `driven` is the joint that each actuator drives by desired positions.
    """
    flags = [np.zeros(len(log), bool) for log in logs]
    findings = []
    for actuator, joint in driven.items():
        found: list[tuple[Log, Hunt]] = []
        for log, flag in zip(logs, flags, strict=True):
            if f"qpos.{joint}" in log.columns:
                angle = log.column(f"qpos.{joint}")
                for rows, hunts in _each(log, angle, actuator, joint, settings):
                    flag[rows] |= _left_out(log.time[rows], hunts, settings)
                    found += [(log, hunt) for hunt in hunts]
        if found:
            findings.append(_finding(joint, found))
    return [flagged(log, HUNTING, own) for log, own in zip(logs, flags, strict=True)], findings


def tell_simulated(
    findings: Sequence[Finding],
    driven: Mapping[str, str],
    models: Sequence[tuple[str, Sequence[Gap]]],
    settings: Settings = DEFAULT,
) -> tuple[list[Finding], bool]:
    """Return findings that also say whether models hunt where the robot does.

    Findings and `driven` are as in `mark_hunting`, models what each is called and its replays.

    Returns:
        The findings, and whether the robot hunts and the last model at none of its joints: what
        makes a robot hunt is missing in such a model, however near its first swings are.
    """
    completed, last = [], []
    for finding in findings:
        if finding.check == "hunting" and models:
            joint = str(finding.where)
            seen = [(name, _simulated(joint, driven, gaps, settings)) for name, gaps in models]
            words = [f"{name}, the simulator {_words(hunts)}" for name, hunts in seen]
            finding = replace(finding, finding=f"{finding.finding} {'; '.join(words)}.")
            last.append(seen[-1][1])
        completed.append(finding)
    return completed, bool(last) and not any(last)


def _simulated(
    joint: str, driven: Mapping[str, str], gaps: Sequence[Gap], settings: Settings
) -> list[tuple[Log, Hunt]]:
    """Return where a simulated joint hunts."""
    found: list[tuple[Log, Hunt]] = []
    for actuator in [name for name, own in driven.items() if own == joint]:
        for gap in [gap for gap in gaps if joint in gap.joints]:
            angle = gap.simulated[:, gap.joints.index(joint)]
            every = _each(gap.log, angle, actuator, joint, settings)
            found += [(gap.log, hunt) for _, hunts in every for hunt in hunts]
    return found


def _each(
    log: Log, angle: np.ndarray, actuator: str, joint: str, settings: Settings
) -> Iterator[tuple[slice, list[Hunt]]]:
    """Yield the rows of each episode, and where an angle hunts in them, its servo on."""
    if actuator not in log.actuators:
        return
    least, on = settings.preflight.counts * count_of([log], joint), powered(log, actuator)
    command = log.column(f"ctrl.{actuator}")
    others = [log.column(f"ctrl.{name}") for name in log.actuators if name != actuator]
    for rows in episode_rows(log):
        rest = [other[rows] for other in others]
        time, free = log.time[rows], log.time[rows][~on[rows]]
        hunts = hunting(time, angle[rows], command[rows], rest, least, settings)
        yield rows, [h for h in hunts if not ((free >= h.first) & (free <= h.last)).any()]


def hunting(
    time: np.ndarray,
    angle: np.ndarray,
    command: np.ndarray,
    others: Sequence[np.ndarray] = (),
    least: float = 0.0,
    settings: Settings = DEFAULT,
) -> list[Hunt]:
    """Return the stretches in which an angle swings steadily, and no command does.

    Args:
        time: of one episode's rows [s], (T,), increasing.
        angle: of the joint [rad or m], (T,).
        command: what it should be, (T,).
        others: commands of the other joints, whose motion may shake this one, (T,) each.
        least: swings are at least this large [rad or m], and `swing`.
        settings: what counts as hunting.
    """
    least, row = max(least, settings.hunting.swing), float(np.median(np.diff(time)))
    shaken = [_turns(other, settings.windows.turn * float(np.ptp(other))) for other in others]
    found = _steady(time, angle, command, shaken, least, settings)
    large = max(least, settings.windows.turn * float(np.ptp(angle)))  # smaller: perhaps stick-slip
    rows = max(round(settings.windows.kick_s / row), 1)
    fast, asked = (v - uniform_filter1d(v, rows, mode="nearest") for v in (angle, command))
    return _merged([*found, *_steady(time, fast, asked, shaken, large, settings)])


def _steady(
    time: np.ndarray,
    angle: np.ndarray,
    command: np.ndarray,
    shaken: Sequence[np.ndarray],
    least: float,
    settings: Settings,
) -> list[Hunt]:
    """Return where an angle swings evenly, its command does not, and others turn less often."""
    turns, count = _turns(angle, least), settings.hunting.swings
    if len(turns) <= count:
        return []
    swings = np.abs(np.diff(angle[turns]))
    runs = [sliding_window_view(v, count) for v in (swings, np.diff(time[turns]))]
    even = [run.min(axis=1) >= settings.hunting.even * run.max(axis=1) for run in runs]
    steady = np.zeros(len(swings), bool)
    for k in np.flatnonzero(even[0] & even[1]):
        first, last = turns[k], turns[k + count]
        size = settings.windows.turn * float(np.median(runs[0][k]))
        asked = len(_turns(command[first : last + 1], size))
        busiest = max((int(np.sum((t >= first) & (t < last))) for t in shaken), default=0)
        steady[k : k + count] |= 4 * asked <= count and 2 * busiest <= count
    found = []
    for a, b in np.flatnonzero(np.diff(steady, prepend=False, append=False)).reshape(-1, 2):
        first, last = float(time[turns[a]]), float(time[turns[b]])
        swing = float(np.median(swings[a:b]))
        found.append(Hunt(first, last, float((b - a) / 2 / (last - first)), swing))
    return found


def _merged(hunts: Sequence[Hunt]) -> list[Hunt]:
    """Return stretches that do not overlap, in order; of those that do, the longest tells."""
    found: list[Hunt] = []
    for hunt in sorted(hunts):
        if found and hunt.first <= found[-1].last:
            longest = max(found[-1], hunt, key=lambda one: one.seconds)
            ends = (found[-1].first, max(found[-1].last, hunt.last))
            found[-1] = longest._replace(first=ends[0], last=ends[1])
        else:
            found.append(hunt)
    return found


def _turns(values: np.ndarray, size: float) -> np.ndarray:
    """Return the rows at which a signal turns back by more than a size, in order."""
    if np.ptp(values) <= size:
        return np.zeros(0, int)
    tops, bottoms = (find_peaks(sign * values, prominence=size)[0] for sign in (1, -1))
    rows = np.concatenate([tops, bottoms])
    top = np.repeat([True, False], [len(tops), len(bottoms)])
    order = np.argsort(rows)
    rows, top = rows[order], top[order]
    return rows[np.diff(top, prepend=~top[:1])]  # of tops that are level, the first


def _left_out(time: np.ndarray, hunts: Sequence[Hunt], settings: Settings) -> np.ndarray:
    """Return which rows no replay is held to, (T,) bool.

    A stretch that begins where the joint was at rest keeps its first swings; one that goes on after
    a step of the command keeps none.
    """
    out, ended = np.zeros(len(time), bool), -np.inf
    for hunt in hunts:
        fresh = hunt.first - ended > settings.windows.kick_s
        kept = 1 / (2 * hunt.frequency) if fresh else -settings.windows.kick_s
        ended = hunt.last + settings.windows.kick_s
        out |= (time >= hunt.first + kept) & (time <= ended)
    return out


def _words(found: Sequence[tuple[Log, Hunt]]) -> str:
    """Return how long, how far and how fast a joint hunts."""
    if not found:
        return "does not hunt"
    longest = max((hunt for _, hunt in found), key=lambda hunt: hunt.seconds)
    total = sum(hunt.seconds for _, hunt in found)
    swing, hertz = f"{longest.swing:.2g}", f"{longest.frequency:.2g}"
    return f"hunts for {total:.1f} s, {swing} from side to side at {hertz} Hz"


def _finding(joint: str, found: Sequence[tuple[Log, Hunt]]) -> Finding:
    log, hunt = max(found, key=lambda one: one[1].seconds)
    return Finding(
        "hunting",
        joint,
        f"{joint} swings to and fro while its command does not: it {_words(found)}, longest at "
        f"{hunt.first:.1f} s of {name_of(log)}.",
        "The servo's loop is unstable. Its first swing is compared, the others are left out: no "
        "simulation keeps their phase. A lower gain, more damping or slower commands can stop it; "
        "what lies behind it is elasticity, play or delay in the loop, or integral action: look "
        "for them among the causes.",
    )
