"""Which changes promise most: straight lines through their probes, in the likelihood's metric.

    lines = trace_lines(fitter, base, vocabulary.list_starts(errors, joints))
    starts = pick_starts(base, lines, 12) + pick_pairs(fitter, base, lines, 12)
    pick_alike(fitter, best, rest, lines, 4)        # what does about the same as a member

Each change is replayed at its probes. With e the errors of the base and r what a probe changes,
e + a r is the errors' straight line through both, and the log density gains

    max_a  (e' V^-1 e - (e + a r)' V^-1 (e + a r)) / 2  =  (r' V^-1 e)^2 / (2 r' V^-1 r)

(the score test of Rao 1948; V as trained on the base). Of changes that only help together the Gram
matrix of all r tells: two at a time are orthogonal matching pursuit (Tropp and Gilbert 2007,
doi:10.1109/TIT.2007.909108) with its first step over pairs.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.inference.fit import Fit, Fitter, Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis, Member
from sim2real.diagnosis.inference.moves import are_compatible, join_members
from sim2real.diagnosis.inference.products import HALF
from sim2real.diagnosis.settings import TINY

CHUNK = 24  # changes whose products are taken at once
LARGEST = 30.0  # times a probe at most: a gain may be fifty times too high
SMALLEST = 0.02  # times a probe at least; less is no change


class Line(NamedTuple):
    """The straight line of one change through one of its probes."""

    member: Member
    point: np.ndarray  # (P,) the probe
    change: np.ndarray  # (W, N, M) of the errors
    scale: float  # times the probe, where the density is highest
    gain: float  # nats


def pick_starts(base: Fit, lines: Sequence[Line], most: int) -> list[Start]:
    """Return so many changes that promise most with a base, at their best along `trace_lines`."""
    return [join_lines(base, [line], [line.scale]) for line in _pick(lines, most)]


def _pick(lines: Sequence[Line], most: int) -> list[Line]:
    """Return each change's line through its best probe, of those that promise most."""
    best: dict[str, Line] = {}
    for line in sorted(lines, key=lambda line: -line.gain):
        best.setdefault(line.member.label, line)
    return list(best.values())[:most]


def pick_closest(fitter: Fitter, base: Fit, lines: Sequence[Line], most: int) -> list[Start]:
    """Return the changes that come nearest to the log at a probe, as they are there.

    A gain is measured in the metric of the base, whose discrepancy absorbs large errors at little
    cost. That a change makes this discrepancy superfluous does not show along a straight line.
    """
    weight = fitter.replayer.used[..., None] / fitter.replayer.noise
    left = [float(np.square(weight * (base.own + line.change)).sum()) for line in lines]
    nearest = [line._replace(gain=-squares) for line, squares in zip(lines, left, strict=True)]
    return [join_lines(base, [line], [1.0]) for line in _pick(nearest, most)]


def list_closing(fitter: Fitter, base: Fit, lines: Sequence[Line]) -> list[str]:
    """Return the labels of changes that may close most of the gap, each along one of its lines."""
    weight, found = fitter.replayer.used[..., None] / fitter.replayer.noise, dict[str, None]()
    errors = weight * base.own
    for line in lines:
        change = weight * line.change
        scale = -(change * errors).sum() / max(float(np.square(change).sum()), TINY)
        left = errors + np.clip(scale, *_reach(line.member)) * change
        if np.square(left).sum() <= (1 - fitter.settings.most) * np.square(errors).sum():
            found[line.member.label] = None
    return list(found)


def pick_alike(
    fitter: Fitter, best: Fit, rest: Fit, lines: Sequence[Line], most: int
) -> list[Start]:
    """Return what changes the errors most nearly as a member does, in its place and as far.

    The best has the member, the rest are the same values without it. A change's probe is the one
    whose line is most nearly parallel, in this metric.
    """
    own, there = best.own - rest.own, {member.law for member in best.hypothesis.members}
    lines = [line for line in lines if line.member.law not in there]
    lines = [line for line in lines if are_compatible(rest.hypothesis, line.member)]
    found: dict[str, tuple[float, Start]] = {}
    for first in range(0, len(lines), CHUNK):
        some = lines[first : first + CHUNK]
        _, curve = _products(fitter, best, [own, *(line.change for line in some)])
        sizes = np.sqrt(np.maximum(np.diag(curve), TINY))
        near = np.abs(curve[0, 1:]) / (sizes[0] * sizes[1:])
        scales = curve[0, 1:] / sizes[1:] ** 2
        for line, parallel, scale in zip(some, near, scales, strict=True):
            label = line.member.label
            if label not in found or parallel > found[label][0]:
                scale = float(np.clip(scale, *_reach(line.member)))
                found[label] = float(parallel), join_lines(rest, [line], [scale])
    order = sorted(found.values(), key=lambda one: -one[0])
    return [start for _, start in order[:most]]


