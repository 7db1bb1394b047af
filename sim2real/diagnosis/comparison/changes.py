"""Which effects changed: the clearest is named, and the others are tested again with it.

    found = find_changes(pieces, columns, excused, rng, settings)
    found.named, found.tests

A change is named while the largest |t| of all effects is larger than chance makes it, and while
its response is worth naming. Effects that explain the same pieces as well are listed with it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from sim2real.diagnosis.comparison.answer import Alike, Change
from sim2real.diagnosis.comparison.permuted import Permuted, Prior, Tests
from sim2real.diagnosis.comparison.pieces import Pieces
from sim2real.diagnosis.comparison.response import Column
from sim2real.diagnosis.settings import Compared


class Named(NamedTuple):
    """A change: its column, its test, and the columns that explain alike."""

    column: int
    p: float
    alike: tuple[int, ...]


class Changes(NamedTuple):
    """What was found."""

    named: tuple[Named, ...]
    every: Tests  # each column with the named ones and what is excused
    untold: tuple[int, ...]  # columns that the excused ones make as well


def find_changes(
    pieces: Pieces,
    columns: Sequence[Column],
    excused: Sequence[int],
    known: Sequence[int],
    ruled_out: Sequence[int],
    least: np.ndarray,
    rng: np.random.Generator,
    limits: Compared,
    prior: Prior | None = None,
) -> Changes:
    """Name what changed.

    Args:
        pieces: of both sides.
        columns: what may change, the first columns of the pieces.
        excused: columns that temperature or mounting may have changed.
        known: columns that are known to have changed otherwise.
        ruled_out: columns that are known not to have changed.
        least: of each column, the size that a change must have, (P,).
        rng: for the permutations.
        limits: when a change is named.
        prior: what is known of the columns of the pieces.
    """
    permuted = Permuted(pieces, rng, limits.draws)
    nuisance = [*excused, *known, *pieces.clocks]
    free = [k for k in range(len(columns)) if k not in (*nuisance, *ruled_out)]
    named: list[Named] = []
    first = permuted.of(free, nuisance, limits.alpha, prior)
    shares = zip(first.columns, first.own_share, strict=True)
    untold = [k for k, share in shares if share < limits.apart]
    left = [k for k in free if k not in untold]
    while left and len(named) < limits.changes_max:
        tests = permuted.of(left, nuisance, limits.alpha, prior)
        best = _clearest(tests, least, limits, len(pieces.curve))
        if best is None:
            break
        near = tests.fall[best] - tests.fall < limits.alike
        near &= tests.own_share >= limits.apart
        alike = [k for k, n in zip(tests.columns, near, strict=True) if n]
        best = _plainest(tests, columns, best, alike)
        column = tests.columns[best]
        order = sorted(
            (k for k in alike if k != column), key=lambda k: -tests.fall[tests.columns.index(k)]
        )
        named.append(Named(column, float(tests.p[best]), tuple(order)))
        nuisance.append(column)
        left.remove(column)
    every = permuted.of([*free, *known], nuisance, limits.alpha, prior)
    return Changes(tuple(named), every, tuple(untold))


def _clearest(tests: Tests, least: np.ndarray, limits: Compared, pieces: int) -> int | None:
    """Return the place of the column that explains most, of those that chance does not.

    Chance is asked twice: of the scatter over pieces (p), which few pieces may make too small, and
    of the likelihood (Wilks), for as many columns as there are. What is not modelled differs from
    piece to piece: noise as large as readings' that lasts a whole piece makes responses of about
    1 / sqrt(pieces).
    """
    likely = float(chi2.isf(limits.alpha / len(tests.columns), 1))
    large = np.maximum(limits.worth / np.sqrt(pieces), limits.doubt * tests.others)
    sure = (tests.p <= limits.alpha) & (tests.fall >= likely) & (tests.response >= large)
    sure &= tests.own_share >= limits.apart  # the rest is what the named ones make as well
    sure &= np.abs(tests.value) > least[list(tests.columns)]
    if not sure.any():
        return None
    return int(np.argmax(np.where(sure, tests.fall, -np.inf)))


def _plainest(tests: Tests, columns: Sequence[Column], best: int, alike: Sequence[int]) -> int:
    """Return the place of the best column, or of one at a single place that explains as well."""
    if not columns[tests.columns[best]].option.shared:
        return best
    single = [tests.columns.index(k) for k in alike if not columns[k].option.shared]
    return max(single, key=lambda place: tests.fall[place], default=best)


def as_change(
    columns: Sequence[Column],
    tests: Tests,
    column: int,
    limit: float | None = None,
    moved: float = 0.0,
) -> Change:
    """Return the change of a column with its simultaneous interval; `moved` of it was simulated."""
    place, own = tests.columns.index(column), columns[column].option
    value = moved + float(tests.value[place])
    half = tests.critical * float(tests.spread[place])
    effect = own.effect
    return Change(
        effect.name,
        own.place,
        effect.side,
        value,
        (value - half, value + half),
        effect.unit,
        float(tests.p[place]),
        limit=limit,
        body=effect.where if effect.place == "body" else None,
    )


def as_untold(columns: Sequence[Column], found: Changes) -> tuple[tuple[str, str], ...]:
    """Return the labels of changes that the logs cannot show, and why."""
    alike = "looks like what is put down to temperature or mounting"
    why = dict.fromkeys(found.untold, alike)
    halves = found.every.critical * found.every.spread
    for k, half in zip(found.every.columns, halves, strict=True):
        if half > columns[k].largest:
            why.setdefault(k, f"known to ± {half:.2g} {columns[k].option.effect.unit}".strip())
    return tuple((columns[k].label, text) for k, text in why.items())


def as_alike(columns: Sequence[Column], alike: Sequence[int], most: int = 2) -> tuple[Alike, ...]:
    """Return the effects of some columns, each once."""
    found = dict.fromkeys(Alike(columns[k].option.name, columns[k].option.place) for k in alike)
    return tuple(found)[:most]
