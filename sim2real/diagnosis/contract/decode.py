"""How logged numbers were made of the channels they should be made of.

    stage = decode(target, variants, rows, limits)
    stage.findings                      # [] where the described way explains the log
    stage.cannot_tell, stage.checked    # what this log cannot tell, and the misfit that is left

Number j of a term is modelled as gain_j (x_i(t - age) + offset_j), with one element i for each j.
The described way has i = j and the described gain, offset and age. Everything else is a change, and
each change has a price: of all ways, the one is taken whose log likelihood less its prices is best,
    sum_j -N/2 ln(misfit_j² + floor²) - price x changes,
which only a change that halves the misfit of a number can win. All misfits follow from means and
covariances, so that thousands of ways are compared at once.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations, product

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from sim2real.diagnosis.contract.answer import Fault, Finding, Stage
from sim2real.diagnosis.contract.rebuild import Variant
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.ways import (
    Choice,
    Moments,
    Target,
    Way,
    faults,
    gains,
    late,
    options,
    poses,
)
from sim2real.diagnosis.settings import Contract

FEW = "too few rows to compare"
TIMED = ("rate", "filter")  # mistakes that are tried at the described age alone


def decode(target: Target, ways: Sequence[Variant], rows: Rows, limits: Contract) -> Stage:
    """Find how the logged numbers of a term were made; the first of the ways is as described."""
    stage, search = Stage(), Search(target, rows, limits)
    if not search.seen.any():
        stage.open(f"{target.name}: {', '.join(target.elements)}", FEW)
        return stage
    plain = search.described(ways[0])
    left = float(search.misfit(plain).max())
    if left > limits.suspect:
        stage.findings, left = search.findings(plain, search.every(ways))
    if search.blind(plain, stage):
        stage.checked[f"{target.stage}: {target.name}"] = left
    return stage


class Search:
    """The ways in which a term may have been made, compared with its logged numbers; see `decode`.

    A row in which a number was clipped is left out, and so is a number of which few rows are left.
    """

    def __init__(self, target: Target, rows: Rows, limits: Contract) -> None:
        self.target, self.rows, self.limits = target, rows, limits
        whole = np.all(np.abs(target.values) < target.clip * (1 - limits.suspect), axis=1)
        kept = whole[:, None] & ~np.broadcast_to(target.apart, target.values.shape)  # (T, k)
        deep = rows.deep(limits.ages_max)
        self.use = deep[kept[deep].any(axis=1)]  # (n,)
        kept = kept[self.use] & (kept[self.use].sum(axis=0) >= limits.rows_few)  # (n, k)
        kept &= min(kept.sum(), len(kept)) >= limits.rows_min
        self.logged = target.values[self.use]
        self.weight = kept / np.maximum(kept.sum(axis=0), 1)  # (n, k)
        self.seen: np.ndarray = np.asarray(kept.any(axis=0))  # (k,)
        spread = self._std(self.logged)
        self.rounding = np.full_like(spread, target.resolution**2 / 4)  # (k,) half a step at most
        self.spread = np.maximum(spread, limits.still * np.abs(target.scale))  # (k,)

    def _mean(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of each number (n, k) over the rows in which it is compared, (k,)."""
        return np.sum(self.weight * values, axis=0)

    def _std(self, values: np.ndarray) -> np.ndarray:
        return np.sqrt(self._mean((values - self._mean(values)) ** 2))

    def _source(self, way: Variant, age: int) -> np.ndarray:
        return self.rows.older(way.values, age)[self.use]

    def every(self, ways: Sequence[Variant]) -> list[Way]:
        """Return the best way of each variant, age, gain and pose."""
        made, limits = [], self.limits
        for way, age in product(ways, range(limits.ages_max + 1)):
            if age != way.age and way.mistake and way.mistake.fault in TIMED:
                continue
            moments = self._moments(way, age)
            for gain in gains(self.target, moments, limits.free_price, way.offset * self.seen):
                for pose in poses(way, self.target.scale / gain[1]):
                    made.append(self._fitted(way, age, gain, pose, moments))
        return made

    def misfit(self, way: Way) -> np.ndarray:
        """Return the RMS misfit of each number, relative to its spread, (k,)."""
        made = self._predict(way)
        spread = np.maximum(self.spread, self._std(made))
        square = self._mean((self.logged - made) ** 2) - self.rounding
        return np.sqrt(np.maximum(square, 0.0)) / spread

    def _predict(self, way: Way) -> np.ndarray:
        """Return the numbers as a way makes them, (n, k)."""
        return way.slope * self._source(way.variant, way.age)[:, way.order] + way.shift

    def blind(self, plain: Way, stage: Stage) -> bool:
        """Add what the log cannot show even if the interface is intact; False: it shows nothing."""
        names, limits = np.array(self.target.elements, object), self.limits
        source = self._source(plain.variant, plain.age)
        still = self._std(source) < limits.still
        likeness = _likeness(source, plain.variant.offset, self.target.scale, limits)
        alike = (likeness < limits.alike) & ~still[:, None] & ~still
        group = connected_components(alike, directed=False)[1]
        groups = [group == number for number in range(group.max() + 1)]
        static = "did not move: order, sign, scale and age are unknown"
        for which, text in (
            (still & self.seen, static),
            (~self.seen, FEW),
            *((one, "moved alike: their order is unknown") for one in groups if one.sum() > 1),
        ):
            if which.any():
                stage.open(f"{self.target.name}: {', '.join(names[which])}", text)
        now, later = (self.misfit(way) ** 2 for way in (plain, plain._replace(age=plain.age + 1)))
        told = float((self._nats(later) - self._nats(now))[self.seen].sum())
        if not still.all() and not stage.findings and told < limits.alike:
            stage.open(self.target.name, "changes too slowly for its age to be known to a step")
        return bool((self.seen & ~still).any())

    def findings(self, plain: Way, every: Sequence[Way]) -> tuple[list[Finding], float]:
        """Return the changes of the best way, if they explain enough, and what misfit is left."""
        limits, target, best = self.limits, self.target, min(every, key=lambda way: way.score)
        before, after = self.misfit(plain), self.misfit(best)
        wrong = before > limits.suspect
        old, new = (float(np.sqrt(np.mean(m[wrong] ** 2))) for m in (before, after))
        changed, made = faults(target, best), []
        if changed and new <= min(limits.margin * old, limits.left_max):
            near = [way for way in every if way.score - best.score < limits.alike]
            near = sorted([*near, *self._reordered(best)], key=lambda way: way.score)
            others = dict.fromkeys(faults(target, way) for way in near)
            sure = self._sure(plain, best, wrong)
            for one in changed:
                fault = target.stage, one.fault, one.where, one.text, one.fix
                rivals = _rivals(one, changed, others)
                made.append(Finding(*fault, old, new, sure, one.value, rivals))
        left = float((after if made else before).max())
        if left > limits.unexplained:
            text = (
                f"{target.name} differs from what the description makes of the log by {left:.0%} "
                "of its spread, and no fault that is looked for explains it"
            )
            fix = "compare the code that fills it with the training's, or correct the description"
            fault = target.stage, "unexplained", target.name, text, fix
            made.append(Finding(*fault, old, left))
        return made, left

    def _moments(self, way: Variant, age: int) -> Moments:
        source = self._source(way, age)
        middle = source.mean(axis=0)  # taken off first, for the digits
        mean, off, weight = self._mean(self.logged), source - middle, self.weight.T
        around = weight @ off  # (k, k): number j, source i
        var = np.maximum(weight @ off**2 - around**2, 0.0)
        cov = (self.weight * (self.logged - mean)).T @ off
        source_mean = around + middle * self.seen[:, None]
        return Moments(mean, self._std(self.logged) ** 2, source_mean, var, cov)

    def described(self, way: Variant) -> Way:
        """Return a variant with the described age, gain, pose and order."""
        scale, order = self.target.scale, np.arange(len(self.spread))
        whole = way, way.age, scale, way.offset, ()
        return Way(*whole, 0.0, order, 0 * order, np.diag(0.0 * order), scale, scale * way.offset)

    def _nats(self, square: np.ndarray) -> np.ndarray:
        """Return the negative log likelihood of numbers with square misfits."""
        return self.limits.rows_min / 2 * np.log(square + self.limits.suspect**2)

    def _fitted(self, way: Variant, age: int, gain: Choice, pose: Choice, moments: Moments) -> Way:
        """Return the best order and options of the single numbers."""
        limits, factor, offset = self.limits, gain[1], pose[1]
        slope, shift, price = options(factor, offset, moments, limits.free_price)
        mse = (
            moments.var[:, None]
            - 2 * slope * moments.cov
            + slope**2 * moments.source_var
            + (moments.mean[:, None] - slope * moments.source_mean - shift) ** 2
            - self.rounding[:, None]
        )
        fit = self._nats(np.maximum(mse, 0.0) / self.spread[:, None] ** 2) * self.seen[:, None]
        j = np.arange(len(self.spread))
        total = fit + limits.price * price[:, None, None]
        option = np.argmin(total, axis=0)  # (k, k), the first of equal ones
        scores = np.min(total, axis=0) + limits.price * (j[:, None] != j)
        order = linear_sum_assignment(scores)[1]
        chosen = option[j, order]
        mistakes = tuple(filter(None, (way.mistake, late(age - way.age), gain[0], pose[0])))
        paid = sum(mistake.price for mistake in mistakes)
        score = float(scores[j, order].sum() + limits.price * paid)
        slope, shift = slope[chosen, j, order], shift[chosen, j, order]
        whole = way, age, factor, offset, mistakes
        return Way(*whole, score, order, chosen, scores, slope, shift)

    def _reordered(self, best: Way) -> list[Way]:
        """Return the best way with two sources exchanged, where it then fits as well."""
        made, rows = [], np.arange(len(best.order))
        fit = best.scores - self.limits.price * (rows[:, None] != rows)
        for a, b in combinations(rows, 2):
            order = best.order.copy()
            order[[a, b]] = order[[b, a]]
            change = (fit[rows, order] - fit[rows, best.order]).sum()
            if change < self.limits.alike:
                made.append(best._replace(order=order, score=best.score + change))
        return made

    def _sure(self, plain: Way, best: Way, wrong: np.ndarray) -> float:
        """Return the share of resampled blocks of rows in which the changes explain enough."""
        limits, scale = self.limits, np.sqrt(self.weight * len(self.use)) / self.spread
        errors = [
            np.sum((scale * (self.logged - self._predict(way)))[:, wrong] ** 2, axis=1)
            for way in (plain, best)
        ]
        blocks = np.array_split(np.arange(len(self.use)), limits.rows_min)
        sums = np.array([[error[b].sum() for b in blocks] for error in errors])  # (2, blocks)
        rng = np.random.default_rng(0)
        drawn = rng.integers(limits.rows_min, size=(limits.draws, limits.rows_min))
        old, new = sums[:, drawn].sum(axis=-1)  # (draws,) each
        return float(np.mean(new <= limits.margin**2 * old))


def _likeness(
    source: np.ndarray, offset: np.ndarray, scale: np.ndarray, limits: Contract
) -> np.ndarray:
    """Return by how many nats the log speaks against exchanging two elements, (k, k)."""
    made = scale * (source + offset)
    spread = np.maximum(made.std(axis=0), limits.still * np.abs(scale))
    apart = np.mean((made[:, :, None] - made[:, None, :]) ** 2, axis=0) / spread[:, None] ** 2
    return limits.rows_min / 2 * np.log(apart / limits.suspect**2 + 1)


def _rivals(
    one: Fault, changed: Sequence[Fault], others: Iterable[Sequence[Fault]]
) -> tuple[Fault, ...]:
    """Return what stands in other ways in the place of a fault of the best one."""
    rivals = {
        (o.fault, o.where, o.text): o
        for other in others
        if not any(one.same(o) for o in other)
        for o in other
        if not any(o.same(own) for own in changed)
    }
    return tuple(rivals.values())