def list_promising(fitter: Fitter, base: Fit, lines: Sequence[Line], most: int) -> list[str]:
    """Return the labels of the changes that promise most by lines traced from another base.

    What a change does is taken to be what it did there; this is a step of matching pursuit.
    """
    return [line.member.label for line in _pick(_promise(fitter, base, lines), most)]


def _promise(fitter: Fitter, base: Fit, lines: Sequence[Line]) -> list[Line]:
    """Return changes with how far each goes from a base, and what it gains, to second order."""
    found = []
    for first in range(0, len(lines), CHUNK):
        some = lines[first : first + CHUNK]
        slope, curve = _products(fitter, base, [line.change for line in some])
        for line, along, square in zip(some, slope, np.diag(curve), strict=True):
            scale = float(np.clip(-along / max(square, TINY), *_reach(line.member)))
            gain = -(along + square * scale * HALF) * scale
            found.append(line._replace(scale=scale, gain=gain))
    return found


def trace_lines(fitter: Fitter, base: Fit, starts: Sequence[Start]) -> list[Line]:
    """Return the lines of each change that can join the base, one through each of its probes.

    Every second probe of an effect is looked at first, and the others of those that promise most. A
    mistake of the log is no small change, whose probes would lie on one line: each is looked at.
    """
    own = [s for s in starts if are_compatible(base.hypothesis, s.hypothesis.members[0])]
    first, later = [], []
    for start in own:
        step = 2 if start.hypothesis.effects else 1
        first += [(start, point) for point in start.points[::step]]
        later += [(start, point) for point in start.points[1::2] if step > 1]
    lines = _trace(fitter, base, first)
    best = {line.member.label for line in _pick(lines, fitter.settings.promising)}
    return lines + _trace(fitter, base, [one for one in later if one[0].hypothesis.label in best])


def _trace(fitter: Fitter, base: Fit, asked: Sequence[tuple[Start, np.ndarray]]) -> list[Line]:
    """Return the lines through some probes (P,) of changes."""
    joined = [join_members(base, s.hypothesis.members, point[None]) for s, point in asked]
    pairs = zip(asked, fitter.replay_points(joined), strict=True)
    lines = [
        Line(start.hypothesis.members[0], point, error - base.own, 0.0, 0.0)
        for (start, point), error in pairs
    ]
    return [line for line in _promise(fitter, base, lines) if abs(line.scale) > SMALLEST]


def _products(
    fitter: Fitter, base: Fit, changes: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return r' V^-1 e, (n,), and r' V^-1 r, (n, n), of changes r of the base's errors e."""
    vectors = np.stack([base.own, *changes], axis=-1)
    products = fitter.curvature(base, vectors)
    return products[1:, 0], products[1:, 1:]


def _reach(member: Member) -> tuple[float, float]:
    """Return between which multiples of a probe a change may be."""
    if not len(member.neutral) or getattr(member, "whole", False):
        return 1.0, 1.0
    return -LARGEST, LARGEST


def pick_pairs(fitter: Fitter, base: Fit, lines: Sequence[Line], most: int) -> list[Start]:
    """Return the pairs, of so many changes, that promise most together; see `pick_starts`."""
    lines = _pick(lines, most)
    slope, curve = _products(fitter, base, [line.change for line in lines])
    found = []
    for i, j in combinations(range(len(lines)), 2):
        joined = Hypothesis.of([*base.hypothesis.members, lines[i].member])
        if not are_compatible(joined, lines[j].member):
            continue
        own = np.ix_([i, j], [i, j])
        small = curve[own] + np.diag(TINY + fitter.settings.ridge * np.diag(curve[own]))
        low, high = np.transpose([_reach(lines[i].member), _reach(lines[j].member)])
        scale = np.clip(np.linalg.solve(small, -slope[[i, j]]), low, high)
        gain = -(slope[[i, j]] @ scale + scale @ curve[own] @ scale * HALF)
        found.append((float(gain), (i, j), scale))
    found.sort(key=lambda one: -one[0])
    return [join_lines(base, [lines[k] for k in pair], scale) for _, pair, scale in found[:most]]


def join_lines(base: Fit, lines: Sequence[Line], scales: Sequence[float]) -> Start:
    """Return a base with more changes, each at its probe and so many times as far."""
    members = tuple(line.member for line in lines)
    places = [
        np.concatenate([line.point for line in lines]),
        np.concatenate(
            [_scaled(line.member, line.point, s) for line, s in zip(lines, scales, strict=True)]
        ),
    ]
    return join_members(base, members, np.unique(places, axis=0))


def _scaled(member: Member, point: np.ndarray, scale: float) -> np.ndarray:
    """Return so many times the change of a point, (P,)."""
    if isinstance(member, Candidate):
        return member.towards(point, scale)
    return np.clip(member.neutral + scale * (point - member.neutral), member.low, member.high)
