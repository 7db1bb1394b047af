"""Which candidates are worth a fit: how their probes change the simulation, scaled to the error.

    screening = screen(problem, found, candidates)      # beside what is found already
    for guess in screening.guesses: ...                 # promising first

A fit moves a candidate step by step; a screening looks at all of them with two or three simulations
each, and takes what lies between the probes for a straight line. With a `coarse` problem it first
glances at every probe in longer time steps: what a probe changes hardly depends on them. The best
probes of the best candidates are then simulated as they are.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from envs.effects import Effect
from envs.effects.base import PLAIN, RULES
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import Fit, columns, sensitivities
from sim2real.diagnosis.attribution.problem import FOLDS, Ask, Problem
from sim2real.diagnosis.attribution.promise import Guess, View, promises
from sim2real.diagnosis.settings import TINY_SQUARE


class Response(NamedTuple):
    """How one probe of a candidate changes the simulation of the screened windows."""

    candidate: Candidate
    probe: np.ndarray  # (P,)
    change: np.ndarray  # (W, T, M), of single precision: there are hundreds


class Screening(NamedTuple):
    """What screening found, on its windows."""

    guesses: list[Guess]  # the most promising first; those only glanced at come last
    responses: list[Response]
    base: np.ndarray  # (W, T, M) errors with what is known already
    drift: np.ndarray  # (W, T, M) their change with the clock
    offset: np.ndarray | None = None  # (W, T, M) by how much longer time steps are off; None: lost


class Kind(enum.Enum):
    """What longer time steps do to an effect: nothing, or they hide it, or they soften it."""

    LONG, SHORT, ADDED = range(3)


class _Longer(NamedTuple):
    """The same windows in longer time steps, where these keep the motion."""

    problem: Problem
    error: np.ndarray  # (W, T, M), with what is known already


class _Seen(NamedTuple):
    """What was seen of a candidate whose probes change something."""

    candidate: Candidate
    promises: list[tuple[int, Guess]]  # of each probe by its number, the best first
    changes: dict[int, np.ndarray]

    @property
    def gain(self) -> float:
        return self.promises[0][1].gain

    def responses(self, but: Sequence[int] = ()) -> list[Response]:
        """Return how its probes change the simulation, but for those of some numbers."""
        option = self.candidate
        kept = [k for k in self.changes if k not in but]
        return [Response(option, option.probes[k], self.changes[k]) for k in kept]

    def joined(self, more: _Seen) -> _Seen:
        """Return what was seen of it with further probes."""
        made = sorted([*self.promises, *more.promises], key=lambda one: -one[1].gain)
        return _Seen(self.candidate, made, self.changes | more.changes)


class _Look(NamedTuple):
    """A candidate, the numbers of its probes that are simulated, and what is known of others."""

    candidate: Candidate
    probes: Sequence[int]
    before: _Seen | None = None


def screen(
    problem: Problem,
    found: Fit,
    options: Sequence[Candidate],
    before: Sequence[Response] = (),
    coarse: Problem | None = None,
) -> Screening:
    """Return a guess for each option, the most promising first.

    A probe's change of the simulation, scaled, should be what is wrong with it, while the values of
    what is known already may follow: a servo that is too soft and rubs is first taken for one that
    rubs too much. Options that change nothing are left out.

    Args:
        problem: on the windows to look at.
        found: the effects that are known already.
        options: what may be added to them.
        before: how options changed a simulation with less or other effects known, on the same
            windows. Beside known effects, of many options only `probed_max` are looked at:
            those that would promise most if they changed this simulation as they changed that
            one, or, where nothing is known of them, as a few of their probes do.
        coarse: the same windows in longer time steps; None simulates every probe as it is.
    """
    error, slope = problem.errors(found.members, found.values[None])
    base, drift = error[0], slope[0]
    known = sensitivities(problem, found.members, found.values, base) if found.members else ()
    view = View(problem, found, base, np.array([drift, *known]))
    result = Screening([], [], base, drift)
    longer = None if coarse is None else _alike(view, coarse)
    if found.members and len(options) > problem.data.settings.screening.probed_max:
        options = _likely(view, options, before, result, longer)
    seen, rest = [], []
    looks = [_Look(option, range(len(option.probes))) for option in options]
    if longer is not None and len(options) > problem.data.settings.screening.kept_max:
        seen, looks, rest = _glance(view, options, result, longer)
    seen += _simulate(view, looks)
    for one in [*sorted(seen, key=lambda one: -one.gain), *rest]:
        result.guesses.append(one.promises[0][1])
        result.responses.extend(one.responses())
    return result if longer is None else result._replace(offset=base - longer.error)


def _alike(view: View, coarse: Problem) -> _Longer | None:
    """Return the longer steps with their errors; None where these lose the motion.

    A command acts from the next step on: they may be late.
    """
    known = [*(m.effect for m in view.found.members), *(e for e, _ in coarse.simulator.fixed)]
    if any(kind_of(effect) is Kind.ADDED for effect in known):
        return None
    error, _ = coarse.errors(view.found.members, view.found.values[None])
    change, drift, data = error[0] - view.base, view.free[0], view.problem.data
    change = change - (change * drift).sum() / max((drift**2).sum(), TINY_SQUARE) * drift
    motion = np.array([joint.spread for joint in data.joints]) / data.scale
    rows = data.mask[view.problem.windows].sum()
    most = data.settings.screening.coarse_off**2 * rows * (motion**2).sum()
    return _Longer(coarse, error[0]) if (change**2).sum() < most else None


def _glance(
    view: View,
    options: Sequence[Candidate],
    result: Screening,
    longer: _Longer,
) -> tuple[list[_Seen], list[_Look], list[_Seen]]:
    """Return who is kept and was seen as it is, what is to be simulated yet, and who is left out.

    Lags and delays may be shorter than a longer time step, and are looked at as they are. So are
    a few probes of what adds joints, which are as stiff and heavy as the time step asks.
    """
    limits = view.problem.data.settings.screening
    long, short, added = (
        [option for option in options if kind_of(option.effect) == kind] for kind in Kind
    )
    exact = _simulate(view, [_Look(option, range(len(option.probes))) for option in short])
    seen = _simulate(view, [_Look(o, range(len(o.probes))) for o in long], longer)
    seen += _simulate(view, [_Look(option, _few(option)) for option in added])
    order = sorted([*exact, *seen], key=lambda one: -one.gain)
    done, looks = [], []
    for one in order[: limits.kept_max]:
        option, best = one.candidate, [k for k, _ in one.promises[: limits.probes_kept]]
        if kind_of(option.effect) is Kind.LONG:
            looks.append(_Look(option, best))
            result.responses.extend(one.responses(but=best))
        elif left := [k for k in range(len(option.probes)) if k not in one.changes]:
            looks.append(_Look(option, left, one))
        else:
            done.append(one)
    return done, looks, order[limits.kept_max :]


def _likely(
    view: View,
    options: Sequence[Candidate],
    before: Sequence[Response],
    now: Screening,
    longer: _Longer | None,
) -> list[Candidate]:
    """Return the options that may promise most; adds how a few probes of others change it."""
    told: dict[str, dict[int, np.ndarray]] = {}
    own = {option.label: option.probes.tolist() for option in options}  # a ripple's are new ones
    for response in before:
        label, probe = response.candidate.label, response.probe.tolist()
        if probe in own.get(label, ()):
            told.setdefault(label, {})[own[label].index(probe)] = response.change
    gains = {}
    for option in options:
        if option.label in told:
            made = promises(view, option, told[option.label])
            gains[option.label] = made[0][1].gain if made else 0.0
    strangers = [_Look(o, _few(o)) for o in options if o.label not in gains]
    long = [look for look in strangers if kind_of(look.candidate.effect) is Kind.LONG]
    others = [look for look in strangers if kind_of(look.candidate.effect) is not Kind.LONG]
    glanced = _simulate(view, long, longer)
    glanced += _simulate(view, others)
    gains |= {seen.candidate.label: seen.gain for seen in glanced}
    most = view.problem.data.settings.screening.probed_max
    kept = sorted(gains, key=lambda label: -gains[label])[:most]
    for seen in glanced:
        now.responses.extend(() if seen.candidate.label in kept else seen.responses())
    return [option for option in options if option.label in kept]


def kind_of(effect: Effect) -> Kind:
    """Return what longer time steps do to an effect."""
    if effect.batch() not in (PLAIN, RULES):
        return Kind.ADDED
    return Kind.SHORT if effect.unit == "s" else Kind.LONG


def _few(option: Candidate) -> list[int]:
    """Return the numbers of an option's probes of middle size each way, with all free extras.

    Of what adds joints the largest, too: a soft spring does nothing of what a stiff one does.
    """
    added = kind_of(option.effect) is Kind.ADDED
    own = len(option.neutral) - len(option.effect.free)
    change = (option.probes - option.neutral)[:, :own]
    kept: list[int] = []
    for sign in np.unique(np.sign(change), axis=0):
        rows = np.flatnonzero((np.sign(change) == sign).all(axis=1))
        size = np.abs(change[rows]).sum(axis=1)
        sizes = np.unique(size)
        looked = [sizes[len(sizes) // 2], *(sizes[-1:] if added else ())]
        kept += rows[np.isin(size, looked)].tolist()
    return sorted(kept)


def _simulate(view: View, looks: Sequence[_Look], longer: _Longer | None = None) -> list[_Seen]:
    """Simulate probes, those of a group in one batch, and return what was seen.

    Args:
        view: what is wrong.
        looks: the probes.
        longer: the steps to simulate with; None takes the view's own.
    """
    problem, own = longer or (view.problem, view.base)
    limits = problem.data.settings.screening
    groups = dict.fromkeys(look.candidate.group for look in looks)
    parts = [[look for look in looks if look.candidate.group == group] for group in groups]
    found = []
    for some in _portions(parts, limits.rows_max // max(len(problem.windows), 1)):
        each = problem.errors_each([_points(view.found, part) for part in some], False)
        for part, (error, _) in zip(some, each, strict=True):
            start = 0
            for option, probes, before in part:
                changes = {k: error[start + i] - own for i, k in enumerate(probes)}
                start += len(probes)
                single = {k: change.astype(np.float32) for k, change in changes.items()}
                seen = _Seen(option, promises(view, option, changes), single)
                seen = seen if before is None else before.joined(seen)
                found += [seen] if seen.promises else []
    return found


def _portions(parts: Sequence[list[_Look]], most: int) -> Iterator[list[list[_Look]]]:
    """Yield parts of about so many probes in all, so that not all of them are in memory at once."""
    portion: list[list[_Look]] = []
    size = 0
    for part in parts:
        piece: list[_Look] = []
        for look in part:
            piece.append(look)
            size += len(look.probes)
            if size >= most:
                yield [*portion, piece]
                portion, piece, size = [], [], 0
        portion += [piece] if piece else []
    if portion:
        yield portion


def _points(found: Fit, looks: Sequence[_Look]) -> Ask:
    """Return probes beside what is known, one after the other."""
    own = [look.candidate for look in looks]
    known = found.values.shape[1]
    neutral = np.concatenate([option.neutral for option in own])
    points = []
    for look, place in zip(looks, columns(own), strict=True):
        for probe in look.candidate.probes[list(look.probes)]:
            point = np.concatenate([found.values, np.tile(neutral, (FOLDS, 1))], axis=1)
            point[:, known + place.start : known + place.stop] = probe
            points.append(point)
    return Ask((*found.members, *own), np.array(points))
