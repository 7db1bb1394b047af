"""BayRn: it finds the distribution that trains best, from returns alone, and resumes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.distribution import Distribution, Entry
from envs.distribution_file import read
from envs.effects import make
from envs.marginals import uniform
from sim2real.runs.errors import Sim2RealError

pytest.importorskip("botorch", reason="pip install 'sim2real[botorch]'")

from sim2real.loops.bayrn import FILE, STATE, BayRn, Session, search

PRIOR = Distribution(
    (
        Entry(make("position_gain", where="slider"), (uniform(0.3, 3.0),)),
        Entry(make("derivative_gain", where="slider"), (uniform(0.5, 1.5),)),
    )
)
ONE = Distribution(PRIOR.entries[:1])
GAIN = 0.8  # of the true plant


def earned(distribution: Distribution, rng: np.random.Generator) -> float:
    """Return what is best at (0.9, 1.2) and narrow laws, with noise of a hundredth of its range."""
    off = (distribution.mean - [0.9, 1.2]) / (PRIOR.high - PRIOR.low)
    wide = distribution.std / (PRIOR.high - PRIOR.low)
    return float(-(off**2).sum() - 0.2 * wide.sum() + rng.normal(0.0, 0.005))


def drive(session: Session, value) -> Session:
    """Answer until nothing is asked."""
    while (distribution := session.ask()) is not None:
        session.tell(value(distribution))
    return session


def test_it_finds_the_best_law_of_a_noisy_return() -> None:
    """Means within a tenth of their ranges of the best in 30 values; and it says which it tried."""
    rng = np.random.default_rng(0)
    session = drive(BayRn(first=8, rounds=30).start(PRIOR, seed=0), lambda d: earned(d, rng))
    found = session.result
    assert (np.abs(found.mean - [0.9, 1.2]) < 0.1 * (PRIOR.high - PRIOR.low)).all()
    assert (found.std < 0.15 * (PRIOR.high - PRIOR.low)).all()
    assert len(session.tried) == 30
    np.testing.assert_array_equal(found.mean, session.tried[session.best].mean)
    assert all(
        law.low == low and law.high == high
        for one in session.tried
        for law, low, high in zip(one.laws, PRIOR.low, PRIOR.high, strict=True)
    )


def trained(distribution: Distribution) -> float:
    """Return the feedback k that is best on plants x' = x - b k x with b of the distribution.

    The mean of (1 - b k)² is least at k = E[b] / E[b²].
    """
    draws = distribution.sample(np.random.default_rng(0), 2000)[:, 0]
    return float(draws.mean() / (draws**2).mean())


def test_a_policy_that_is_trained_there_is_as_good_as_one_of_the_target() -> None:
    """Trainings under laws of a plant's gain; the robot's own gain is never measured."""
    session = BayRn(first=4, rounds=14).start(ONE, seed=1)
    drive(session, lambda d: -((1 - GAIN * trained(d)) ** 2))
    middle = (1 - GAIN * trained(ONE)) ** 2
    assert (1 - GAIN * trained(session.result)) ** 2 < 0.01 * middle
    assert abs(session.result.mean[0] - GAIN) < 0.15 * 2.7


def test_what_was_told_is_not_asked_again(tmp_path: Path) -> None:
    """A search that was stopped asks on as if it had not been, and writes the same answer."""
    recipe = BayRn(first=4, rounds=6)

    def value(distribution: Distribution) -> float:
        return -float(((distribution.mean - 1.0) ** 2).sum())

    whole = search(recipe.start(PRIOR, 0), lambda d, name: value(d), tmp_path / "whole")
    tries: list[str] = []

    def attempt(distribution: Distribution, name: str) -> float:
        if len(tries) == 5:
            raise KeyboardInterrupt
        tries.append(name)
        return value(distribution)

    with pytest.raises(KeyboardInterrupt):
        search(recipe.start(PRIOR, 0), attempt, tmp_path / "part")
    assert len(json.loads((tmp_path / "part" / STATE).read_text())["values"]) == 5
    again = search(recipe.start(PRIOR, 0), lambda d, name: value(d), tmp_path / "part")
    assert again.values == pytest.approx(whole.values)
    assert tries == ["01", "02", "03", "04", "05"]
    for folder in ("whole", "part"):
        np.testing.assert_allclose(read(tmp_path / folder / FILE).mean, whole.result.mean)
    assert f"Round {whole.best + 1:02d} is best" in (tmp_path / "part" / "table.md").read_text()
    with pytest.raises(Sim2RealError, match="search had other settings"):
        search(recipe.start(PRIOR, 1), lambda d, name: 0.0, tmp_path / "part")


def test_what_cannot_be_told_or_asked_is_refused() -> None:
    """A value that nobody asked for or that is no number, numbers out of range, an early answer."""
    session = BayRn(first=2, rounds=2).start(ONE, 0)
    with pytest.raises(Sim2RealError, match="finite number, got nan"):
        session.tell(float("nan"))
    with pytest.raises(Sim2RealError, match="0 values are too few"):
        _ = session.best
    drive(session, lambda d: 1.0)  # all the same: no error
    assert session.best in (0, 1)
    with pytest.raises(Sim2RealError, match="before it was asked for"):
        session.tell(1.0)
    wrongs: list[dict[str, Any]] = [{"first": 1}, {"first": 9, "rounds": 8}]
    wrongs += [{"narrowest": 0.4}, {"narrowest": 0.0}]
    for wrong in wrongs:
        with pytest.raises(Sim2RealError, match="bayrn: "):
            BayRn(**wrong)
