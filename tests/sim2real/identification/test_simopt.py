"""SimOpt: rounds find what one round misses, stop where nothing moves, and go on when stopped."""

import csv
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.distribution import Distribution, Entry
from envs.marginals import Marginal
from sim2real.config.compose import compose, instantiate
from sim2real.identification.data import Recordings
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.dropo import Dropo
from sim2real.identification.methods.matching import Matching
from sim2real.identification.methods.simopt import SimOpt, mean_shift, narrow_prior
from sim2real.identification.scores.aligned import KStep
from sim2real.identification.searches import Cma
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.identification.linear import PRIOR, Linear, maker
from tests.sim2real.identification.test_dropo import Carts, masses

pytestmark = pytest.mark.slow  # trainings and walks: a minute together

TRUTH, SPREAD = np.array([1.3, 0.8]), np.array([0.1, 0.05])
GENERATIONS = 20
WIDE = masses("a", "b", low=0.1, high=10.0)
NOTHING = Recordings([])


def carts() -> Any:
    """Return what makes 60 pairs of carts, of masses that vary."""
    rng = np.random.default_rng(0)
    return maker(Carts(rng.normal(TRUTH, SPREAD, (60, 2)), rng, noise=0.01))  # type: ignore[arg-type]


def small(search: Cma | None = None) -> Dropo:
    """Return a method whose budget is too small for the wide prior: 160 Gaussians."""
    return Dropo(search or Cma(population=8, generations=GENERATIONS), samples=20)


@pytest.mark.parametrize("seed", range(3))
def test_rounds_find_what_one_round_misses(seed: int) -> None:
    """Masses within 10 % in each seed, where a round alone is off by more than 30 %."""
    once = small().fit(carts(), WIDE, NOTHING, FitContext(seed))
    found = SimOpt(small(), rounds=8).fit(carts(), WIDE, NOTHING, FitContext(seed))
    assert np.abs(once.mean / TRUTH - 1).max() > 0.3
    assert found.mean == pytest.approx(TRUTH, rel=0.1)
    assert found.made_by["of"] == "dropo" and found.made_by["seed"] == seed
    np.testing.assert_array_equal([found.low, found.high], [WIDE.low, WIDE.high])


def test_it_stops_where_nothing_moves(tmp_path: Path) -> None:
    """A linear system is found at once: the second round says the same, and there is no third."""
    made = Linear(np.full((6, 2), 1.0), 0.3, np.random.default_rng(1))
    method = SimOpt(Matching(KStep(), Cma(population=6, generations=12)), rounds=5)
    found = method.fit(maker(made), PRIOR, NOTHING, FitContext(0, tmp_path))
    assert found.made_by["rounds"] == 2
    assert (np.abs(found.mean - 1.0) < 3 * found.columns("uncertainty")).all()
    assert {p.name for p in tmp_path.iterdir()} == {"round_1", "round_2", "rounds.csv"}
    rows = list(csv.DictReader((tmp_path / "rounds.csv").open()))
    assert [row["round"] for row in rows] == ["1", "1", "2", "2"]
    assert all(float(row["moved"]) <= 1.0 for row in rows[2:])
    widths = [float(row["prior high"]) - float(row["prior low"]) for row in rows]
    assert max(widths[2:]) < 0.2 * min(widths[:2])


def test_what_has_not_settled_is_said(caplog: pytest.LogCaptureFixture) -> None:
    """The rounds are spent: a warning with the parameter's name."""
    with caplog.at_level(logging.WARNING):
        SimOpt(small(), rounds=2, still=1e-6).fit(carts(), WIDE, NOTHING)
    assert "after 2 rounds link_mass." in caplog.text and "identify.rounds" in caplog.text


def test_one_round_is_the_method() -> None:
    """With rounds=1 nothing is added: the same points, the same answer."""
    once = small().fit(carts(), WIDE, NOTHING, FitContext(3))
    found = SimOpt(small(), rounds=1).fit(carts(), WIDE, NOTHING, FitContext(3))
    np.testing.assert_array_equal([found.mean, found.std], [once.mean, once.std])


def test_where_nothing_is_known_nothing_narrows() -> None:
    """Readings that do not change with the parameters leave prior and answer as wide as before."""
    made = Linear(np.ones((4, 2)), 0.3, np.random.default_rng(1))
    made._change = 1e-9 * made._change
    method = Matching(KStep(), Cma(population=6, generations=4))
    found = SimOpt(method).fit(maker(made), PRIOR, NOTHING)
    assert len(found.flat) == 2
    np.testing.assert_allclose(found.std, PRIOR.std)
    box = narrow_prior(PRIOR, PRIOR, found, 1.0, 0.02)
    np.testing.assert_allclose([box.low, box.high], [PRIOR.low, PRIOR.high])


