"""The ways in which a term may have been made: factors, offsets, order and signs, and their words.

A way says of each number j which element i it shows, and value_j = slope_j x_i(t - age) + shift_j.
`decode` compares thousands of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.contract.rebuild import Variant

DEGREES = 180.0 / np.pi
TWICE = 2.0
ROUNDED, AT_MOST = 12.0, 4.0  # step² over the mean and the largest square of rounding to it
RESTING = 3.0  # steps: a number that spreads less is rounded alike all the time


class Target(NamedTuple):
    """What was logged, and how it should follow from its source.

    Attributes:
        name: of the term.
        elements: a name for each number.
        values: logged, (T, k).
        scale: described factor, (k,).
        angular: whether degrees are a likely unit.
        clip: numbers of this size and above were cut, and are left out.
        flipped: what a sign that is wrong in all numbers is called.
        resolution: step to which each number is rounded, (k,); None for none.
        apart: where a number is not compared, (T, k) bool; None for nowhere.
    """

    name: str
    elements: Sequence[str]
    values: np.ndarray
    scale: np.ndarray
    angular: bool
    clip: float = np.inf
    flipped: str = "sign"
    resolution: np.ndarray | None = None
    apart: np.ndarray | None = None

    def rounding(self, spread: np.ndarray) -> np.ndarray:
        """Return the mean square of what rounding makes of each number, (k,).

        At most, of one that rests: whose standard deviation (k,) is a few steps.
        """
        if self.resolution is None:
            return np.zeros(self.values.shape[1])
        rests = spread < RESTING * self.resolution
        return self.resolution**2 / np.where(rests, AT_MOST, ROUNDED)


class Change(NamedTuple):
    """One way in which the log differs from the description.

    Attributes:
        fault: its kind, such as "sign".
        elements: of which numbers.
        text: what is wrong.
        fix: one line.
        value: a fitted or counted value, such as the age in steps; None where there is none.
    """

    fault: str
    elements: tuple[str, ...]
    text: str
    fix: str
    value: float | None = None


class Gain(NamedTuple):
    """A factor that a whole term may have."""

    fault: str
    text: str
    fix: str
    factor: np.ndarray  # (k,)
    price: float
    value: float | None = None


class Pose(NamedTuple):
    """An offset that a whole term may have."""

    text: str
    fix: str
    offset: np.ndarray  # (k,), before scaling
    price: float


class Moments(NamedTuple):
    """Means and covariances of logged numbers and a source, each over the rows of its number."""

    mean: np.ndarray  # of the log, (k,)
    var: np.ndarray
    source_mean: np.ndarray  # (k, k): in the rows of number j, source i
    source_var: np.ndarray  # (k, k)
    cov: np.ndarray  # (k, k): logged j, source i


@dataclass
class Way:
    """One way to make a term, with its score."""

    variant: Variant
    age: int
    gain: Gain
    pose: Pose
    score: float
    order: np.ndarray  # (k,): the source of each number
    option: np.ndarray  # (k,): how each number is made
    scores: np.ndarray = field(repr=False)  # (k, k)
    slope: np.ndarray = field(repr=False)  # (k,): value = slope x source + shift
    shift: np.ndarray = field(repr=False)


# how one number may be made, in the order of `options`; gain g, offset b of its own place
# or c of the element that it shows: g(x+b), g(x+c), -g(x+b), g(b-x), gx + free, free g(x+b),
# -gx + free, -g(x+c), g(c-x)
AT_OWN = (1, 7, 8)  # differ from others only where the order does
SIGNED = (2, 3, 6, 7, 8)
SHIFTED, SCALED = (4, 6), 5


def poses(way: Variant, ratio: np.ndarray | None = None) -> list[Pose]:
    """Return the offsets that a whole term may have, the described one first.

    Args:
        way: the source.
        ratio: described factor over the one that is tried, (k,): the offset may have been added
            after it, and is then what it should be.
    """
    found = [Pose("", "", way.offset, 0.0)]
    if np.any(way.offset):
        if ratio is not None and not np.allclose(ratio, 1.0):
            found.append(Pose("", "", way.offset * ratio, 0.0))
        missing = "lacks the default pose", "take the default pose into account"
        twice = "has the default pose twice", "take the default pose into account once"
        turned = "has the default pose with the wrong sign", "negate the default pose"
        found += [
            Pose(*missing, np.zeros_like(way.offset), 1.0),
            Pose(*twice, TWICE * way.offset, 1.0),
            Pose(*turned, -way.offset, 1.0),
        ]
    return found


def gains(
    target: Target, moments: Moments | None, free_price: float, offset: np.ndarray | None = None
) -> list[Gain]:
    """Return the factors that a whole term may have, the described one first.

    A free factor is estimated from the spreads, whatever the order, and from the numbers in their
    own order, where the offset (k,) was added before the factor and where it was added after it.
    """
    scale, flipped = target.scale, target.flipped
    found = [Gain("", "", "", scale, 0.0)]
    if moments is None:
        return found
    text = "points the other way" if flipped != "sign" else "has the wrong sign everywhere"
    found.append(Gain(flipped, text, "negate it", -scale, 1.0))
    if target.angular:
        found.append(Gain("unit", "is in degrees", "convert it to rad", scale * DEGREES, 1.0))
        again = "was converted from degrees to rad twice"
        found.append(Gain("unit", again, "convert it once", scale / DEGREES, 1.0))
    if not np.allclose(scale, 1.0):
        once = "was not multiplied by its scale"
        found.append(Gain("scale", once, "multiply it by its scale", np.ones_like(scale), 1.0))
        twice = "was multiplied by its scale twice"
        found.append(Gain("scale", twice, "multiply it once", scale**2, 1.0))
    for ratio in _ratios(scale, moments, np.zeros_like(scale) if offset is None else offset):
        text = f"is {ratio:.4g} times as large as described"
        fix, price = f"divide it by {ratio:.4g}", free_price
        found.append(Gain("scale", text, fix, scale * ratio, price, ratio))
    return found


def _ratios(scale: np.ndarray, moments: Moments, offset: np.ndarray) -> list[float]:
    """Return the factors on a whole term that spreads and least squares tell."""
    var, mean = np.diag(moments.source_var), np.diag(moments.source_mean)
    power = float(np.sum(scale**2 * var))
    if power <= 0:
        return []
    found = [float(np.sqrt(moments.var.sum() / power))]
    with_source = np.diag(moments.cov) + moments.mean * mean  # E[value source]
    square = var + mean**2
    after = scale * (with_source - scale * offset * mean)
    found.append(float(after.sum() / np.sum(scale**2 * square)))
    if np.any(offset):
        before = scale * (with_source + moments.mean * offset)
        whole = square + 2 * offset * mean + offset**2
        found.append(float(before.sum() / np.sum(scale**2 * whole)))
    return [ratio for ratio in found if ratio > 0]


def options(
    gain: Gain, pose: Pose, moments: Moments, free_price: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return slopes and shifts (options, k, k) of every option, and its price."""
    k = len(gain.factor)
    g = np.repeat(gain.factor[:, None], k, axis=1)  # (k, k)
    b = np.repeat(pose.offset[:, None], k, axis=1)
    own = np.repeat(pose.offset[None, :], k, axis=0)
    mean, x = moments.mean[:, None], moments.source_mean
    free = mean - g * x
    against = g * (moments.cov + mean * (x + b))
    power = np.maximum(g**2 * (moments.source_var + (x + b) ** 2), np.finfo(float).tiny)
    ratio = np.maximum(against / power, 0.0)
    slope = np.stack([g, g, -g, -g, g, ratio * g, -g, -g, -g])
    ends = [g * b, g * own, -g * b, g * b, free, ratio * g * b, mean + g * x, -g * own, g * own]
    fitted = free_price
    price = [0.0, 0.0, 1.0, 1.0, fitted, fitted, 1.0 + fitted, 1.0, 1.0]
    return slope, np.stack(ends), np.array(price)


