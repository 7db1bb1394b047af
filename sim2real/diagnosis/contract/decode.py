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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import linear_sum_assignment

from sim2real.diagnosis.contract.rebuild import Variant
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.ways import (
    AT_OWN,
    Change,
    Gain,
    Moments,
    Pose,
    Target,
    Way,
    changes,
    gains,
    options,
    poses,
)
from sim2real.diagnosis.settings import Contract

HUGE = 1e30  # nats: a way that is none


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
        unseen: elements that have too few rows to be compared.
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
    unseen: tuple[str, ...] = ()
    age_open: bool = False


def decode(target: Target, ways: Sequence[Variant], rows: Rows, limits: Contract) -> Decoded:
    """Find how a term was made.

    Args:
        target: the logged numbers.
        ways: their sources; the first is the described one.
        rows: the rows of both.
        limits: when a change is named.
    """
    use = rows.deep(limits.ages_max)
    kept = np.abs(target.values) < target.clip * (1 - limits.floor)
    kept = np.repeat(np.all(kept, axis=1)[:, None], kept.shape[1], axis=1)
    if target.apart is not None:
        kept &= ~target.apart
    use = use[kept[use].any(axis=1)]
    kept = kept[use] & (kept[use].sum(axis=0) >= limits.rows_few)
    if kept.sum() < limits.rows_min or len(use) < limits.rows_min:
        return Decoded(unseen=tuple(target.elements))
    search = _Search(target, rows, use, kept, limits)
    plain = search.described(ways[0])
    misfit = search.misfit(plain)
    blind = search.blind(plain)
    if misfit.max() <= limits.suspect:
        return replace(blind, left=float(misfit.max()))
    every = search.every(ways)
    best = min(every, key=lambda way: way.score)
    return search.judged(plain, best, every, blind)