def law(mean: float, std: float) -> Distribution:
    """Return a distribution of the first mass alone, as a round finds it."""
    (first, _) = WIDE.entries
    return Distribution((Entry(first.effect, (Marginal("normal", mean, std, 0.1, 10.0),)),))


@pytest.mark.parametrize(
    ("mean", "std", "low", "high"),
    [
        (5.0, 0.5, 5 - 1.5 * 3**0.5, 5 + 1.5 * 3**0.5),  # three times as wide, about the mean
        (0.3, 0.5, 0.1, 0.1 + 3 * 3**0.5),  # as wide, within the prior's end
        (5.0, 0.0, 4.901, 5.099),  # a population that collapsed: 2 % of the prior
        (5.0, 5.0, 0.1, 10.0),  # never beyond the prior
    ],
    ids=["about the mean", "at an end", "collapsed", "wide"],
)
def test_how_a_prior_is_narrowed(mean: float, std: float, low: float, high: float) -> None:
    """Its ends, from a mean and a standard deviation."""
    box = narrow_prior(law(5.0, 1.0), law(5.0, 1.0), law(mean, std), 3.0, 0.02)
    assert (box.low[0], box.high[0]) == pytest.approx((low, high))


def test_moves_are_measured_in_uncertainties() -> None:
    """In standard deviations where the method knows none."""
    before, after = law(5.0, 1.0), law(5.6, 0.3)
    assert mean_shift(before, after) == pytest.approx([2.0])
    sure = replace(after, entries=(replace(after.entries[0], uncertainty=(0.1,)),))
    assert mean_shift(before, sure) == pytest.approx([6.0])


class Stopping(Cma):
    """A search that is interrupted after so many generations of all rounds together."""

    def __init__(self, after: float = np.inf) -> None:
        super().__init__(population=8, generations=GENERATIONS)
        self.asked, self.after = 0, after

    def minimize(self, evaluate: Any, *rest: Any) -> Any:
        """Search until it is time."""

        def once(points: np.ndarray, turn: int) -> np.ndarray:
            if self.asked >= self.after:
                raise KeyboardInterrupt
            self.asked += 1
            return evaluate(points, turn)

        return super().minimize(once, *rest)


def test_stopped_rounds_resume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped in the second of three rounds, it ends where the whole run did."""

    def go(name: str, after: float = np.inf, resume: Path | None = None) -> Distribution:
        method = SimOpt(small(Stopping(after)), rounds=3, still=1e-9)
        return method.fit(carts(), WIDE, NOTHING, FitContext(0, tmp_path / name, resume))

    whole = go("whole")
    with pytest.raises(KeyboardInterrupt):
        go("part", after=25)
    assert {p.name for p in (tmp_path / "part").iterdir()} == {"round_1", "round_2", "rounds.csv"}
    surprise, simulated = Dropo._surprise, []

    def counted(*given: Any) -> float:
        simulated.append(given)
        return surprise(*given)

    monkeypatch.setattr(Dropo, "_surprise", counted)
    resumed = go("resumed", resume=tmp_path / "part")
    np.testing.assert_array_equal([resumed.mean, resumed.std], [whole.mean, whole.std])
    assert len(simulated) == 8 * (3 * GENERATIONS - 25)  # no generation twice
    texts = [(tmp_path / name / "rounds.csv").read_text() for name in ("whole", "resumed")]
    assert texts[0] == texts[1]
    with pytest.raises(Sim2RealError, match="resume: no"):
        go("none", resume=tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rounds": 0}, "rounds=0"),
        ({"widen": 0.5}, r"widen=0\.5 must be at least 1"),
        ({"narrowest": 0.0}, "narrowest=0 above 0"),
        ({"still": 0.0}, "still=0 above 0"),
    ],
    ids=["rounds", "widen", "narrowest", "still"],
)
def test_numbers_out_of_range_are_refused(given: dict, message: str) -> None:
    """A sentence with the value."""
    with pytest.raises(Sim2RealError, match=message):
        SimOpt(small(), **given)


def test_any_method_is_composed(tmp_path: Path) -> None:
    """The method of the rounds is chosen by its group, and has its own keys."""
    words = ["run=identify", "log=run.csv", "params=udr", "identify=simopt", "identify.rounds=3"]
    other = ["identify@identify.method=dropo", "identify.method.samples=20"]
    _, arguments = instantiate(compose([*words, *other]), tmp_path)
    method = arguments["identify"]
    assert isinstance(method, SimOpt) and isinstance(method.method, Dropo)
    assert (method.rounds, method.method.samples, method.rows) == (3, 20, 1)
