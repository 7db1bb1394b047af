"""The benchmark of hidden laws: what it draws, and how an answer is scored."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import hidden_laws as bench
from benchmarks.cases import Cases, typed


@pytest.mark.parametrize("kind", bench.KINDS)
def test_a_law_is_of_its_kind(kind: str) -> None:
    """Two parameters hang together by 0.8, or two kinds of robots are 0.3 apart in them."""
    rng = np.random.default_rng(3)
    law = bench.drawn(kind, rng)
    values = law.sample(rng, 20_000)
    assert values.min() >= 0 and values.max() <= 1
    together = np.corrcoef(values.T) - np.eye(len(bench.PLACES))
    if kind == "normal":
        assert np.abs(together).max() < 0.03
        assert ((values.std(axis=0) > 0.025) & (values.std(axis=0) < 0.11)).all()
    elif kind == "correlated":
        assert np.sort(np.abs(together[np.triu_indices(4, 1)]))[-1] == pytest.approx(0.8, abs=0.03)
        assert np.sort(np.abs(together[np.triu_indices(4, 1)]))[-2] < 0.03
    else:
        wide = np.sort(values.std(axis=0))
        assert wide[:2] == pytest.approx(0.03, abs=0.003)
        assert wide[2:] == pytest.approx(np.hypot(0.15, 0.03), abs=0.003)


def test_a_region_holds_as_many_robots_as_it_says() -> None:
    """Draws and robots of one normal law; robots far from it are outside."""
    rng = np.random.default_rng(0)
    law = bench.drawn("correlated", rng)
    draws, robots = law.sample(rng, 5000), law.sample(rng, 5000)
    assert bench.holds(draws, robots).mean() == pytest.approx(0.9, abs=0.015)
    assert not bench.holds(draws, robots + 0.6).any()


def test_the_energy_distance_is_that_of_points() -> None:
    """Two points that are d apart are sqrt(2 d) apart; a sample is 0 from itself."""
    one, other = np.zeros((3, 2)), np.tile([0.3, 0.4], (5, 1))
    assert bench.energy(one, other) == pytest.approx(np.sqrt(2 * 0.5))
    sample = np.random.default_rng(0).normal(size=(50, 2))
    assert bench.energy(sample, sample) == pytest.approx(0.0, abs=1e-6)


def test_values_are_shares_of_the_prior() -> None:
    """0 at its lower ends, 1 at its upper ones."""
    given = bench.prior()
    np.testing.assert_allclose(bench.shares(given.low), 0.0, atol=1e-12)
    np.testing.assert_allclose(bench.shares(given.high), 1.0)
    assert given.names[0] == "coulomb_friction.shoulder"


def test_cases_that_are_there_are_not_run_again(tmp_path: Path, monkeypatch) -> None:
    """The table counts the seed's own cases, and reads back what it wrote."""
    asked: list[int] = []

    def judge(number: int, robot: object, seed: int, npe: bool) -> bench.Row:
        asked.append(number)
        said = (number % 2, 0.9, 1, 0.05, 0.5, 0.9, "0.2" if npe else "", "60")
        return bench.Row(f"{seed}-{number}", bench.KINDS[number], *said)

    monkeypatch.setattr(bench, "judge", judge)
    monkeypatch.setattr(bench, "exam_robot", lambda name, folder: None)
    for cases, more in ((2, []), (3, ["--npe"])):
        assert bench.main(["--cases", str(cases), "--results", str(tmp_path), *more]) == 0
    assert asked == [0, 1, 2]
    rows = typed(bench.Row, Cases(tmp_path / "hidden_laws.csv", bench.Row._fields).rows)
    assert [row.case for row in rows] == ["1-0", "1-1", "1-2"] and rows[2].npe == "0.2"
    text = (tmp_path / "hidden_laws.md").read_text(encoding="utf-8")
    assert "| all | 3 | 0.33" in text and "least p of four parameters 0.2." in text
