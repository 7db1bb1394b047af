"""Clocks: times that were never measured, channels that are late, and clocks that drift apart.

    findings = check_clocks(logs)

A speed that was stamped late no longer fits the change of its position: what the integrated speed
lacks of the position is then the delay times the speed, which a regression reads off to well below
a row's length. A drift shows in the stamps: a clock that runs fast by 200 ppm is 12 ms ahead after
a minute. What is late against the *commands* is a delay, which the diagnosis itself looks for.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from hardware.log import Log
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Clocks

MILLI, PPM = 1e-3, 1e-6
SMALLEST = 1e-12  # s: between readings that carry the same stamp


class Shift(NamedTuple):
    """How late a speed is against its position."""

    seconds: float
    error: float  # standard error, s
    residual: float  # rad or m, RMS


def check_clocks(logs: Sequence[Log], settings: Clocks = DEFAULT.clocks) -> list[Finding]:
    """Return what the clocks of logs contradict.

    Args:
        logs: the logs.
        settings: when a clock is worth a finding.
    """
    found = [*_nominal(logs)]
    for joint in dict.fromkeys(joint for log in logs for joint in log.joints):
        found += [*_late(logs, joint, settings), *_drifting(logs, joint, settings)]
    return found


def _nominal(logs: Sequence[Log]) -> Iterator[Finding]:
    if any(log.meta.get("clock") == "nominal" for log in logs):
        yield Finding(
            "clock",
            None,
            "The times are the frame's number over the frame rate: they were computed, not "
            "measured.",
            "Log the clock at which each row was read; until then a delay below one frame, and "
            "its changes, cannot be distinguished from the recorder's.",
        )


def _late(logs: Sequence[Log], joint: str, limits: Clocks) -> Iterator[Finding]:
    parts = [p for log in logs if f"qvel.{joint}" in log.columns for p in log.episodes()]
    shift = speed_shift(parts, joint, limits)
    if shift is None:
        return
    sure = abs(shift.seconds) > max(limits.offset_s, limits.sigmas * shift.error)
    if sure and shift.residual < limits.better * filtered_residual(parts, joint, limits):
        side = "later" if shift.seconds > 0 else "earlier"
        yield Finding(
            "clock",
            joint,
            f"The speed of {joint} is {abs(shift.seconds) / MILLI:.1f} ms "
            f"(± {2 * shift.error / MILLI:.1f}) {side} than its position.",
            "Stamp both channels on one clock, or give the speed its own stamps; until then the "
            "speed is no evidence.",
        )


def _drifting(logs: Sequence[Log], joint: str, limits: Clocks) -> Iterator[Finding]:
    for log in logs:
        drift = stamp_drift(log, joint)
        length = max(float(np.ptp(part.time)) for part in log.episodes())
        if drift is None or length < limits.log_s:
            continue
        ppm, error = drift
        ahead = PPM * abs(ppm) * length
        if abs(ppm) > max(limits.drift_ppm, limits.sigmas * error):
            side = "fast" if ppm > 0 else "slow"
            yield Finding(
                "drift",
                joint,
                f"The clock that stamps {joint} runs {abs(ppm):.0f} ppm (± {2 * error:.0f}) {side} "
                f"against the commands': {ahead / MILLI:.1f} ms over the log.",
                f"Divide its stamps by {1 + PPM * ppm:.6f}, or log both on one clock.",
            )
            return


def stamp_drift(log: Log, joint: str) -> tuple[float, float] | None:
    """Return how much faster a joint's clock runs than the commands' [ppm], and its standard error.

    The slope of `stamp.<joint>` - `time` over `time`, episodes each from their own start; None
    without stamps of its own.
    """
    if f"stamp.{joint}" not in log.columns:
        return None
    x, y = [], []
    for part in log.episodes():
        late = part.column(f"stamp.{joint}") - part.time
        x.append(part.time - part.time.mean())
        y.append(late - late.mean())
    time, late = np.concatenate(x), np.concatenate(y)
    slope = float(time @ late / (time @ time))
    scatter = late - slope * time
    error = float(np.sqrt(scatter @ scatter / max(len(time) - 2, 1) / (time @ time)))
    return slope / PPM, error / PPM


def speed_shift(
    parts: Sequence[Log], joint: str, settings: Clocks = DEFAULT.clocks
) -> Shift | None:
    """Return how late a joint's speed is against its position, by Gauss-Newton on the delay.

    Args:
        parts: episodes that have `qvel.<joint>`.
        joint: which.
        settings: the largest delay that is looked for, and the steps towards it.

    Returns:
        None where the speed says nothing: too few rows, or a joint that hardly moved.
    """
    least, reach = settings.rows_min, settings.reach_s
    moves = [np.ptp(part.column(f"qpos.{joint}")) > 0 for part in parts]
    parts = [p for p, moved in zip(parts, moves, strict=True) if len(p) > least and moved]
    delay, made = 0.0, None
    for _ in range(settings.steps_max):
        found = _regression(parts, joint, delay, settings)
        if found is None:
            return None
        step, made = found
        delay = float(np.clip(delay + step, -reach, reach))
        if abs(step) < settings.settled_s:
            break
    assert made is not None
    return Shift(delay, made[0], made[1])


def _regression(
    parts: Sequence[Log], joint: str, delay: float, settings: Clocks
) -> tuple[float, tuple[float, float]] | None:
    """Return the step of the delay [s], and its standard error and the residual, RMS."""
    columns, position = [], []
    for part in parts:
        time, speed = _measured(part, joint)
        now = np.interp(time + delay, time, speed)
        inside = (time + delay >= time[0]) & (time + delay <= time[-1])
        moved = cumulative_trapezoid(now, time, initial=0.0)
        rows = np.column_stack([moved, now, time])[inside]
        columns.append(rows - rows.mean(axis=0))
        place = part.column(f"qpos.{joint}")[inside]
        position.append(place - place.mean())
    if not columns or sum(map(len, columns)) < settings.rows_min:
        return None
    table, wanted = np.concatenate(columns), np.concatenate(position)
    if np.linalg.matrix_rank(table) < table.shape[1]:
        return None
    weights, *_ = np.linalg.lstsq(table, wanted, rcond=None)
    left = wanted - table @ weights
    spread = float(left @ left) / max(len(wanted) - len(weights), 1)
    error = np.sqrt(spread * np.linalg.inv(table.T @ table)[1, 1])
    gain = weights[0] if abs(weights[0]) > settings.gain_min else 1.0
    return float(weights[1] / gain), (float(error / abs(gain)), float(np.sqrt(spread)))


def filtered_residual(parts: Sequence[Log], joint: str, settings: Clocks = DEFAULT.clocks) -> float:
    """Return what is left of the position where the speed is a filter's output, RMS.

    A first-order filter and a mean over the last moments (a Dynamixel's speed register) are tried,
    of time constants up to `reach_s`. The position goes through the same filter, so that both are
    late alike.
    """
    tables, places, steps = [], [], []
    for part in parts:
        time, speed = _measured(part, joint)
        rows = np.column_stack([cumulative_trapezoid(speed, time, initial=0.0), time])
        tables.append(rows - rows.mean(axis=0))
        places.append(part.column(f"qpos.{joint}"))
        steps.append(float(np.median(np.diff(time))))
    table = np.concatenate(tables)
    best = np.inf
    for constant in np.geomspace(settings.fastest_s, settings.reach_s, settings.filters):
        for late in (_first_order, _mean_of_last):
            made = [late(x - x[0], step / constant) for x, step in zip(places, steps, strict=True)]
            wanted = np.concatenate([x - x.mean() for x in made])
            weights, *_ = np.linalg.lstsq(table, wanted, rcond=None)
            best = min(best, float(np.sqrt(np.mean((wanted - table @ weights) ** 2))))
    return best


def _first_order(x: np.ndarray, ratio: float) -> np.ndarray:
    """Filter x (T,) with a time constant of 1 / ratio rows."""
    share = 1 - np.exp(-ratio)
    return np.asarray(lfilter([share], [1, share - 1], x))


def _mean_of_last(x: np.ndarray, ratio: float) -> np.ndarray:
    """Return the mean of x (T,) over the last 2 / ratio rows, which is 1 / ratio rows late."""
    width = 2 / ratio
    total = np.concatenate([[0.0], np.cumsum(x)])  # the sum up to each row
    now = np.arange(1, len(x) + 1)
    before = np.maximum(now - width, 0)
    return (total[now] - np.interp(before, np.arange(len(total)), total)) / width


def _measured(part: Log, joint: str) -> tuple[np.ndarray, np.ndarray]:
    """Return when a joint was read (T,), increasing, and its speeds (T,)."""
    stamps = part.columns.get(f"stamp.{joint}", part.time)
    later = np.maximum.accumulate(stamps + SMALLEST * np.arange(len(stamps)))
    return later, part.column(f"qvel.{joint}")
