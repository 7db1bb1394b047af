"""Whether the robot's lag behind its simulation changes within a log.

    windows = lags(logs, specs)             # of each log, one Lag for each 3 s with motion
    findings = check_lag(logs, specs)       # logs in which it jumps

A lag that is there all the time is physics (a delay, friction, a filter), and left to the
diagnosis. One that jumps means that something was changed, or failed, during the recording.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.recording import episode_rows
from sim2real.diagnosis.data.trial import Piece, piece, trial
from sim2real.diagnosis.data.windows import hunting_rows
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Settings

MILLI = 1e-3


class Lag(NamedTuple):
    """How far the measured motion trails the simulated one in a window."""

    joint: str
    time: float  # s, the window's middle
    lag: float  # s, positive where the robot is late


def check_lag(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> list[Finding]:
    """Return a finding for each log in which the lag jumps.

    Args:
        logs: the logs.
        specs: the model of each.
        settings: what counts as a jump.
    """
    found = []
    for log, windows in zip(logs, lags(logs, specs, settings), strict=True):
        jump = _jump(windows, settings)
        if jump is not None:
            time, before, after = jump
            name = log.path.name if log.path else "the log"
            found.append(
                Finding(
                    "lag",
                    None,
                    f"In {name} the robot trails its simulation by {before / MILLI:.0f} ms until "
                    f"{time:.1f} s and by {after / MILLI:.0f} ms from then on.",
                    "Something was changed then, or failed (a gain, heat, the adapter's latency, "
                    "another program on the bus): cut the log there, and diagnose both parts.",
                )
            )
    return found


def lags(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> list[list[Lag]]:
    """Return the lags of each log: of each joint in each window of an episode's first minute."""
    found: list[list[Lag]] = [[] for _ in logs]
    for spec in {id(spec): spec for spec in specs}.values():
        model = spec.copy().compile()
        pieces = [
            one
            for number, (log, own) in enumerate(zip(logs, specs, strict=True))
            if own is spec
            for one in _starts(log, number, settings)
        ]
        paths = trial(spec, [one.recording(model) for one in pieces]) if pieces else []
        for one, path in zip(pieces, paths, strict=True):
            for i in range(model.njnt):
                name = model.joint(i).name
                if f"qpos.{name}" in one.log.columns and np.isfinite(path).all():
                    simulated = path[:, model.jnt_qposadr[i]]
                    found[one.number] += _windows(name, one.log, simulated, settings)
    return found


def _starts(log: Log, number: int, settings: Settings) -> list[Piece]:
    """The first minute of each episode that is long enough."""
    found, limits = [], settings.preflight
    for own in episode_rows(log):
        time = log.time[own] - log.time[own.start]
        rows = int(np.searchsorted(time, limits.lag_episode_s - ROUNDING))
        if time[rows - 1] > 2 * limits.lag_windows * settings.windows.longest_s:
            found.append(piece(log, number, own.start, own.start + rows))
    return found


def _windows(joint: str, log: Log, simulated: np.ndarray, settings: Settings) -> list[Lag]:
    """The lags of one joint, where it moves and both motions are alike."""
    dt, limits = float(np.median(np.diff(log.time))), settings.preflight
    clock = np.arange(log.time[0], log.time[-1], dt)
    real, model = (
        np.gradient(np.interp(clock, log.time, q), dt)
        for q in (log.column(f"qpos.{joint}"), simulated)
    )
    hunts = np.interp(clock, log.time, hunting_rows(log).astype(float)) > 0
    seconds, reach = settings.windows.longest_s, round(limits.reach_s / dt)
    width = max(round(seconds / dt), 1)
    found = []
    for first in range(reach, len(clock) - width - reach, width):
        here = real[first : first + width]
        if (
            np.sqrt(np.mean(here**2)) < settings.regimes.rest_speed
            or hunts[first : first + width].any()
        ):
            continue
        others = sliding_window_view(model[first - reach : first + width + reach], width)[::-1]
        size = np.sqrt((here @ here) * np.square(others).sum(axis=1))
        scores = others @ here / np.maximum(size, TINY_SQUARE)
        best = int(np.argmax(scores))
        if scores[best] > limits.lag_alike and 0 < best < 2 * reach:
            shift = best - reach + _vertex(*scores[best - 1 : best + 2])
            middle = clock[first] + seconds / 2
            found.append(Lag(joint, float(middle), float(shift * dt)))
    return found


def _vertex(left: float, middle: float, right: float) -> float:
    """Where the parabola through three neighbours has its top, from the middle one."""
    bend = left - 2 * middle + right
    return 0.0 if bend >= 0 else (left - right) / (2 * bend)


def _jump(windows: Sequence[Lag], settings: Settings) -> tuple[float, float, float] | None:
    """Return when the lag jumps, and its medians before and after; None where it does not.

    Every joint that moves enough on both sides has to jump the same way, and no window of it may
    contradict that: a lag that only depends on the motion overlaps.
    """
    times = sorted({w.time for w in windows})
    best, answer = settings.preflight.lag_jump_s, None
    for cut in ((a + b) / 2 for a, b in pairwise(times)):
        jumps, sides = [], ([], [])
        for joint in dict.fromkeys(w.joint for w in windows):
            own = [w for w in windows if w.joint == joint]
            before = np.array([w.lag for w in own if w.time < cut])
            after = np.array([w.lag for w in own if w.time > cut])
            if min(len(before), len(after)) < settings.preflight.lag_windows:
                continue
            up, down = after.min() - before.max(), before.min() - after.max()
            jumps.append(up if up > 0 else -down if down > 0 else 0.0)
            sides[0].append(np.median(before))
            sides[1].append(np.median(after))
        if jumps and abs(sum(np.sign(jumps))) == len(jumps) and np.min(np.abs(jumps)) > best:
            best = float(np.min(np.abs(jumps)))
            answer = (cut, float(np.median(sides[0])), float(np.median(sides[1])))
    return answer
