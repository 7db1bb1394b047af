"""The ways in which a term may have been made: factors, offsets, order and signs, and their words.

A way says of each number j which element i it shows, and value_j = slope_j x_i(t - age) + shift_j.
`decode` compares thousands of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.contract.answer import Fault
from sim2real.diagnosis.contract.rebuild import Mistake, Variant

DEGREES = 180.0 / np.pi


class Target(NamedTuple):
    """What was logged, and how it should follow from its source."""

    stage: str  # as of a `Finding`
    name: str  # of the term
    elements: Sequence[str]  # a name for each number
    values: np.ndarray  # logged, (T, k)
    scale: np.ndarray  # described factor, (k,)
    angular: bool  # whether degrees are a likely unit
    clip: float = np.inf  # numbers of this size and above were cut, and are left out
    flipped: str = "sign"  # what a sign that is wrong in all numbers is called
    resolution: np.ndarray | float = 0.0  # step to which each number is rounded, (k,); 0 for none
    apart: np.ndarray | bool = False  # where a number is not compared, (T, k)

    def place(self, elements: Sequence[str]) -> str:
        """Return the term, and the elements if they are not all."""
        every = len(elements) == len(self.elements)
        return self.name if every else f"{self.name}: {', '.join(elements)}"


# a factor or an offset (k,) that a whole term may have, and the mistake that it is if it is one
Choice = tuple[Mistake | None, np.ndarray]


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
    factor: np.ndarray  # (k,), of the whole term
    offset: np.ndarray  # (k,), of the whole term, before scaling
    mistakes: tuple[Mistake, ...]  # with the whole term
    score: float
    order: np.ndarray  # (k,): the source of each number
    option: np.ndarray  # (k,): how each number is made
    scores: np.ndarray  # (k, k): of each number from each source
    slope: np.ndarray  # (k,): value = slope x source + shift
    shift: np.ndarray


SHIFTED, SCALED = (4, 6), 5  # places in `options`


def poses(way: Variant, ratio: np.ndarray) -> list[Choice]:
    """Return the offsets that a whole term may have, before scaling, the described one first.

    `ratio` is the described factor over the one that is tried, (k,): the offset may have been added
    after it, and is then what it should be.
    """
    if not np.any(way.offset):
        return [(None, way.offset)]
    mistakes = (
        ("lacks the default pose", "take the default pose into account", 0.0),
        ("has the default pose twice", "take the default pose into account once", 2.0),
        ("has the default pose with the wrong sign", "negate the default pose", -1.0),
    )
    return [
        (None, way.offset),
        *([] if np.allclose(ratio, 1.0) else [(None, way.offset * ratio)]),
        *((Mistake("default_pose", text, fix), by * way.offset) for text, fix, by in mistakes),
    ]


def gains(target: Target, moments: Moments, free_price: float, offset: np.ndarray) -> list[Choice]:
    """Return the factors that a whole term may have, the described one first.

    A free factor is estimated from the spreads, whatever the order, and from the numbers in their
    own order, where the offset (k,) was added before the factor and where it was added after it.
    """
    scale = target.scale
    text = "points the other way" if target.flipped != "sign" else "has the wrong sign everywhere"
    found: list[Choice] = [(None, scale), (Mistake(target.flipped, text, "negate it"), -scale)]
    if target.angular:
        again = "was converted from degrees to rad twice"
        found += [
            (Mistake("unit", "is in degrees", "convert it to rad"), scale * DEGREES),
            (Mistake("unit", again, "convert it once"), scale / DEGREES),
        ]
    if not np.allclose(scale, 1.0):
        once, twice = "was not multiplied by its scale", "was multiplied by its scale twice"
        found += [
            (Mistake("scale", once, "multiply it by its scale"), np.ones_like(scale)),
            (Mistake("scale", twice, "multiply it once"), scale**2),
        ]
    ratios = _ratios(scale, moments, offset)
    return [*found, *((_scaled("", ratio, free_price), scale * ratio) for ratio in ratios)]


def _scaled(where: str, ratio: float, price: float = 1.0) -> Mistake:
    text = f"{where}is {ratio:.4g} times as large as described"
    return Mistake("scale", text, f"divide it by {ratio:.4g}", ratio, price)


def late(steps: int) -> Mistake | None:
    """Return what is wrong with a term that is so many steps older than described."""
    if steps == 0:
        return None
    words = f"{abs(steps)} step{'s' if abs(steps) > 1 else ''}"
    text = f"is {words} {'older' if steps > 0 else 'newer'} than described"
    fix = "use the newest measurement" if steps > 0 else f"delay it by {words}"
    return Mistake("age", text, fix, float(steps))


def _ratios(scale: np.ndarray, moments: Moments, offset: np.ndarray) -> list[float]:
    """Return the factors on a whole term that spreads and least squares tell.

    The offset may have been added before the factor that is wrong, or after it.
    """
    var, mean = np.diag(moments.source_var), np.diag(moments.source_mean)
    power = float(np.sum(scale**2 * var))
    if power <= 0:
        return []
    found = [float(np.sqrt(moments.var.sum() / power))]
    for before, after in ((0.0 * offset, offset), (offset, 0.0 * offset)):
        product = np.diag(moments.cov) + (moments.mean - scale * after) * (mean + before)
        square = var + (mean + before) ** 2
        found.append(float(np.sum(scale * product) / np.sum(scale**2 * square)))
    return list(dict.fromkeys(ratio for ratio in found if ratio > 0))


def options(
    factor: np.ndarray, offset: np.ndarray, moments: Moments, free_price: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return slopes and shifts (options, k, k) with which number j may show i, and their prices."""
    g, b, of_source = factor[:, None], offset[:, None], offset[None, :]
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


def faults(target: Target, way: Way) -> tuple[Fault, ...]:
    """Return what a way changes, in words."""
    names = tuple(target.elements)
    found = [(mistake, names) for mistake in way.mistakes]
    moved = np.flatnonzero(way.order != np.arange(len(names)))
    if moved.size:
        order = [names[i] for i in way.order]
        text = "has " + ", ".join(f"{order[j]} where {names[j]} belongs" for j in moved)
        fix = f"the robot's order is [{', '.join(order)}]; reorder it as described"
        found.append((Mistake("permutation", text, fix), tuple(names[j] for j in moved)))
    turned = tuple(names[j] for j in np.flatnonzero(way.slope * way.factor < 0))
    if turned:
        listed = ", ".join(turned)
        text = f"has the wrong sign at {listed}"
        found.append((Mistake("sign", text, f"negate {listed}"), turned))
    for j, (name, option) in enumerate(zip(names, way.option, strict=True)):
        if option in SHIFTED:
            value = float(way.shift[j] / way.slope[j] - way.offset[j])
            text = f"at {name} is off by {value:+.4g} before scaling"
            fix = "correct this joint's zero or its default pose"
            found.append((Mistake("offset", text, fix, value), (name,)))
        if option == SCALED:
            ratio = float(way.slope[j] / way.factor[j])
            found.append((_scaled(f"at {name} ", ratio), (name,)))
    return tuple(
        Fault(one.fault, target.place(of), f"{target.name} {one.text}", one.fix, one.value)
        for one, of in found
    )
