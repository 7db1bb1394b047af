"""Speed registers against the change of the positions: their scale, their sign, their delay.

    laws = speed_laws(pairs)                # by joint: speed(t) = scale dq/dt(t - delay)
    findings = check_speeds(pairs)

The integrated speed is compared with the position, so that counts are not differentiated; one
least-squares problem a joint gives scale and delay, the latter to well below a row's length. A
register that is late is filtered, or read late: both delay slow motions alike. One that is early
was not stamped on the positions' clock.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.signal import detrend

from hardware.log import Log
from sim2real.diagnosis.data.pairs import Pairs, joints_of
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Preflight, Settings

MILLI = 1e-3
SMALLEST = 1e-12  # s: between readings that carry the same stamp


class SpeedLaw(NamedTuple):
    """How a speed follows its position."""

    scale: float  # of the speed, in changes of the position over time
    delay: float  # s
    error: float  # standard error of the delay, s


def check_speeds(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Yield speeds of another scale or sign than their positions', and those of another time."""
    limits = settings.preflight
    laws = speed_laws(pairs, limits)
    low, high = limits.ratio
    wrong = {joint: law.scale for joint, law in laws.items() if not low < law.scale < high}
    common = float(np.median(list(wrong.values()))) if wrong else 1.0
    if len(wrong) == len(laws) > 1 and all(low < a / common < high for a in wrong.values()):
        wrong = {None: common}
    for joint, scale in wrong.items():
        column = "qvel" if joint is None else f"qvel.{joint}"
        whose = "every joint" if joint is None else joint
        yield Finding(
            "speed",
            joint,
            f"The speed of {whose} is {scale:.3g} times the change of the position over time: "
            "speeds, positions or stamps have a wrong unit or sign.",
            f"Divide `{column}` by {scale:.4g}; where the diagnosis names the position or the "
            "clock as the mistake, correct that instead.",
        )
    for joint, law in laws.items():
        if abs(law.delay) < max(limits.offset_s, limits.sigmas * law.error):
            continue
        size = f"{abs(law.delay) / MILLI:.1f} ms (± {2 * law.error / MILLI:.1f})"
        if law.delay > 0:
            yield Finding(
                "velocity_filter",
                joint,
                f"The speed of {joint} comes {size} after its position.",
                f"No action needed; a policy that reads it needs velocity_filter={law.delay:.3f} "
                "s.",
            )
        else:
            yield Finding(
                "clock",
                joint,
                f"The speed of {joint} comes {size} before its position.",
                "Stamp both channels on one clock, or give the position its own stamps.",
            )


def speed_laws(pairs: Pairs, settings: Preflight = DEFAULT.preflight) -> dict[str, SpeedLaw]:
    """Return how the speed register of each joint follows its position, where it does."""
    found = {}
    for joint in joints_of(pairs):
        names = f"qpos.{joint}", f"qvel.{joint}"
        logs = [log for log, _ in pairs if all(name in log.columns for name in names)]
        law = speed_law([part for log in logs for part in log.episodes()], joint, settings)
        if law is not None:
            found[joint] = law
    return found


def speed_law(
    parts: Sequence[Log], joint: str, settings: Preflight = DEFAULT.preflight
) -> SpeedLaw | None:
    """Return how a joint's speed follows its position.

    Args:
        parts: episodes that have `qvel.<joint>`.
        joint: which.
        settings: the largest delay, and what the law has to explain.

    Returns:
        None where the speed says nothing: too few rows, a joint that hardly moved, or another
        quantity.
    """
    known = [one for part in parts if (one := _measured(part, joint, settings)) is not None]
    if not known:
        return None
    wanted = np.concatenate([detrend(place[inside]) for _, _, place, inside in known])

    def moved(delay: float) -> np.ndarray:
        later = [np.interp((t + delay)[inside], t, turned) for t, turned, _, inside in known]
        return np.concatenate([detrend(one) for one in later])

    power = float(wanted @ wanted)
    if power == 0 or not moved(0.0).any():
        return None
    reach = settings.reach_s
    first = float(moved(0.0) @ wanted / (moved(0.0) @ moved(0.0)))
    fit = least_squares(
        lambda x: x[0] * moved(x[1]) - wanted,
        (first, 0.0),
        bounds=((-np.inf, -reach), (np.inf, reach)),
        x_scale="jac",
    )
    left, (gain, delay) = float(fit.fun @ fit.fun), fit.x
    if left > (1 - settings.share) * power:
        return None
    spread = left / max(len(wanted) - len(fit.x), 1)
    error = np.sqrt(spread * np.linalg.pinv(fit.jac.T @ fit.jac)[1, 1])
    return SpeedLaw(1 / float(gain), float(delay), float(error))


def _measured(
    part: Log, joint: str, settings: Preflight
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """Return times of reading, integrated speed, position and which rows count, (T,) each.

    Rows within the largest delay of an end do not count; None where too few are left.
    """
    stamps = part.columns.get(f"stamp.{joint}", part.time)
    time = np.maximum.accumulate(stamps + SMALLEST * np.arange(len(stamps)))
    ends = time[0] + settings.reach_s, time[-1] - settings.reach_s
    inside = (time >= ends[0]) & (time <= ends[1])
    if inside.sum() < settings.rows_min:
        return None
    turned = cumulative_trapezoid(part.column(f"qvel.{joint}"), time, initial=0.0)
    return time, turned, part.column(f"qpos.{joint}"), inside