class _Search:
    def __init__(
        self, target: Target, rows: Rows, use: np.ndarray, kept: np.ndarray, limits: Contract
    ) -> None:
        """Take the rows `use` (n,); of these each number is compared where `kept` (n, k)."""
        self.target, self.rows, self.use, self.limits = target, rows, use, limits
        self.logged = target.values[use]
        self.weight = kept / np.maximum(kept.sum(axis=0), 1)  # (n, k)
        self.seen: np.ndarray = np.asarray(kept.any(axis=0))  # (k,)
        spread = self._std(self.logged)
        self.rounding = target.rounding(spread)  # (k,)
        self.spread = np.maximum(spread, limits.still * np.abs(target.scale))  # (k,)

    def _mean(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of each number (n, k) over the rows in which it is compared, (k,)."""
        return np.sum(self.weight * values, axis=0)

    def _std(self, values: np.ndarray) -> np.ndarray:
        return np.sqrt(self._mean((values - self._mean(values)) ** 2))

    def described(self, way: Variant) -> Way:
        """Return the described way."""
        gain, pose = gains(self.target, None, 1.0)[0], poses(way)[0]
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
            factors = gains(self.target, moments, self.limits.free_price, way.offset * self.seen)
            made += [
                self._way(way, age, gain, pose, moments)
                for gain in factors
                for pose in poses(way, self.target.scale / gain.factor)
            ]
        return made

    def predict(self, way: Way) -> np.ndarray:
        """Return the numbers as a way makes them, (n, k)."""
        source = self.rows.older(way.variant.values, way.age)[self.use]
        return way.slope * source[:, way.order] + way.shift

    def misfit(self, way: Way) -> np.ndarray:
        """Return the RMS misfit of each number, relative to its spread, (k,)."""
        made = self.predict(way)
        spread = np.maximum(self.spread, self._std(made))
        square = self._mean((self.logged - made) ** 2) - self.rounding
        return np.sqrt(np.maximum(square, 0.0)) / spread

    def blind(self, plain: Way) -> Decoded:
        """Return what the log cannot show even if the interface is intact, and nothing else."""
        names, limits = self.target.elements, self.limits
        source = self.rows.older(plain.variant.values, plain.age)[self.use]
        still = self._std(source) < limits.still
        likeness = _likeness(source, plain.variant.offset, self.target.scale, limits)
        pairs = (likeness < limits.alike) & ~still[:, None] & ~still
        age = plain.age + 1
        later = self._way(plain.variant, age, plain.gain, plain.pose,
                          self._moments(plain.variant, age), exact=True)  # fmt: skip
        return Decoded(
            static=tuple(n for n, s in zip(names, still & self.seen, strict=True) if s),
            unseen=tuple(n for n, s in zip(names, self.seen, strict=True) if not s),
            exchangeable=tuple(tuple(names[i] for i in g) for g in _groups(pairs)),
            age_open=bool(not still.all() and later.score - plain.score < limits.alike),
        )

    def judged(self, plain: Way, best: Way, every: Sequence[Way], blind: Decoded) -> Decoded:
        """Return the changes of the best way, if they explain enough."""
        before, after = self.misfit(plain), self.misfit(best)
        limits = self.limits
        wrong = before > limits.suspect
        old, new = (float(np.sqrt(np.mean(m[wrong] ** 2))) for m in (before, after))
        found = changes(self.target, best)
        if not found or new > min(limits.margin * old, limits.left_max):
            return replace(blind, before=old, after=old, left=float(before.max()))
        near = [w for w in every if w is not best and w.score - best.score < limits.alike]
        near += self._reordered(best)
        others = dict.fromkeys(changes(self.target, w) for w in sorted(near, key=lambda w: w.score))
        others.pop(found, None)
        late = any(one.fault == "age" for one in found)
        return replace(
            blind,
            changes=found,
            before=old,
            after=new,
            left=float(after.max()),
            sure=self._sure(plain, best, wrong),
            others=tuple(others),
            age_open=blind.age_open and not late,
        )

    def _moments(self, way: Variant, age: int) -> Moments:
        source = self.rows.older(way.values, age)[self.use]
        middle = source.mean(axis=0)  # taken off first, for the digits
        mean, off, weight = self._mean(self.logged), source - middle, self.weight.T
        around = weight @ off  # (k, k): number j, source i
        var = np.maximum(weight @ off**2 - around**2, 0.0)
        cov = (self.weight * (self.logged - mean)).T @ off
        source_mean = around + middle * self.seen[:, None]
        return Moments(mean, self._std(self.logged) ** 2, source_mean, var, cov)

    def _way(
        self, way: Variant, age: int, gain: Gain, pose: Pose, moments: Moments, exact: bool = False
    ) -> Way:
        """Return the best order and options of the single numbers; `exact`: none of them."""
        limits, k = self.limits, len(self.target.elements)
        slope, shift, price = options(gain, pose, moments, limits.free_price)
        mse = (
            moments.var[:, None]
            - 2 * slope * moments.cov
            + slope**2 * moments.source_var
            + (moments.mean[:, None] - slope * moments.source_mean - shift) ** 2
            - self.rounding[:, None]
        )
        relative = np.maximum(mse, 0.0) / (self.spread**2)[:, None] + limits.floor**2
        fit = limits.effective_rows / 2 * np.log(relative) * self.seen[:, None]
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
        limits, scale = self.limits, np.sqrt(self.weight * len(self.use)) / self.spread
        errors = [
            np.sum((scale * (self.logged - self.predict(way)))[:, wrong] ** 2, axis=1)
            for way in (plain, best)
        ]
        blocks = np.array_split(np.arange(len(self.use)), limits.blocks)
        sums = np.array([[error[b].sum() for b in blocks] for error in errors])  # (2, blocks)
        rng = np.random.default_rng(0)
        drawn = rng.integers(limits.blocks, size=(limits.draws, limits.blocks))
        old, new = sums[:, drawn].sum(axis=-1)  # (draws,) each
        return float(np.mean(new <= limits.margin**2 * old))


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
