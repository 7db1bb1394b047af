"""Whether the robot's lag behind its simulation changes within a log.

    windows = lags(logs, specs)             # of each log, one Lag for each 3 s with motion
    findings = check_lag(logs, specs)       # logs in which it jumps

A lag that is there all the time is physics (a delay, friction, a filter), and left to the
diagnosis. One that jumps means that something was changed, or failed, during the recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.trial import Piece, piece, trial
from sim2real.diagnosis.schema import Finding

WINDOW = 3.0  # s
REACH = 0.25  # s: lags up to this are looked for
ALIKE = 0.7  # correlation below which a lag means nothing
STIR = 0.1  # rad/s or m/s: root mean square speed below which nothing moves enough
FEWEST = 3  # windows on either side of a jump
JUMP = 0.008  # s between the nearest windows of both sides
LIMIT = 60.0  # s of each episode that are looked at


class Lag(NamedTuple):
    """How far the measured motion trails the simulated one in a window."""

    joint: str
    time: float  # s, the window's middle
    lag: float  # s, positive where the robot is late


def check_lag(logs: Sequence[Log], specs: Sequence[mujoco.MjSpec]) -> list[Finding]:
    """Return a finding for each log in which the lag jumps.

    Args:
        logs: the logs.
        specs: the model of each.
    """
    found = []
    for log, windows in zip(logs, lags(logs, specs), strict=True):
        jump = _jump(windows)
        if jump is not None:
            time, before, after = jump
            name = log.path.name if log.path else "the log"
            found.append(
                Finding(
                    "lag",
                    None,
                    f"In {name} the robot trails its simulation by {1e3 * before:.0f} ms until "
                    f"{time:.1f} s and by {1e3 * after:.0f} ms from then on.",
                    "Something was changed then, or failed (a gain, heat, the adapter's latency, "
                    "another program on the bus): cut the log there, and diagnose both parts.",
                )
            )
    return found


def lags(logs: Sequence[Log], specs: Sequence[mujoco.MjSpec]) -> list[list[Lag]]:
    """Return the lags of each log: of each joint in each window of an episode's first minute."""
    found: list[list[Lag]] = [[] for _ in logs]
    for spec in {id(spec): spec for spec in specs}.values():
        model = spec.copy().compile()
        pieces = [
            one
            for number, (log, own) in enumerate(zip(logs, specs, strict=True))
            if own is spec
            for one in _starts(log, number)
        ]
        paths = trial(spec, [one.recording(model) for one in pieces]) if pieces else []
        for one, path in zip(pieces, paths, strict=True):
            for i in range(model.njnt):
                name = model.joint(i).name
                if f"qpos.{name}" in one.log.columns and np.isfinite(path).all():
                    found[one.number] += _windows(name, one.log, path[:, model.jnt_qposadr[i]])
    return found


def _starts(log: Log, number: int) -> list[Piece]:
    """The first minute of each episode that is long enough."""
    start, found = 0, []
    for part in log.episodes():
        rows = int(np.searchsorted(part.time, LIMIT))
        if part.time[rows - 1] > 2 * FEWEST * WINDOW:
            found.append(piece(log, number, start, start + rows))
        start += len(part)
    return found


def _windows(joint: str, log: Log, simulated: np.ndarray) -> list[Lag]:
    """The lags of one joint, where it moves and both motions are alike."""
    dt = float(np.median(np.diff(log.time)))
    clock = np.arange(0, log.time[-1], dt)
    real, model = (
        np.gradient(np.interp(clock, log.time, q), dt)
        for q in (log.column(f"qpos.{joint}"), simulated)
    )
    width, reach, found = max(round(WINDOW / dt), 1), round(REACH / dt), []
    for first in range(reach, len(clock) - width - reach, width):
        here = real[first : first + width]
        if np.sqrt(np.mean(here**2)) < STIR:
            continue
        scores = [
            _alike(here, model[first - shift : first - shift + width])
            for shift in range(-reach, reach + 1)
        ]
        best = int(np.argmax(scores))
        if scores[best] > ALIKE and 0 < best < 2 * reach:
            shift = best - reach + _vertex(*scores[best - 1 : best + 2])
            found.append(Lag(joint, float(clock[first] + WINDOW / 2), float(shift * dt)))
    return found


def _alike(one: np.ndarray, other: np.ndarray) -> float:
    return float(one @ other / max(np.sqrt((one @ one) * (other @ other)), 1e-12))


def _vertex(left: float, middle: float, right: float) -> float:
    """Where the parabola through three neighbours has its top, from the middle one."""
    bend = left - 2 * middle + right
    return 0.0 if bend >= 0 else 0.5 * (left - right) / bend


def _jump(windows: Sequence[Lag]) -> tuple[float, float, float] | None:
    """Return when the lag jumps, and its medians before and after; None where it does not.

    Every joint that moves enough on both sides has to jump the same way, and no window of it may
    contradict that: a lag that only depends on the motion overlaps.
    """
    times = sorted({w.time for w in windows})
    best, answer = JUMP, None
    for cut in ((a + b) / 2 for a, b in pairwise(times)):
        jumps, sides = [], ([], [])
        for joint in dict.fromkeys(w.joint for w in windows):
            own = [w for w in windows if w.joint == joint]
            before = np.array([w.lag for w in own if w.time < cut])
            after = np.array([w.lag for w in own if w.time > cut])
            if min(len(before), len(after)) < FEWEST:
                continue
            up, down = after.min() - before.max(), before.min() - after.max()
            jumps.append(up if up > 0 else -down if down > 0 else 0.0)
            sides[0].append(np.median(before))
            sides[1].append(np.median(after))
        if jumps and abs(sum(np.sign(jumps))) == len(jumps) and np.min(np.abs(jumps)) > best:
            best = float(np.min(np.abs(jumps)))
            answer = (cut, float(np.median(sides[0])), float(np.median(sides[1])))
    return answer
