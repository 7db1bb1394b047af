"""Clocks: times that were never measured, and clocks that drift apart.

    findings = check_clocks(logs)

A drift shows in the stamps: a clock that runs fast by 200 ppm is 12 ms ahead after a minute. What
is late against the *commands* is a delay, which the diagnosis itself looks for.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.stats import linregress

from hardware.log import Log
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Preflight, Settings

MILLI, PPM = 1e-3, 1e-6


def check_clocks(logs: Sequence[Log], settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Yield what the clocks of logs contradict."""
    if any(log.meta.get("clock") == "nominal" for log in logs):
        yield Finding(
            "clock",
            None,
            "The times are the frame's number over the frame rate: they were computed, not "
            "measured.",
            "Log the clock at which each row was read; until then a delay below one frame, and "
            "its changes, cannot be distinguished from the recorder's.",
        )
    for joint in dict.fromkeys(joint for log in logs for joint in log.joints):
        drifts = (_drift(log, joint, settings.preflight) for log in logs)
        yield from [finding for finding in drifts if finding is not None][:1]


def _drift(log: Log, joint: str, limits: Preflight) -> Finding | None:
    """Return a finding where the clock of a joint's stamps drifts."""
    if f"stamp.{joint}" not in log.columns:
        return None
    ppm, error = stamp_drift(log, joint)
    ahead = PPM * abs(ppm) * max(float(np.ptp(part.time)) for part in log.episodes())
    if ahead < limits.offset_s or abs(ppm) <= limits.sigmas * error:
        return None
    return Finding(
        "drift",
        joint,
        f"The clock that stamps {joint} runs {abs(ppm):.0f} ppm (± {2 * error:.0f}) "
        f"{'fast' if ppm > 0 else 'slow'} against the commands': "
        f"{ahead / MILLI:.1f} ms over the log.",
        f"Divide its stamps by {1 + PPM * ppm:.6f}, or log both on one clock.",
    )


def stamp_drift(log: Log, joint: str) -> tuple[float, float]:
    """Return how much faster a joint's clock runs than the commands' [ppm], and its standard error.

    The slope of `stamp.<joint>` - `time` over `time`, episodes each from their own middle.
    """
    times, lates = [], []
    for part in log.episodes():
        late = part.column(f"stamp.{joint}") - part.time
        times.append(part.time - part.time.mean())
        lates.append(late - late.mean())
    fit: Any = linregress(np.concatenate(times), np.concatenate(lates))
    return float(fit.slope) / PPM, float(fit.stderr) / PPM
