"""The ways in which a term may have been made: factors, offsets, order and signs, and their words.

A way says of each number j which element i it shows, and value_j = slope_j x_i(t - age) + shift_j.
`decode` compares thousands of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.contract.rebuild import Mistake, Variant

DEGREES = 180.0 / np.pi
ROUNDED, AT_MOST = 12.0, 4.0  # step² over the mean and the largest square of rounding to it
SAME_VALUE = 0.05  # two fitted values that differ by less are reported as one
RESTING = 3.0  # steps: a number that spreads less is rounded alike all the time


class Target(NamedTuple):
    """What was logged, and how it should follow from its source.

    Attributes:
        stage: as of a `Finding`.
        name: of the term.
        elements: a name for each number.
        values: logged, (T, k).
        scale: described factor, (k,).
        angular: whether degrees are a likely unit.
        clip: numbers of this size and above were cut, and are left out.
        flipped: what a sign that is wrong in all numbers is called.
        resolution: step to which each number is rounded, (k,); 0 for none.
        apart: where a number is not compared, (T, k).
    """

    stage: str
    name: str
    elements: Sequence[str]
    values: np.ndarray
    scale: np.ndarray
    angular: bool
    clip: float = np.inf
    flipped: str = "sign"
    resolution: np.ndarray | float = 0.0
    apart: np.ndarray | bool = False

    def place(self, elements: Sequence[str]) -> str:
        """Return the term, and the elements if they are not all."""
        every = len(elements) == len(self.elements)
        return self.name if every else f"{self.name}: {', '.join(elements)}"

    def rounding(self, spread: np.ndarray) -> np.ndarray:
        """Return the mean square of what rounding makes of each number, (k,).

        At most, of one that rests: whose standard deviation (k,) is a few steps.
        """
        rests = spread < RESTING * self.resolution
        return self.resolution**2 / np.where(rests, AT_MOST, ROUNDED)


class Change(NamedTuple):
    """One way in which the log differs from the description: a mistake and where it is."""

    where: str  # the term, and the elements if they are not all
    fault: str
    text: str
    fix: str
    value: float | None

    def same(self, other: Change) -> bool:
        """Return whether another one is this one, with a slightly different value."""
        if self.value is None or other.value is None:
            return self == other
        alike = self[:2] == other[:2]
        return alike and math.isclose(self.value, other.value, rel_tol=SAME_VALUE)


class Gain(NamedTuple):
    """A factor (k,) that a whole term may have, and the mistake that it is; None: as described."""

    mistake: Mistake | None
    factor: np.ndarray
    price: float = 1.0


class Pose(NamedTuple):
    """An offset (k,) before scaling that a whole term may have; see `Gain`."""

    mistake: Mistake | None
    offset: np.ndarray


class Moments(NamedTuple):
    """Means and covariances of logged numbers and a source, each over the rows of its number."""

    mean: np.ndarray  # of the log, (k,)
    var: np.ndarray
    source_mean: np.ndarray  # (k, k): in the rows of number j, source i
    source_var: np.ndarray  # (k, k)
    cov: np.ndarray  # (k, k): logged j, source i


class Way(NamedTuple):
    """One way to make a term, with its score."""

    variant: Variant
    age: int
    gain: Gain
    pose: Pose
    score: float
    order: np.ndarray  # (k,): the source of each number
    option: np.ndarray  # (k,): how each number is made
    scores: np.ndarray  # (k, k): of each number from each source
    slope: np.ndarray  # (k,): value = slope x source + shift
    shift: np.ndarray


# places in `options`
AT_OWN = (1, 7, 8)  # differ from others only where the order does
SIGNED = (2, 3, 6, 7, 8)
SHIFTED, SCALED = (4, 6), 5


def poses(way: Variant, ratio: np.ndarray) -> list[Pose]:
    """Return the offsets that a whole term may have, the described one first.

    Args:
        way: the source.
        ratio: described factor over the one that is tried, (k,): the offset may have been added
            after it, and is then what it should be.
    """
    found = [Pose(None, way.offset)]
    if not np.any(way.offset):
        return found
    if not np.allclose(ratio, 1.0):
        found.append(Pose(None, way.offset * ratio))
    for text, fix, factor in (
        ("lacks the default pose", "take the default pose into account", 0.0),
        ("has the default pose twice", "take the default pose into account once", 2.0),
        ("has the default pose with the wrong sign", "negate the default pose", -1.0),
    ):
        found.append(Pose(Mistake("default_pose", text, fix), factor * way.offset))
    return found


def gains(target: Target, moments: Moments, free_price: float, offset: np.ndarray) -> list[Gain]:
    """Return the factors that a whole term may have, the described one first.

    A free factor is estimated from the spreads, whatever the order, and from the numbers in their
    own order, where the offset (k,) was added before the factor and where it was added after it.
    """
    scale = target.scale
    text = "points the other way" if target.flipped != "sign" else "has the wrong sign everywhere"
    found = [
        Gain(None, scale, 0.0),
        Gain(Mistake(target.flipped, text, "negate it"), -scale),
    ]
    if target.angular:
        again = "was converted from degrees to rad twice"
        found += [
            Gain(Mistake("unit", "is in degrees", "convert it to rad"), scale * DEGREES),
            Gain(Mistake("unit", again, "convert it once"), scale / DEGREES),
        ]
    if not np.allclose(scale, 1.0):
        once, twice = "was not multiplied by its scale", "was multiplied by its scale twice"
        found += [
            Gain(Mistake("scale", once, "multiply it by its scale"), np.ones_like(scale)),
            Gain(Mistake("scale", twice, "multiply it once"), scale**2),
        ]
    for ratio in _ratios(scale, moments, offset):
        found.append(Gain(_scaled(ratio), scale * ratio, free_price))
    return found


def _scaled(ratio: float) -> Mistake:
    text = f"is {ratio:.4g} times as large as described"
    return Mistake("scale", text, f"divide it by {ratio:.4g}", ratio)


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
    """Return slopes and shifts (options, k, k) with which number j may show i, and their prices."""
    g, b, of_source = gain.factor[:, None], pose.offset[:, None], pose.offset[None, :]
    mean, x = moments.mean[:, None], moments.source_mean
    against = g * (moments.cov + mean * (x + b))
    power = np.maximum(g**2 * (moments.source_var + (x + b) ** 2), np.finfo(float).tiny)
    fitted = np.maximum(against / power, 0.0) * g
    table = [
        (g, g * b, 0.0),  # as described
        (g, g * of_source, 0.0),  # with the offset of the element that it shows
        (-g, -g * b, 1.0),
        (-g, g * b, 1.0),
        (g, mean - g * x, free_price),
        (fitted, fitted * b, free_price),
        (-g, mean + g * x, 1.0 + free_price),
        (-g, -g * of_source, 1.0),
        (-g, g * of_source, 1.0),
    ]
    slopes, shifts, prices = zip(*table, strict=True)
    shape = moments.cov.shape
    slope, shift = (np.stack([np.broadcast_to(one, shape) for one in o]) for o in (slopes, shifts))
    return slope, shift, np.array(prices)


def changes(target: Target, way: Way) -> tuple[Change, ...]:
    """Return what a way changes, in words."""
    found: list[tuple[Mistake | None, tuple[str, ...]]]
    names = tuple(target.elements)
    whole = (way.variant.mistake, _late(way), way.gain.mistake, way.pose.mistake)
    found = [(mistake, names) for mistake in whole]
    moved = np.flatnonzero(way.order != np.arange(len(names)))
    if moved.size:
        order = [names[i] for i in way.order]
        text = "has " + ", ".join(f"{order[j]} where {names[j]} belongs" for j in moved)
        fix = f"the robot's order is [{', '.join(order)}]; reorder it as described"
        found.append((Mistake("permutation", text, fix), tuple(names[j] for j in moved)))
    turned = tuple(names[j] for j in np.flatnonzero(np.isin(way.option, SIGNED)))
    if turned:
        listed = ", ".join(turned)
        text = f"has the wrong sign at {listed}"
        found.append((Mistake("sign", text, f"negate {listed}"), turned))
    for j, (name, option) in enumerate(zip(names, way.option, strict=True)):
        if option in SHIFTED:
            value = float(way.shift[j] / way.slope[j] - way.pose.offset[j])
            text = f"at {name} is off by {value:+.4g} before scaling"
            fix = "correct this joint's zero or its default pose"
            found.append((Mistake("offset", text, fix, value), (name,)))
        if option == SCALED:
            scaled = _scaled(float(way.slope[j] / way.gain.factor[j]))
            found.append((scaled._replace(text=f"at {name} {scaled.text}"), (name,)))
    return tuple(
        Change(target.place(of), one.fault, f"{target.name} {one.text}", one.fix, one.value)
        for one, of in found
        if one is not None
    )


def _late(way: Way) -> Mistake | None:
    late = way.age - way.variant.age
    if not late:
        return None
    steps = f"{abs(late)} step{'s' if abs(late) > 1 else ''}"
    text = f"is {steps} {'older' if late > 0 else 'newer'} than described"
    fix = "use the newest measurement" if late > 0 else f"delay it by {steps}"
    return Mistake("age", text, fix, float(late))
