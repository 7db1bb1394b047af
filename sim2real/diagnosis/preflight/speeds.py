"""Speed registers against the change of the positions: their scale, their sign, their delay.

    laws = speed_laws(pairs)                # by joint: speed(t) = scale dq/dt(t - delay)
    findings = check_speeds(pairs)

The integrated speed is compared with the position, so that counts are not differentiated; one
least-squares problem a joint gives scale and delay, the latter to well below a row's length. A
register that is late is filtered, or read late: both delay slow motions alike. One that is early
was not stamped on the positions' clock. An exact speed may seem up to half a row late: commands
change at the rows, so that a speed read before one is rather that of the row that ends.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.signal import detrend

from hardware.log import Log
from sim2real.diagnosis.data.pairs import Pairs, episodes_with, joints_of
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Preflight, Settings

MILLI = 1e-3
SMALLEST = 1e-12  # s: between readings that carry the same stamp


class SpeedLaw(NamedTuple):
    """How a speed follows its position."""

    scale: float  # of the speed, in changes of the position over time
    delay: float  # s
    error: float  # standard error of the delay, s
    row: float  # median time between readings, s


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
        unclear = max(limits.offset_s, limits.sigmas * law.error)
        if -unclear < law.delay < unclear + law.row / 2:
            continue
        check, side = ("velocity_filter", "after") if law.delay > 0 else ("clock", "before")
        size = f"{abs(law.delay) / MILLI:.1f} ms (± {2 * law.error / MILLI:.1f})"
        fix = "Stamp both channels on one clock, or give the position its own stamps."
        if law.delay > 0:
            needs = f"velocity_filter={law.delay:.3f} s"
            fix = f"No action needed; a policy that reads it needs {needs}."
        yield Finding(check, joint, f"The speed of {joint} comes {size} {side} its position.", fix)


def speed_laws(pairs: Pairs, settings: Preflight = DEFAULT.preflight) -> dict[str, SpeedLaw]:
    """Return how the speed register of each joint follows its position, where it does."""
    laws = {
        joint: speed_law(episodes_with(pairs, f"qpos.{joint}", f"qvel.{joint}"), joint, settings)
        for joint in joints_of(pairs)
    }
    return {joint: law for joint, law in laws.items() if law is not None}


def speed_law(
    parts: Sequence[Log], joint: str, settings: Preflight = DEFAULT.preflight
) -> SpeedLaw | None:
    """Return how a joint's speed follows its position in episodes that have `qvel.<joint>`.

    Rows within the largest delay of their ends do not count. None where the speed says nothing: too
    few rows, a joint that hardly moved, or another quantity.
    """
    reach, known = settings.reach_s, []
    for part in parts:
        stamps = part.columns.get(f"stamp.{joint}", part.time)
        time = np.maximum.accumulate(stamps + SMALLEST * np.arange(len(stamps)))
        inside = (time >= time[0] + reach) & (time <= time[-1] - reach)
        if inside.sum() >= settings.rows_min:
            turned = cumulative_trapezoid(part.column(f"qvel.{joint}"), time, initial=0.0)
            known.append((time, turned, inside, part.column(f"qpos.{joint}")))
    if not known:
        return None
    wanted = np.concatenate([detrend(place[inside]) for _, _, inside, place in known])

    def moved(delay: float) -> np.ndarray:
        later = [np.interp((t + delay)[inside], t, turned) for t, turned, inside, _ in known]
        return np.concatenate([detrend(one) for one in later])

    power, prompt = float(wanted @ wanted), moved(0.0)
    if power == 0 or not prompt.any():
        return None
    fit = least_squares(
        lambda x: x[0] * moved(x[1]) - wanted,
        (float(prompt @ wanted / (prompt @ prompt)), 0.0),
        bounds=((-np.inf, -reach), (np.inf, reach)),
        x_scale="jac",
    )
    left, (gain, delay) = float(fit.fun @ fit.fun), fit.x
    if left > (1 - settings.share) * power:
        return None
    spread = left / max(len(wanted) - len(fit.x), 1)
    error = np.sqrt(spread * np.linalg.pinv(fit.jac.T @ fit.jac)[1, 1])
    row = float(np.median(np.concatenate([np.diff(time) for time, *_ in known])))
    return SpeedLaw(1 / float(gain), float(delay), float(error), row)
