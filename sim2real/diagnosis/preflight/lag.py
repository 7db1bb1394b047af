"""Whether the robot's lag behind its simulation changes within a log.

    findings = check_lag(pairs, specs)      # logs in which it jumps

A lag that is there all the time is physics (a delay, friction, a filter), and left to the
diagnosis. One that jumps means that something was changed, or failed, during the recording.
"""

from collections.abc import Iterator, Sequence
from itertools import count
from math import comb

import mujoco
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hardware.log import Log
from sim2real.diagnosis.data.pairs import Pairs, joints_of, name_of
from sim2real.diagnosis.data.recording import HUNTING, is_flagged, to_recording
from sim2real.diagnosis.data.trial import trial
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Settings

MILLI = 1e-3
Lags = dict[str, list[tuple[float, float]]]  # by joint: time in the episode and lag of windows [s]


def check_lag(
    pairs: Pairs, specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> Iterator[Finding]:
    """Yield a finding for each log in which the lag jumps."""
    for (log, model), spec in zip(pairs, specs, strict=True):
        jump = _jump(_lags(log, model, spec, settings), settings)
        if jump is not None:
            time, before, after = jump
            yield Finding(
                "lag",
                None,
                f"In {name_of(log)} the robot trails its simulation by {before / MILLI:.0f} ms "
                f"until {time:.1f} s and by {after / MILLI:.0f} ms from then on.",
                "Something was changed then, or failed (a gain, heat, the adapter's latency, "
                "another program on the bus): cut the log there, and diagnose both parts.",
            )


def _lags(log: Log, model: mujoco.MjModel, spec: mujoco.MjSpec, settings: Settings) -> Lags:
    """Return a log's lags: of each joint in each window of episodes in which a jump can show."""
    least = 2 * _fewest(settings) * settings.windows.longest_s
    parts, found = [part for part in log.episodes() if np.ptp(part.time) > least], Lags()
    paths = trial(spec, [to_recording(part, model) for part in parts])
    for part, path in zip(parts, paths, strict=True):
        for name in joints_of([(log, model)]):
            simulated = path[:, int(model.joint(name).qposadr[0])]
            found.setdefault(name, []).extend(_windows(name, part, simulated, settings))
    return found


def _fewest(settings: Settings) -> int:
    """Return how many windows a side, if all lags after are longer, are chance at `level` only."""
    return next(n for n in count(1) if 1 / comb(2 * n, n) <= settings.inference.level)


def _windows(
    joint: str, log: Log, simulated: np.ndarray, settings: Settings
) -> Iterator[tuple[float, float]]:
    """Yield the middle and the lag of windows in which a joint moves, and both motions are alike.

    The lag is the shift of the largest correlation of the two speeds, positive where the robot is
    late.
    """
    dt, limits = float(np.median(np.diff(log.time))), settings.preflight
    clock = np.arange(log.time[0], log.time[-1], dt)
    real, model = (
        np.gradient(np.interp(clock, log.time, q), dt)
        for q in (log.column(f"qpos.{joint}"), simulated)
    )
    hunts = np.interp(clock, log.time, is_flagged(log, HUNTING).astype(float)) > 0
    seconds, reach = settings.windows.longest_s, round(limits.reach_s / dt)
    width = max(round(seconds / dt), 1)
    for first in range(reach, len(clock) - width - reach, width):
        own = slice(first, first + width)
        here = real[own]
        if np.sqrt(np.mean(here**2)) < settings.regimes.rest_speed or hunts[own].any():
            continue
        others = sliding_window_view(model[first - reach : first + width + reach], width)[::-1]
        size = np.sqrt((here @ here) * np.square(others).sum(axis=1))
        scores = others @ here / np.maximum(size, TINY_SQUARE)
        best = int(np.argmax(scores))
        if scores[best] > limits.share and 0 < best < 2 * reach:
            shift = best - reach + _vertex(*scores[best - 1 : best + 2])
            yield first * dt + seconds / 2, float(shift * dt)


def _vertex(left: float, middle: float, right: float) -> float:
    """Where the parabola through three neighbours has its top, from the middle one."""
    bend = left - 2 * middle + right
    return 0.0 if bend >= 0 else (left - right) / (2 * bend)


def _jump(lags: Lags, settings: Settings) -> tuple[float, float, float] | None:
    """Return when the lag jumps, and its medians before and after; None where it does not.

    Every joint that moves enough on both sides has to jump the same way, and no window of it may
    contradict that: a lag that only depends on the motion overlaps.
    """
    joints = [np.array(windows).T for windows in lags.values() if windows]  # (2, n) each
    times = np.unique(np.concatenate([time for time, _ in joints])) if joints else np.zeros(0)
    best, answer = settings.preflight.sigmas * settings.preflight.offset_s, None
    for cut in (times[:-1] + times[1:]) / 2:
        sides = [(lag[time < cut], lag[time > cut]) for time, lag in joints]
        sides = [pair for pair in sides if min(map(len, pair)) >= _fewest(settings)]
        if not sides:
            continue
        up = min(after.min() - before.max() for before, after in sides)
        down = min(before.min() - after.max() for before, after in sides)
        if max(up, down) > best:
            late = np.median([[np.median(lag) for lag in pair] for pair in sides], axis=0)
            best, answer = max(up, down), (float(cut), float(late[0]), float(late[1]))
    return answer
