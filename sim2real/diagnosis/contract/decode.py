"""How logged numbers were made of the channels they should be made of.

    found = decode(target, variants, rows, limits)
    found.changes                       # [] where the described way explains the log
    found.static, found.exchangeable    # what this log cannot tell

Number j of a term is modelled as gain_j (x_i(t - age) + offset_j), with one element i for each j.
The described way has i = j and the described gain, offset and age. Everything else is a change, and
each change has a price: of all ways, the one is taken whose log likelihood less its prices is best,
    sum_j -N/2 ln(misfit_j² + floor²) - price x changes,
which only a change that halves the misfit of a number can win. All misfits follow from means and
covariances, so that thousands of ways are compared at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from sim2real.diagnosis.contract.rebuild import Variant
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.settings import Contract

DEGREES = 180.0 / np.pi
TWICE = 2.0
HUGE = 1e30  # nats: a way that is none


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
    """

    name: str
    elements: Sequence[str]
    values: np.ndarray
    scale: np.ndarray
    angular: bool
    clip: float = np.inf
    flipped: str = "sign"


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


@dataclass(frozen=True)
class Decoded:
    """What was found of one term.

    Attributes:
        changes: from the described way to the one that explains the log; empty where none is
            needed, or none explains it.
        before: misfit of the described way, RMS of the numbers' spread, over suspect numbers.
        after: that of the way with the changes; `before` where there are none.
        left: the largest misfit of a single number that stays.
        sure: share of resamples in which the changes leave less than the margin.
        others: changes of other ways that explain the log as well.
        static: elements that did not move enough to judge order, sign, scale and age.
        exchangeable: groups of elements that the log cannot tell apart.
        age_open: whether an age one step off explains the log as well.
    """

    changes: tuple[Change, ...] = ()
    before: float = 0.0
    after: float = 0.0
    left: float = 0.0
    sure: float = 1.0
    others: tuple[tuple[Change, ...], ...] = ()
    static: tuple[str, ...] = ()
    exchangeable: tuple[tuple[str, ...], ...] = ()
    age_open: bool = False


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
    """Means and covariances of logged numbers and a source."""

    mean: np.ndarray  # of the log, (k,)
    var: np.ndarray
    source_mean: np.ndarray  # (k,)
    source_var: np.ndarray
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


# how one number may be made, in the order of `_Search._options`; gain g, offset b of its own place
# or c of the element that it shows: g(x+b), g(x+c), -g(x+b), g(b-x), gx + free, free g(x+b),
# -gx + free, -g(x+c), g(c-x)
AT_OWN = (1, 7, 8)  # differ from others only where the order does
SIGNED = (2, 3, 6, 7, 8)
SHIFTED, SCALED = (4, 6), 5


def decode(target: Target, ways: Sequence[Variant], rows: Rows, limits: Contract) -> Decoded:
    """Find how a term was made.

    Args:
        target: the logged numbers.
        ways: their sources; the first is the described one.
        rows: the rows of both.
        limits: when a change is named.
    """
    use = rows.deep(limits.ages_max)
    kept = np.all(np.abs(target.values) < target.clip * (1 - limits.floor), axis=1)
    use = use[kept[use]]
    if len(use) < limits.rows_min:
        return Decoded(static=tuple(target.elements))
    search = _Search(target, rows, use, limits)
    plain = search.described(ways[0])
    misfit = search.misfit(plain)
    blind = search.blind(plain)
    if misfit.max() <= limits.suspect:
        return Decoded(left=float(misfit.max()), **blind)
    every = search.every(ways)
    best = min(every, key=lambda way: way.score)
    return search.judged(plain, best, every, blind)


