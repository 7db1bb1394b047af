"""Which effects changed: the clearest is named, and the others are tested again with it.

    found = find_changes(permuted, columns, beside, settings, alpha)
    found.named, found.every

A change is named while the largest |t| of all effects is larger than chance makes it, and while
its response is worth naming. Effects that explain the same pieces as well are listed with it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from sim2real.diagnosis.comparison.answer import Alike, Change
from sim2real.diagnosis.comparison.confounders import Confounded
from sim2real.diagnosis.comparison.permuted import Permuted, Tests
from sim2real.diagnosis.comparison.response import Column
from sim2real.diagnosis.settings import Compared, Settings


class Named(NamedTuple):
    """A change: its column, its test, and the columns that explain alike, the best first."""

    column: int
    p: float
    alike: tuple[int, ...]


class Changes(NamedTuple):
    """What was found."""

    named: tuple[Named, ...]
    every: Tests  # each column with the named ones and what is excused
    untold: tuple[int, ...]  # columns that the excused ones make as well


def find_changes(
    permuted: Permuted,
    columns: Sequence[Column],
    beside: Confounded,
    settings: Settings,
    alpha: float,
) -> Changes:
    """Name what changed.

    Args:
        permuted: the pieces of both sides.
        columns: what may change, the first columns of the pieces.
        beside: columns that something else may have changed, and what is known of all columns.
        settings: when a change is named.
        alpha: probability of any false alarm.
    """
    limits, alike_most = settings.compared, -2.0 * np.log(settings.inference.level)
    nuisance = [*beside.excused, *beside.known, *permuted.pieces.clocks]
    free = [k for k in range(len(columns)) if k not in (*nuisance, *beside.ruled_out)]
    named: list[Named] = []
    shares = permuted.of(free, nuisance, alpha, beside.prior).own_share if free else ()
    untold = [k for k, share in zip(free, shares, strict=True) if share < limits.apart]
    left = [k for k in free if k not in untold]
    while left and len(named) < settings.inference.members_max:
        tests = permuted.of(left, nuisance, alpha, beside.prior)
        best = _clearest(tests, beside.least, limits, alpha, len(permuted.pieces.curve))
        if best is None:
            break
        order = np.argsort(-tests.fall, kind="stable")
        near = (tests.fall[best] - tests.fall < alike_most) & (tests.own_share >= limits.apart)
        alike = [left[place] for place in order if near[place]]
        column = left[best]
        if columns[column].option.shared:  # rather one at a single place that explains as well
            column = next((k for k in alike if not columns[k].option.shared), column)
        alike = tuple(k for k in alike if k != column)
        named.append(Named(column, float(tests.p[left.index(column)]), alike))
        nuisance.append(column)
        left.remove(column)
    every = permuted.of([*free, *beside.known], nuisance, alpha, beside.prior)
    return Changes(tuple(named), every, tuple(untold))


def _clearest(
    tests: Tests, least: np.ndarray, limits: Compared, alpha: float, pieces: int
) -> int | None:
    """Return the place of the column that explains most, of those that chance does not.

    Chance is asked twice: of the scatter over pieces (p), which few pieces may make too small, and
    of the likelihood (Wilks), for as many columns as there are. What is not modelled differs from
    piece to piece: noise as large as readings' that lasts a whole piece makes responses of about
    1 / sqrt(pieces).
    """
    likely = float(chi2.isf(alpha / len(tests.columns), 1))
    large = np.maximum(limits.worth / np.sqrt(pieces), limits.doubt * tests.others)
    sure = (tests.p <= alpha) & (tests.fall >= likely) & (tests.response >= large)
    sure &= tests.own_share >= limits.apart  # the rest is what the named ones make as well
    sure &= np.abs(tests.value) > least[list(tests.columns)]
    if not sure.any():
        return None
    return int(np.argmax(np.where(sure, tests.fall, -np.inf)))


def as_change(
    columns: Sequence[Column], tests: Tests, column: int, limit: float | None, moved: float
) -> Change:
    """Return the change of a column with its simultaneous interval; `moved` of it was simulated."""
    place, own = tests.columns.index(column), columns[column].option
    effect, value = own.effect, moved + float(tests.value[place])
    half = tests.critical * float(tests.spread[place])
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


def as_alike(
    columns: Sequence[Column], alike: Sequence[int], settings: Settings
) -> tuple[Alike, ...]:
    """Return the first effects of some columns, each once."""
    found = dict.fromkeys(Alike(columns[k].option.name, columns[k].option.place) for k in alike)
    return tuple(found)[: settings.inference.equivalents_max - 1]
