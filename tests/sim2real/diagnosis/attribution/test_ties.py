"""Of effects that do equally well, the one that a channel measured is taken."""

from __future__ import annotations

import numpy as np
import pytest

from envs.effects import make
from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.contenders import Contender
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.attribution.ties import Witnessed, as_good, measured, witnesses
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.schema import Finding
from tests.sim2real.diagnosis import arm

GAP, FLOOR = 0.1, 1e-4  # rad
GAIN = ("position_gain", "a")


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> Search:
    """Return a search that has not run, in a log of the arm."""
    data = arm.data_of(arm.make_log(seconds=12.0), tmp_path_factory.mktemp("ties"))
    problem, rng = Problem(data, Simulator(data, threads=1)), np.random.default_rng(0)
    return Search(problem, candidates(data), FLOOR, rng, lambda text, share: None)


def left(search: Search, size: float) -> np.ndarray:
    """Return errors of one size everywhere [rad], (W, T, M)."""
    return np.where(search.problem.data.mask[..., None], size, 0.0) + np.zeros_like(search.base)


def contender(search: Search, label: str, size: float) -> Contender:
    """Return a contender that leaves errors of one size."""
    known = {option.label: option for option in search.options}
    values = np.tile(known[label].neutral, (FOLDS, 1))
    return Contender(
        known[label], Fit((known[label],), values, np.zeros(FOLDS)), left(search, size)
    )


def instead(
    search: Search, own: Contender, *raced: Contender, witnessed: Witnessed = frozenset({GAIN})
) -> str | None:
    """Return the label of what takes a cause's place."""
    search.witnessed = witnessed
    found = measured(search, own, raced, left(search, GAP))
    return None if found is None else found.candidate.label


def test_of_equals_the_measured_one_is_taken(search: Search) -> None:
    """It takes the place of what closes a little more, and of nothing that closes much more."""
    own = contender(search, "motor_strength.a", 0.020)
    near, far = (contender(search, "position_gain.a", size) for size in (0.022, 0.060))
    other = contender(search, "viscous_friction.a", 0.019)
    assert instead(search, own, own, other, near) == "position_gain.a"
    assert instead(search, own, own, other, far) is None
    assert instead(search, own, own, other) is None
    assert instead(search, own, own, other, near, witnessed=frozenset()) is None
    assert instead(search, near, near, other) == "position_gain.a"  # it stays
    assert instead(search, far, far, other) is None  # unless another one is much better


def test_equals_took_as_few_steps(search: Search) -> None:
    """A cause has settled since; what counts is what it was in the race."""
    settled, raced = (contender(search, "motor_strength.a", size) for size in (0.005, 0.020))
    gain = contender(search, "position_gain.a", 0.022)
    assert instead(search, settled, raced, gain) == "position_gain.a"
    assert instead(search, settled, gain) is None


def test_equals_are_those_of_the_report(search: Search) -> None:
    """A twentieth of what the other one closes is nothing; half of it is much."""
    rest, reference = left(search, GAP), left(search, 0.02)
    assert as_good(search, left(search, 0.023), reference, rest) == pytest.approx(0.003)
    assert as_good(search, left(search, 0.060), reference, rest) is None


def test_a_gain_that_the_duty_tells_is_a_witness() -> None:
    """Unless a gain is in the model already, which the finding does not know of."""
    law = Finding("control_law", "a", "the real gain is 0.50 of the model's", "multiply kp")
    other = Finding("jitter", None, "uneven", "none")
    assert witnesses([law, other], []) == {GAIN}
    for where in ("a", None):
        assert witnesses([law], [(make("position_gain", where=where), (0.5,))]) == frozenset()
    assert witnesses([law], [(make("coulomb_friction", where="a"), (0.1,))]) == {GAIN}
