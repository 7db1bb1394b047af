"""Clocks: times that were never measured, and clocks that drift apart.

    findings = check_clocks(logs)

A drift shows in the stamps: a clock that runs fast by 200 ppm is 12 ms ahead after a minute. What
is late against the *commands* is a delay, which the diagnosis itself looks for.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Preflight, Settings

MILLI, PPM = 1e-3, 1e-6


def check_clocks(logs: Sequence[Log], settings: Settings = DEFAULT) -> list[Finding]:
    """Return what the clocks of logs contradict.

    Args:
        logs: the logs.
        settings: when a clock is worth a finding.
    """
    found = [*_nominal(logs)]
    for joint in dict.fromkeys(joint for log in logs for joint in log.joints):
        found += _drifting(logs, joint, settings.preflight)
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


def _drifting(logs: Sequence[Log], joint: str, limits: Preflight) -> Iterator[Finding]:
    for log in logs:
        drift = stamp_drift(log, joint)
        length = max(float(np.ptp(part.time)) for part in log.episodes())
        if drift is None or length < limits.drift_s:
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
