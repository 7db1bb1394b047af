"""Permutation tests of many columns: false alarms, values, intervals."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim2real.diagnosis.comparison.changes import Changes, find_changes
from sim2real.diagnosis.comparison.confounders import Confounded
from sim2real.diagnosis.comparison.permuted import Permuted, Prior
from sim2real.diagnosis.comparison.pieces import Pieces
from sim2real.diagnosis.settings import DEFAULT

ROWS, COLUMNS = 30, 5  # the last one is the clock
NOTHING = Prior(np.zeros(COLUMNS), np.full(COLUMNS, np.inf))


def pieces(
    rng: np.random.Generator, change: np.ndarray, count: int = 16, sided: bool = False
) -> Pieces:
    """Pieces of correlated columns and noise that differs from piece to piece."""
    mix = np.eye(COLUMNS) + 0.5 * rng.normal(size=(COLUMNS, COLUMNS))
    after = np.arange(count) % 2 == 1 if sided else None
    curve, down = np.zeros((count, COLUMNS, COLUMNS)), np.zeros((count, COLUMNS))
    for b in range(count):
        x = mix @ rng.normal(size=(COLUMNS, ROWS))
        common = rng.normal(size=ROWS) * rng.choice([0.5, 2.0])  # the same in the whole piece
        there = 1.0 if after is None else float(after[b])
        shared = x.T @ np.full(COLUMNS, 0.7) if sided else 0.0
        y = common + shared - there * (x.T @ change)
        curve[b], down[b] = x @ x.T, -x @ y
    return Pieces(curve, down, after, count * ROWS, False, np.ones(1))


def mixed(made: Pieces, turn: np.ndarray) -> Pieces:
    """Return pieces whose columns are the rows of `turn` of what they were."""
    curve = np.einsum("ij,bjk,lk->bil", turn, made.curve, turn)
    return made._replace(curve=curve, down=made.down @ turn.T)


def changes(
    made: Pieces,
    rng: np.random.Generator,
    draws: int,
    excused: tuple[int, ...] = (),
    least: tuple[float, ...] = (0.0,) * (COLUMNS - 1),
) -> Changes:
    """Return what changed in columns of single effects."""
    columns: list[Any] = [
        SimpleNamespace(option=SimpleNamespace(name=f"effect{k}", shared=False))
        for k in range(COLUMNS - 1)
    ]
    beside = Confounded((), excused, (), (), (), np.array(least), NOTHING, None)
    permuted = Permuted(made, rng, draws)
    return find_changes(permuted, columns, beside, DEFAULT, DEFAULT.compared.alpha)


@pytest.mark.parametrize("sided", [False, True], ids=["differences", "sides"])
def test_alarms_are_as_rare_as_promised(sided: bool) -> None:
    """Of 200 sets of pieces in which nothing changed, about 5 % alarm: never above 10 %."""
    alarms = 0
    for seed in range(200):
        rng = np.random.default_rng([seed, sided])
        made = pieces(rng, np.zeros(COLUMNS), 20, sided)
        tests = Permuted(made, rng, 200).of(range(COLUMNS - 1), [COLUMNS - 1], 0.05, NOTHING)
        alarms += bool((tests.p <= 0.05).any())
    assert alarms <= 20  # of a binomial with 0.05, exceeded by chance once in 500


@pytest.mark.parametrize("sided", [False, True], ids=["differences", "sides"])
def test_a_change_is_found_with_an_interval_that_holds_it(sided: bool) -> None:
    """The right column among correlated ones; the simultaneous interval covers the truth."""
    change = np.array([0.0, 0.0, 0.4, 0.0, 0.0])
    covered = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        tests = Permuted(pieces(rng, change, 24, sided), rng, 200).of(
            [2], [0, 1, 3, COLUMNS - 1], 0.05, NOTHING
        )
        covered += abs(tests.value[0] - 0.4) <= tests.critical * tests.spread[0]
    assert covered >= 17


def test_what_others_make_as_well_is_not_told() -> None:
    """A column that is the sum of two that are excused has no share of its own."""
    rng = np.random.default_rng(3)
    made = pieces(rng, np.array([0.0, 0.5, 0, 0, 0]))
    turn = np.eye(COLUMNS)
    turn[0] = [0, 1, 1, 0, 0]  # the first column becomes the second plus the third
    made = mixed(made, turn)
    found = changes(made, rng, 200, excused=(1, 2))
    assert found.untold == (0,)
    assert found.named == ()


def test_what_is_known_of_the_others_tells_two_apart() -> None:
    """More of one, or less of the other and more of both: the second needs more of both."""
    rng = np.random.default_rng(6)
    made = pieces(rng, np.array([1.5, 0.0, 0.0, 0, 0]), 24)
    turn = np.eye(COLUMNS)
    turn[2] = [1, 1, 0, 0, 0]  # the third column is both
    made = mixed(made, turn)
    permuted = Permuted(made, rng, 200)
    alike = permuted.of([0, 1], [2, 4], 0.05, NOTHING)
    assert alike.fall[0] == pytest.approx(alike.fall[1], rel=1e-6)
    assert alike.value == pytest.approx([1.5, -1.5], rel=0.2)
    little = Prior(np.zeros(COLUMNS), np.where(np.arange(COLUMNS) == 2, 0.05, np.inf))
    known = permuted.of([0, 1], [2, 4], 0.05, little)
    assert known.fall[0] > known.fall[1] + 6
    assert known.value[0] == pytest.approx(1.5, rel=0.2)
    assert known.own_share[0] > alike.own_share[0]
    assert known.p == pytest.approx(alike.p)  # whether anything changed is asked without it


def test_the_clearest_is_named_and_its_likeness_beside_it() -> None:
    """Two columns that are nearly the same stand together; a third one does not."""
    rng = np.random.default_rng(4)
    made = pieces(rng, np.array([0.6, 0.0, 0.0, 0, 0]), 24)
    turn = np.eye(COLUMNS)
    turn[1] = [1.0, 0.02, 0, 0, 0]
    made = mixed(made, turn)
    found = changes(made, rng, 400)
    assert {found.named[0].column, *found.named[0].alike} == {0, 1}
    assert found.named[0].p <= 0.01


@pytest.mark.parametrize(("count", "named"), [(16, 0), (160, 1)])
def test_a_small_change_takes_a_long_recording(count: int, named: int) -> None:
    """It is sure in both; in the short one it is no larger than what lasts a piece."""
    rng = np.random.default_rng(7)
    made = pieces(rng, np.array([0.2, 0.0, 0.0, 0, 0]), count)
    tests = Permuted(made, rng, 400).of([0], [4], 0.05, NOTHING)
    assert tests.p[0] <= 0.05
    found = changes(made, rng, 400)
    assert [one.column for one in found.named] == [0] * named


def test_what_temperature_may_do_is_not_named() -> None:
    """A change below the size that a column must have is left out, however sure it is."""
    rng = np.random.default_rng(5)
    made = pieces(rng, np.array([0.6, 0.0, 0.0, 0, 0]), 24)
    found = changes(made, rng, 200, least=(0.9, 0, 0, 0))
    assert 0 not in [one.column for one in found.named]
