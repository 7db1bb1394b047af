"""Many joints wrong at once: one kind of effect at every joint, fitted side by side.

    if is_spread(search, found):
        found = by_family(search, found)

An arm whose gains and frictions were all guessed has several causes at each joint. Added one by
one, none closes enough of the whole gap to matter, and four are too few. So one kind of effect (a
family: `position_gain` at every joint) is tried at all joints in the same simulations, each joint
choosing its own value by its own error; the family that does best on held-out windows joins, with
all values fitted together; a joint that does not gain by it leaves it. The first to join are gains
of position and speed with dry and viscous friction, or with another family: a servo that is too
stiff, rubs too little and is damped too much looks like many things, and like none of these alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from envs.effects import Effect
from envs.effects.base import PLAIN
from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import Fit, refine
from sim2real.diagnosis.attribution.liveliest import lively
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.attribution.quantify import without
from sim2real.diagnosis.data.score import Blocks

STIFFNESS = 0  # rank of the effect that pairs are made with
STARTED, FAMILY = 0.3, 0.12  # shares of the work, for the progress
Family = tuple[Candidate, ...]


def is_spread(search: Search, found: Found) -> bool:
    """Return whether single effects leave much of a gap, and leave it at many joints."""
    square = search.problem.data.mean_squares(found.error)
    limits = search.problem.data.settings.joint_groups
    many = (np.sqrt(square) > limits.joint_floors * search.floor).sum() >= limits.joints_min
    return bool(many) and search.closed(search.blocks.rms(found.error)) < limits.poor


def by_family(search: Search, found: Found) -> Found:
    """Return what a search by families came to, if that is better than what was found."""
    better = _Families(search, search.rng.spawn(1)[0]).run()
    gain = search.blocks.rms(found.error) - search.blocks.rms(better.error)
    better_by = search.problem.data.settings.joint_groups.better
    if gain < better_by * (search.before - search.floor):
        search.keep(found, found.fit, found.error)
        return found
    return replace(better, guesses=found.guesses, singles=found.singles)


def families(search: Search) -> dict[str, Family]:
    """Return the candidates at joints and their actuators, by kind: name, side and variant."""
    limits = search.problem.data.settings.joint_groups
    found: dict[str, list[Candidate]] = {}
    for option in search.options:
        if option.joint is not None and option.effect.place in ("joint", "actuator"):
            kind = option.label.replace(f".{option.effect.where}", "")
            found.setdefault(kind, []).append(_coarse(option, limits.coarse))
    return {
        kind: tuple(members) for kind, members in found.items() if len(members) >= limits.joints_min
    }


def _coarse(option: Candidate, factors: Sequence[float]) -> Candidate:
    """Return a candidate that starts from orders of magnitude too, where it is a factor."""
    if option.effect.hows[0] != "scale" or len(option.neutral) != 1:
        return option
    more = np.array([[factor] for factor in factors if option.low[0] <= factor])
    return replace(option, probes=np.concatenate([more, option.probes]))


class _Families:
    """The state of a search by families."""

    def __init__(self, search: Search, rng: np.random.Generator) -> None:
        self.search, self.blocks, self.rng = search, search.blocks, rng
        self.left = families(search)
        self.order = [joint.name for joint in search.problem.data.joints]
        self.limits = search.problem.data.settings.joint_groups
        # Where families and joints are compared with each other: fewer windows than the verdict's.
        chosen = lively(search.problem.data, search.base, self.limits.windows_s)
        self.judge = search.problem.subset(chosen)
        seconds = search.blocks.seconds
        self.judged = Blocks(search.problem.data, self.judge.windows, rng, seconds)

    def run(self) -> Found:
        """Add families while they help."""
        search = self.search
        found = Found(search.none, search.base)
        while len(found.steps) < self.limits.families_max:
            kinds = self.choices(found.fit)
            promises = [partial(self.promise, search.racing, c, found.fit) for c in kinds]
            done = search.problem.simulator.together(promises)
            gains = {c: gain for c, (gain, _) in zip(kinds, done, strict=True)}
            ranked = sorted(kinds, key=lambda choice: -gains[choice])[: self.limits.tried]
            tried = []
            for choice in ranked:
                told = " and ".join(choice)
                share = STARTED + FAMILY * len(found.steps)
                search.say(f"fitting {told} at every joint", share)
                members = (*found.fit.members, *self.members(choice))
                start = self.promise(self.judge, choice, found.fit)[1]
                fit = self.settled(members, start, range(self.limits.rounds))
                tried.append((choice, fit, self.gap(fit)))
            if not tried:
                break
            choice, fit, _ = min(tried, key=lambda one: one[2])
            first = self.limits.rounds
            rounds = range(first, first + self.limits.further_rounds)
            fit = self.settled(fit.members, fit.values, rounds)
            if not self.joins(choice, fit, found):
                break
        return found

    def choices(self, fit: Fit) -> list[tuple[str, ...]]:
        """Return what may join: first a gain with what goes with it, then every family."""
        single: list[tuple[str, ...]] = [(kind,) for kind in self.left]
        plain = [kind for kind, family in self.left.items() if family[0].group == PLAIN]
        every = {kind: self.effect(kind).servo_rank for kind in plain}
        ranks = {kind: rank for kind, rank in every.items() if rank is not None}
        servo = tuple(sorted(ranks, key=ranks.__getitem__))
        if fit.members or not servo or ranks[servo[0]] != STIFFNESS:
            return single
        others = [kind for kind in plain if kind not in servo and "offset" not in kind]
        return [servo, *((servo[0], kind) for kind in others)]

    def effect(self, kind: str) -> Effect:
        """Return one of the effects of a family."""
        return self.left[kind][0].effect

    def members(self, choice: tuple[str, ...]) -> Family:
        """Return the candidates of some families."""
        return tuple(member for kind in choice for member in self.left[kind])

    def settled(self, members: Family, start: np.ndarray, rounds: Iterable[int]) -> Fit:
        """Return members whose values every joint sought by itself, all in the same simulations.

        A joint's values are multiplied by random factors about the best so far, less random from
        round to round, and the best by its own error stay: no joint has to wait for another. What
        is added to the model's own is multiplied together with that.

        Args:
            members: the effects.
            start: their values, (2, P).
            rounds: their numbers, of `points` simulations each.
        """
        best, low, high = (
            start.copy(),
            *(np.concatenate([getattr(m, end) for m in members]) for end in ("low", "high")),
        )
        zero = np.where(np.isfinite(low) & (low < 0), low, 0.0)
        own = self.joints_of(members)  # (P,)
        least = self.squares(self.judge, members, best[None])[0]  # (2, M)
        for number in rounds:
            spread = self.limits.spread * self.limits.shrink**number
            factors = np.exp(spread * self.rng.standard_normal((self.limits.points, *best.shape)))
            points = np.clip(zero + (best - zero) * factors, low, high)
            squares = self.squares(self.judge, members, points)  # (K, 2, M)
            for f in range(FOLDS):
                for joint in range(len(self.order)):
                    k = int(squares[:, f, joint].argmin())
                    if squares[k, f, joint] < least[f, joint]:
                        least[f, joint] = squares[k, f, joint]
                        best[f, own == joint] = points[k, f, own == joint]
        return Fit(tuple(members), best, least.sum(axis=1))

    def joints_of(self, members: Family) -> np.ndarray:
        """Return the number of each parameter's joint, (P,)."""
        return np.concatenate(
            [np.full(len(m.neutral), self.order.index(str(m.joint))) for m in members]
        )

    def gap(self, fit: Fit) -> float:
        """Return the held-out gap of a fit on the windows where families are compared."""
        return self.judged.rms(self.judge.held_out(fit.members, fit.values))

    def joins(self, choice: tuple[str, ...], fit: Fit, found: Found) -> bool:
        """Let families join, fitted on more windows, without the joints that gain nothing."""
        search = self.search
        fit = self.pruned(fit)
        if len(fit.members) <= len(found.fit.members):
            return False
        fit = refine(self.judge, fit.members, fit.values[None], self.limits.final_rounds)
        error = search.problem.held_out(fit.members, fit.values)
        fall = self.blocks.rms(found.error) - self.blocks.rms(error)
        floors, room = search.settings.worth_floors, search.before - search.floor
        least = max(floors * search.floor, self.limits.worth * room)
        if fall < least or self.blocks.gain(found.error, error)[0] <= 0:
            return False
        self.leave_out({self.left[kind][0].name for kind in choice})
        search.keep(found, fit, error)
        found.steps.append((" and ".join(choice), error))
        return self.blocks.rms(error) > search.least

    def leave_out(self, names: set[str]) -> None:
        """Let no variant of effects join any more: one joint has no two springs or offsets."""
        self.left = {kind: own for kind, own in self.left.items() if own[0].name not in names}

    def pruned(self, fit: Fit) -> Fit:
        """Return the fit without members that do nothing on held-out windows.

        Whether the others are worth their price is told in the end (`parsimony`).
        """
        whole, every = self.gap(fit), range(len(fit.members))
        rests = [without(fit, [i for i in every if i != n]) for n in every]
        falls = [self.judged.rms(e) - whole for e in self.judge.held_out_each(rests)]
        return without(fit, [n for n in every if falls[n] > 0])

    def promise(
        self, problem: Problem, choice: tuple[str, ...], fit: Fit
    ) -> tuple[float, np.ndarray]:
        """Return the square that families should remove, and where a fit of them starts, (2, P).

        Every joint takes the probes that do best on its own error; what that removes is told from
        the probes that do best in the other fold.
        """
        groups = [self.left[kind] for kind in choice]
        counts = [max(len(member.probes) for member in family) for family in groups]
        ties = [self.effect(kind).tied for kind in choice]
        tied = [[i for i, tie in enumerate(ties) if tie == one] for one in set(ties) - {""}]
        grid = [
            None,
            *(g for g in np.ndindex(*counts) if all(len({g[i] for i in t}) <= 1 for t in tied)),
        ]
        points = np.stack([self.point(groups, fit, probes) for probes in grid])
        members = (*fit.members, *self.members(choice))
        squares = self.squares(problem, members, points)  # (K + 1, 2, M)
        best = squares.argmin(axis=0)  # (2, M)
        joints = range(len(self.order))
        gain = sum(
            float(squares[0, f, j] - squares[best[1 - f, j], f, j])
            for f in range(FOLDS)
            for j in joints
        )
        both = squares.sum(axis=1).argmin(axis=0)  # (M,)
        start, new = points[0].copy(), np.arange(points.shape[2]) >= fit.values.shape[1]
        for joint in joints:
            own = new & (self.joints_of(members) == joint)
            start[:, own] = points[both[joint]][:, own]
        return gain, start

    def point(self, groups: list[Family], fit: Fit, probes: tuple[int, ...] | None) -> np.ndarray:
        """Return what was found with each family at one of its probes, (2, P); None is neutral."""
        values = [
            member.neutral if probes is None else member.probes[min(probe, len(member.probes) - 1)]
            for family, probe in zip(groups, probes or [0] * len(groups), strict=True)
            for member in family
        ]
        return np.concatenate([fit.values, np.tile(np.concatenate(values), (FOLDS, 1))], axis=1)

    def squares(
        self, problem: Problem, members: tuple[Candidate, ...], points: np.ndarray
    ) -> np.ndarray:
        """Return the summed square error of each point, fold and joint, (K, 2, M)."""
        error, _ = problem.errors(members, points)
        summed = (error**2).sum(axis=2)  # (K, W, M)
        return np.stack([summed[:, problem.fold == f].sum(axis=1) for f in range(FOLDS)], axis=1)
