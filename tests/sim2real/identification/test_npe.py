"""Neural posterior estimation beside a posterior in closed form, and its calibration by ranks."""

import csv
from pathlib import Path

import numpy as np
import pytest

from envs.distribution import Distribution
from envs.distribution_file import read
from envs.distribution_file import write as write_distribution
from sim2real.identification.calibration import ALARM, calibrate, write
from sim2real.identification.data import Recordings
from sim2real.identification.methods import npe
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.npe import Npe
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.identification.linear import PRIOR, Linear, maker

NAMES = ("a", "b")


def ranks_of(width: float, offset: float = 0.0) -> object:
    """Return what ranks truths among draws of a normal posterior that is too wide or shifted.

    Truths are N(0, 1), summaries truths with noise N(0, 1): the right posterior is N(x / 2, 1 / 2).
    """
    rng = np.random.default_rng(3)

    def ranks(truths: np.ndarray, seen: np.ndarray, draws: int) -> np.ndarray:
        noise = width * np.sqrt(0.5) * rng.normal(size=(draws, *truths.shape))
        return (seen / 2 + offset + noise < truths).sum(axis=0)

    return ranks


@pytest.mark.parametrize(
    ("width", "offset", "right"),
    [(1.0, 0.0, True), (0.5, 0.0, False), (2.0, 0.0, False), (1.0, 0.3, False)],
    ids=["right", "too narrow", "too wide", "shifted"],
)
def test_ranks_tell_a_right_posterior_from_a_wrong_one(width, offset, right, tmp_path) -> None:
    """Ranks are uniform under the right posterior alone; the file has a line a parameter."""
    rng = np.random.default_rng(0)
    truths = rng.normal(size=(300, 2))
    seen = truths + rng.normal(size=truths.shape)
    checked = calibrate(ranks_of(width, offset), truths, seen, NAMES)  # type: ignore[arg-type]
    assert all((p > ALARM) == right for p in checked.p)
    assert (abs(np.mean(checked.coverage) - 0.9) < 0.04) == (right or offset > 0)
    write(checked, tmp_path / "calibration.csv")
    rows = list(csv.DictReader((tmp_path / "calibration.csv").open()))
    assert [row["parameter"] for row in rows] == ["a", "b"]
    assert [float(row["p"]) for row in rows] == list(checked.p)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without sbi the extra is named."""
    monkeypatch.setattr(npe, "find_spec", lambda name: None)
    with pytest.raises(
        Sim2RealError, match=r"needs the package sbi: pip install 'sim2real\[npe\]'"
    ):
        Npe()


def test_numbers_out_of_range_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sentence with the value."""
    monkeypatch.setattr(npe, "find_spec", lambda name: name)
    with pytest.raises(Sim2RealError, match=r"simulations=10 and .* must be at least 50"):
        Npe(simulations=10)


@pytest.mark.slow
def test_the_posterior_of_a_linear_system(tmp_path: Path) -> None:
    """Mean and width are those of least squares, ranks are uniform, and a resumed run is the same.

    One episode of 40 rows with noise 3: the exact posterior is normal, a tenth of the prior wide.
    """
    pytest.importorskip("sbi", reason="needs sbi: pip install 'sim2real[npe]'")
    made = Linear(np.array([[1.0, -2.0]]), 3.0, np.random.default_rng(0))
    method = Npe(simulations=1000, calibrations=200)
    found = method.fit(maker(made), PRIOR, Recordings([]), FitContext(0, tmp_path / "whole"))
    change, measured = made._change[0, :, 0], made._measured[0, :, 0]
    cover = 9.0 * np.linalg.inv(change.T @ change)
    exact, std = np.linalg.lstsq(change, measured)[0], np.sqrt(np.diag(cover))
    assert (np.abs(found.mean - exact) < 0.5 * std).all()
    assert found.std == pytest.approx(std, rel=0.3)
    rows = list(csv.DictReader((tmp_path / "whole" / "calibration.csv").open()))
    assert all(float(row["p"]) > ALARM for row in rows)
    assert "ranks of 200 simulated truths" in found.made_by["calibration"]
    write_distribution(tmp_path / "distribution.yaml", found)
    np.testing.assert_allclose(read(tmp_path / "distribution.yaml").mean, found.mean, rtol=1e-4)

    simulated: list[int] = []
    errors, made.errors = made.errors, lambda v: simulated.append(len(v)) or errors(v)  # type: ignore[method-assign]
    again = method.fit(
        maker(made), PRIOR, Recordings([]), FitContext(0, tmp_path / "again", tmp_path / "whole")
    )
    np.testing.assert_array_equal(again.particles, found.particles)
    assert sum(simulated) == 1  # the mean alone


def test_priors_that_hang_together_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its draws are independent: a joint is no prior for it."""
    monkeypatch.setattr(npe, "find_spec", lambda name: name)
    joint = Distribution(PRIOR.entries, np.array([[1.0, 0.5], [0.5, 1.0]]))
    made = Linear(np.ones((1, 2)), 1.0, np.random.default_rng(0))
    with pytest.raises(Sim2RealError, match="has correlations"):
        Npe().fit(maker(made), joint, Recordings([]))