def changes(target: Target, way: Way) -> tuple[Change, ...]:
    """Return what a way changes, in words."""
    names = target.elements
    found, all_of = [], tuple(names)
    if way.variant.fault:
        source = way.variant
        text = f"{target.name} {source.text}"
        found.append(Change(source.fault, all_of, text, source.fix))
    late = way.age - way.variant.age
    if late:
        side = "older" if late > 0 else "newer"
        steps = f"{abs(late)} step{'s' if abs(late) > 1 else ''}"
        text = f"{target.name} is {steps} {side} than described"
        fix = "use the newest measurement" if late > 0 else f"delay it by {steps}"
        found.append(Change("age", all_of, text, fix, float(late)))
    if way.gain.fault:
        gain = way.gain
        text = f"{target.name} {gain.text}"
        found.append(Change(gain.fault, all_of, text, gain.fix, gain.value))
    if way.pose.text:
        found.append(Change("default_pose", all_of, f"{target.name} {way.pose.text}", way.pose.fix))
    return (*found, *_of_elements(target, way))


def _of_elements(target: Target, way: Way) -> list[Change]:
    """Return order, signs, offsets and scales of single numbers."""
    names, found, name = target.elements, [], target.name
    own: list[int] = way.order.tolist()
    moved = [j for j, i in enumerate(own) if i != j]
    if moved:
        order = [names[i] for i in own]
        places = tuple(names[j] for j in moved)
        read = ", ".join(f"{order[j]} where {names[j]} belongs" for j in moved)
        fix = f"the robot's order is [{', '.join(order)}]; reorder it as described"
        found.append(Change("permutation", places, f"{name} has {read}", fix))
    turned = [j for j in range(len(names)) if way.option[j] in SIGNED]
    if turned:
        places = tuple(names[j] for j in turned)
        listed = ", ".join(places)
        text, fix = f"{name} has the wrong sign at {listed}", f"negate {listed}"
        found.append(Change("sign", places, text, fix))
    for j in range(len(names)):
        if way.option[j] in SHIFTED:
            value = way.shift[j] / way.slope[j] - way.pose.offset[j]
            text = f"{name} at {names[j]} is off by {value:+.4g} before scaling"
            found.append(Change("offset", (names[j],), text, "correct this joint's zero or "
                                "its default pose", float(value)))  # fmt: skip
        if way.option[j] == SCALED:
            ratio = way.slope[j] / way.gain.factor[j]
            text = f"{name} at {names[j]} is {ratio:.4g} times as large as described"
            fix = f"divide it by {ratio:.4g}"
            found.append(Change("scale", (names[j],), text, fix, float(ratio)))
    return found
