"""Places and sizes of what a case hides, found by trying them on the emulated robot.

    found = hide(robot, ("backlash",), seed=7)
    found.truths[0]["value"], found.gap / found.floor

The gap of an effect is the RMS difference between the robot with and without it, driven along the
same motion under the same noise; the floor is that of the robot from itself under other noise.
"""

import logging
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from hardware.config import Robot
from hardware.errors import HardwareError
from sim2real.exam.hiding import EFFECTS, Secret, choose, places
from sim2real.exam.logs import difference, drive, overall, plans

log_ = logging.getLogger(__name__)
SMALLEST, LARGEST = 3.0, 30.0  # gaps, in floors
COUNT = 2 * np.pi / 4096  # rad: the encoders' resolution
CLOSE = 1.25  # a gap this near to the wanted one, as a factor, will do
TRIALS = 7  # recordings of a search at most
Gap = Callable[[list[dict[str, Any]]], float | None]  # of entries; None: the robot cannot run so


class Hidden(NamedTuple):
    """A hidden effect, and its influence on the log."""

    # entries of an effects.yaml, each with `joint` and its own `gap`
    truths: tuple[dict[str, Any], ...]
    gap: float  # RMS difference between the robot with and without all of them [rad]
    floor: float  # RMS difference of the robot from itself under other noise, or one count [rad]


def hide(robot: Robot, effects: Sequence[str], seed: int) -> Hidden | None:
    """Find places and sizes for effects; None if no place of the robot shows one of them.

    The robot is one of `exam_robot`; places, sizes, motions and noise follow from the seed.
    """
    rng = np.random.default_rng([seed, 1])
    plan = plans(robot, seed)["a"]
    bare = drive(robot, [], plan, seed)
    again = drive(robot, [], plan, seed + 1)
    floor = max(overall(difference(bare, again)), COUNT)

    def gap(entries: list[dict[str, Any]]) -> float | None:
        try:
            return overall(difference(drive(robot, entries, plan, seed), bare))
        except HardwareError as stopped:
            log_.debug("%s: %s", robot.name, stopped)
            return None

    truths: list[dict[str, Any]] = []
    for effect in effects:
        found = _place(robot, effect, [t["joint"] for t in truths], gap, floor, rng)
        if found is None:
            return None
        truths.append(found)
    whole = gap(entries(truths)) if truths else 0.0
    if whole is None:
        return None
    return Hidden(tuple(truths), whole, floor)


def entries(truths: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return hidden effects as an effects.yaml has them."""
    keys = ("effect", "where", "side", "value", "extra")
    return [{key: truth[key] for key in keys} for truth in truths]


def _place(
    robot: Robot,
    effect: str,
    taken: Sequence[str | None],
    gap: Gap,
    floor: float,
    rng: np.random.Generator,
) -> dict[str, Any] | None:
    """Find a place and a size for one effect; None where no place shows it."""
    wanted = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
    spots = places(robot, effect)
    for i in rng.permutation(len(spots)):
        secret = choose(robot, effect, spots[i], rng)
        if secret.joint in taken and len(spots) > 1:
            continue
        found = search(secret, wanted * floor, SMALLEST * floor, gap)
        if found is None:
            continue
        size, own = found
        return {**secret.entry(size), "joint": secret.joint, "gap": own}
    return None


def search(secret: Secret, wanted: float, least: float, gap: Gap) -> tuple[float, float] | None:
    """Find the size of an effect that makes a gap: by the secant in logarithms, kept in brackets.

    Args:
        secret: the effect.
        wanted: the gap [rad].
        least: where the largest size does not reach it, a gap of this much will do [rad].
        gap: the gap of entries; None where the robot cannot run.

    Returns:
        The size and its gap; None if not even `least` can be reached.
    """
    span = EFFECTS[secret.effect]
    ends = [math.log(span.low), math.log(span.high)]
    misses: list[float | None] = [None, None]  # logarithm of gap / wanted at the ends
    best: tuple[float, float] | None = None
    at = sum(ends) / 2
    for _ in range(TRIALS):
        got = gap([secret.entry(math.exp(at))])
        miss = None if got is None else math.log(max(got, 1e-9) / wanted)
        if got is not None and got >= least:
            nearer = best is None or abs(math.log(got / wanted)) < abs(math.log(best[1] / wanted))
            best = (math.exp(at), got) if nearer else best
        if miss is not None and abs(miss) < math.log(CLOSE):
            break
        side = int(miss is None or miss > 0)
        if side == 0 and at == math.log(span.high):
            break  # the largest size is too small: take it, if it is enough
        ends[side], misses[side] = at, miss
        at = _next(ends, misses, math.log(span.high))
    return best


def _next(ends: Sequence[float], misses: Sequence[float | None], largest: float) -> float:
    """Return the logarithm of the size to try: on the secant, or where the gap would be as wanted.

    A gap is taken to grow in proportion to a size where only one is known.
    """
    (low, high), (below, above) = ends, misses
    if below is not None and above is not None:
        part = below / (below - above)
    elif below is not None and high == largest:
        return min(low - 1.5 * below, largest)
    elif above is not None:
        return max(high - 1.5 * above, low + 0.05 * (high - low))
    else:
        part = 0.5
    return low + min(max(part, 0.15), 0.85) * (high - low)