class _Search:
    def __init__(self, target: Target, rows: Rows, use: np.ndarray, limits: Contract) -> None:
        self.target, self.rows, self.use, self.limits = target, rows, use, limits
        self.logged = target.values[use]
        least = limits.still * np.abs(target.scale)
        self.spread = np.maximum(self.logged.std(axis=0), least)  # (k,)

    def described(self, way: Variant) -> Way:
        """Return the described way."""
        gain, pose = self._gains(None)[0], _poses(way)[0]
        return self._way(way, way.age, gain, pose, self._moments(way, way.age), exact=True)

    def every(self, ways: Sequence[Variant]) -> list[Way]:
        """Return the best way of each variant, age, gain and pose."""
        made = []
        few = len(ways) <= self.limits.ways_few
        ages = range(self.limits.ages_max + 1)
        for way, age in product(ways, ages):
            if age != way.age and way.fault and not few:
                continue
            moments = self._moments(way, age)
            gains = self._gains(moments)
            made += [
                self._way(way, age, gain, pose, moments)
                for gain in gains
                for pose in _poses(way, self.target.scale / gain.factor)
            ]
        return made

    def predict(self, way: Way) -> np.ndarray:
        """Return the numbers as a way makes them, (n, k)."""
        source = self.rows.older(way.variant.values, way.age)[self.use]
        return way.slope * source[:, way.order] + way.shift

    def misfit(self, way: Way) -> np.ndarray:
        """Return each number's RMS misfit, of its spread, (k,)."""
        made = self.predict(way)
        spread = np.maximum(self.spread, made.std(axis=0))
        return np.sqrt(np.mean((self.logged - made) ** 2, axis=0)) / spread

    def blind(self, plain: Way) -> dict[str, object]:
        """Return what the log cannot tell even if all is as described."""
        names, limits = self.target.elements, self.limits
        source = self.rows.older(plain.variant.values, plain.age)[self.use]
        still = source.std(axis=0) < limits.still
        likeness = _likeness(source, plain.variant.offset, self.target.scale, limits)
        pairs = (likeness < limits.alike) & ~still[:, None] & ~still
        age = plain.age + 1
        later = self._way(plain.variant, age, plain.gain, plain.pose,
                          self._moments(plain.variant, age), exact=True)  # fmt: skip
        return {
            "static": tuple(n for n, s in zip(names, still, strict=True) if s),
            "exchangeable": tuple(tuple(names[i] for i in g) for g in _groups(pairs)),
            "age_open": bool(not still.all() and later.score - plain.score < limits.alike),
        }

    def judged(
        self, plain: Way, best: Way, every: Sequence[Way], blind: dict[str, object]
    ) -> Decoded:
        """Return the changes of the best way, if they explain enough."""
        before, after = self.misfit(plain), self.misfit(best)
        limits = self.limits
        wrong = before > limits.suspect
        old, new = (float(np.sqrt(np.mean(m[wrong] ** 2))) for m in (before, after))
        changes = self.changes(best)
        if not changes or new > min(limits.margin * old, limits.left_max):
            return Decoded((), old, old, float(before.max()), **blind)  # type: ignore[arg-type]
        near = [w for w in every if w is not best and w.score - best.score < limits.alike]
        near += self._reordered(best)
        others = dict.fromkeys(self.changes(w) for w in sorted(near, key=lambda w: w.score))
        others.pop(changes, None)
        sure = self._sure(plain, best, wrong)
        left = float(after.max())
        return Decoded(changes, old, new, left, sure, tuple(others), **blind)  # type: ignore[arg-type]

    def changes(self, way: Way) -> tuple[Change, ...]:
        """Return what a way changes, in words."""
        names, target = self.target.elements, self.target
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
            found.append(
                Change("default_pose", all_of, f"{target.name} {way.pose.text}", way.pose.fix)
            )
        return (*found, *self._of_elements(way))

    def _of_elements(self, way: Way) -> list[Change]:
        """Return order, signs, offsets and scales of single numbers."""
        names, found, name = self.target.elements, [], self.target.name
        moved = np.flatnonzero(way.order != np.arange(len(names)))
        if moved.size:
            places = tuple(names[j] for j in moved)
            read = ", ".join(f"{names[way.order[j]]} where {names[j]} belongs" for j in moved)
            order = [names[way.order[j]] for j in range(len(names))]
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

    def _moments(self, way: Variant, age: int) -> Moments:
        source = self.rows.older(way.values, age)[self.use]
        mean, source_mean = self.logged.mean(axis=0), source.mean(axis=0)
        cov = (self.logged - mean).T @ (source - source_mean) / len(source)
        return Moments(mean, self.logged.var(axis=0), source_mean, source.var(axis=0), cov)

    def _gains(self, moments: Moments | None) -> list[Gain]:
        """Return the factors that a whole term may have, the described one first."""
        scale, flipped = self.target.scale, self.target.flipped
        found = [Gain("", "", "", scale, 0.0)]
        if moments is None:
            return found
        text = "points the other way" if flipped != "sign" else "has the wrong sign everywhere"
        found.append(Gain(flipped, text, "negate it", -scale, 1.0))
        if self.target.angular:
            found.append(Gain("unit", "is in degrees", "convert it to rad", scale * DEGREES, 1.0))
            again = "was converted from degrees to rad twice"
            found.append(Gain("unit", again, "convert it once", scale / DEGREES, 1.0))
        if not np.allclose(scale, 1.0):
            once = "was not multiplied by its scale"
            found.append(Gain("scale", once, "multiply it by its scale", np.ones_like(scale), 1.0))
            twice = "was multiplied by its scale twice"
            found.append(Gain("scale", twice, "multiply it once", scale**2, 1.0))
        power = float(np.sum(scale**2 * moments.source_var))
        if power > 0:
            ratio = float(np.sqrt(moments.var.sum() / power))
            text = f"is {ratio:.4g} times as large as described"
            fix, price = f"divide it by {ratio:.4g}", self.limits.free_price
            found.append(Gain("scale", text, fix, scale * ratio, price, ratio))
        return found

    def _way(
        self, way: Variant, age: int, gain: Gain, pose: Pose, moments: Moments, exact: bool = False
    ) -> Way:
        """Return the best order and options of the single numbers; `exact`: none of them."""
        limits, k = self.limits, len(self.target.elements)
        slope, shift, price = self._options(gain, pose, way.offset, moments)
        mse = (
            moments.var[:, None]
            - 2 * slope * moments.cov
            + slope**2 * moments.source_var
            + (moments.mean[:, None] - slope * moments.source_mean - shift) ** 2
        )
        relative = np.maximum(mse, 0.0) / (self.spread**2)[:, None] + limits.floor**2
        fit = limits.effective_rows / 2 * np.log(relative)
        total = fit + limits.price * price[:, None, None]
        moved = ~np.eye(k, dtype=bool)
        for place in AT_OWN:
            total[place][~moved] = HUGE
        option = np.argmin(total, axis=0)  # (k, k)
        scores = np.min(total, axis=0) + limits.price * moved
        order = np.arange(k)
        if exact:
            option, scores = np.zeros((k, k), int), fit[0]
        else:
            order = linear_sum_assignment(scores)[1]
        j = np.arange(k)
        chosen = option[j, order]
        paid = gain.price + pose.price + bool(way.fault) + (age != way.age)
        score = float(scores[j, order].sum() + limits.price * paid)
        picked = (chosen, j, order)
        return Way(way, age, gain, pose, score, order, chosen, scores, slope[picked], shift[picked])

    def _options(
        self, gain: Gain, pose: Pose, offset: np.ndarray, moments: Moments
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return slopes and shifts (options, k, k) of every option, and its price."""
        k = len(gain.factor)
        g = np.repeat(gain.factor[:, None], k, axis=1)  # (k, k)
        b = np.repeat(pose.offset[:, None], k, axis=1)
        own = np.repeat(pose.offset[None, :], k, axis=0)
        mean, x = moments.mean[:, None], moments.source_mean[None, :]
        free = mean - g * x
        against = g * (moments.cov + mean * (x + b))
        power = np.maximum(g**2 * (moments.source_var + (x + b) ** 2), np.finfo(float).tiny)
        ratio = np.maximum(against / power, 0.0)
        slope = np.stack([g, g, -g, -g, g, ratio * g, -g, -g, -g])
        ends = [g * b, g * own, -g * b, g * b, free, ratio * g * b, mean + g * x, -g * own, g * own]
        fitted = self.limits.free_price
        price = [0.0, 0.0, 1.0, 1.0, fitted, fitted, 1.0 + fitted, 1.0, 1.0]
        return slope, np.stack(ends), np.array(price)

    def _reordered(self, best: Way) -> list[Way]:
        """Return the best way with two sources exchanged, where it then fits as well."""
        made, k = [], len(best.order)
        fit = best.scores - self.limits.price * ~np.eye(k, dtype=bool)
        for a in range(k):
            for b in range(a + 1, k):
                order = best.order.copy()
                order[[a, b]] = order[[b, a]]
                rows = np.arange(k)
                change = (fit[rows, order] - fit[rows, best.order]).sum()
                if change < self.limits.alike:
                    made.append(Way(**{**vars(best), "order": order, "score": best.score + change}))
        return made

    def _sure(self, plain: Way, best: Way, wrong: np.ndarray) -> float:
        """Return the share of resampled blocks of rows in which the changes explain enough."""
        limits = self.limits
        errors = [
            np.sum(((self.logged - self.predict(way)) / self.spread)[:, wrong] ** 2, axis=1)
            for way in (plain, best)
        ]
        blocks = np.array_split(np.arange(len(self.use)), limits.blocks)
        sums = np.array([[error[b].sum() for b in blocks] for error in errors])  # (2, blocks)
        rng = np.random.default_rng(0)
        drawn = rng.integers(limits.blocks, size=(limits.draws, limits.blocks))
        old, new = sums[:, drawn].sum(axis=-1)  # (draws,) each
        return float(np.mean(new <= limits.margin**2 * old))


def _poses(way: Variant, ratio: np.ndarray | None = None) -> list[Pose]:
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


def _likeness(
    source: np.ndarray, offset: np.ndarray, scale: np.ndarray, limits: Contract
) -> np.ndarray:
    """Return by how many nats the log speaks against exchanging two elements, (k, k)."""
    made = scale * (source + offset)
    spread = np.maximum(made.std(axis=0), limits.still * np.abs(scale))
    apart = np.mean((made[:, :, None] - made[:, None, :]) ** 2, axis=0) / spread[:, None] ** 2
    return limits.effective_rows / 2 * np.log(apart / limits.floor**2 + 1)


def _groups(pairs: np.ndarray) -> list[list[int]]:
    """Return the connected groups of two and more, of a symmetric relation (k, k)."""
    left, found = set(range(len(pairs))), []
    while left:
        group, edge = set(), [min(left)]
        while edge:
            i = edge.pop()
            if i not in group:
                group.add(i)
                edge += [int(n) for n in np.flatnonzero(pairs[i] | pairs[:, i]) if n != i]
        left -= group
        found += [sorted(group)] if len(group) > 1 else []
    return found
