"""Noisy returns: the operator hears them, nobody else; the errors follow their law."""

import numpy as np
import pytest

from sim2real.config.compose import compose, instantiate
from sim2real.learning.adapt import HillClimb, LinearGAE, NoisyReturns, PolicyGradient
from sim2real.runs.errors import Sim2RealError

CLIMB = HillClimb(mode="batch", queries=3, parallel=4, sigma=0.3)


def climbed(operator: NoisyReturns | HillClimb, seed: int = 0) -> np.ndarray:
    """Return where an operator climbs to on a bowl about ones."""
    session = operator.start(np.zeros(20, np.float32), np.random.default_rng(seed))
    while (candidate := session.ask()) is not None:
        session.tell(-float(np.square(candidate - 1.0).sum()))
    return session.result


def test_without_errors_it_is_the_operator() -> None:
    """Stages, episodes and results are the operator's own."""
    exact = NoisyReturns(CLIMB, scale=0.0)
    assert (exact.stages, exact.episodes) == (CLIMB.stages, CLIMB.episodes)
    np.testing.assert_array_equal(climbed(exact), climbed(CLIMB))
    assert (climbed(NoisyReturns(CLIMB, "gaussian", scale=50.0)) != climbed(CLIMB)).any()


def test_errors_follow_their_law() -> None:
    """Normal of the scale; or never above zero, in a share of the episodes."""
    many = HillClimb(mode="batch", queries=100, parallel=100, sigma=0.3)
    seed = np.random.default_rng(0).standard_normal(20, np.float32)
    normal = NoisyReturns(many, "gaussian", scale=2.0).errors(seed)
    assert normal.mean() == pytest.approx(0.0, abs=0.1)
    assert normal.std() == pytest.approx(2.0, rel=0.05)
    hurt = NoisyReturns(many, "one_sided", scale=2.0, share=0.2).errors(seed)
    assert (hurt <= 0).all() and (hurt < 0).mean() == pytest.approx(0.2, abs=0.02)
    assert hurt[hurt < 0].mean() == pytest.approx(-2.0 * np.sqrt(2 / np.pi), rel=0.05)


def test_members_have_errors_of_their_own_whatever_the_order() -> None:
    """Side by side as alone, and values are kept as they were."""
    operator, start = NoisyReturns(CLIMB, "gaussian", scale=5.0), np.zeros((3, 20), np.float32)
    cohort = operator.start_many(start, [np.random.default_rng(seed) for seed in range(3)])
    told = []
    for member in (2, 0, 1):
        while len(episodes := cohort.available(member)):
            who = np.full(len(episodes), member)
            which = np.array(episodes)[::-1]
            values = -np.square(cohort.candidates(who, which) - 1.0).sum(axis=1)
            cohort.tell(who, which, values)
            told.append((member, which, values))
    for seed in range(3):
        np.testing.assert_allclose(cohort.results[seed], climbed(operator, seed), rtol=1e-5)
    for member, which, values in told:
        np.testing.assert_array_equal(cohort.values[member, which], values)


def test_a_session_resumes_with_the_same_errors() -> None:
    """What is saved holds the seed of the errors."""
    operator = NoisyReturns(CLIMB, "gaussian", scale=5.0)
    session = operator.start(np.zeros(20, np.float32), np.random.default_rng(0))
    for _ in range(6):
        candidate = session.ask()
        assert candidate is not None
        session.tell(-float(np.square(candidate - 1.0).sum()))
    other = operator.start(np.zeros(20, np.float32), np.random.default_rng(1))
    other.load_state_dict(session.state_dict())
    np.testing.assert_array_equal(other.ask(), session.ask())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"law": "gausian"}, "did you mean 'gaussian'"),
        ({"scale": -1.0}, "scale=-1.0"),
        ({"share": 1.5}, r"share=1\.5 in \[0, 1\]"),
    ],
)
def test_what_cannot_be_is_refused(given: dict, message: str) -> None:
    """With the value and what is allowed."""
    with pytest.raises(Sim2RealError, match=message):
        NoisyReturns(CLIMB, **given)


def test_an_operator_that_needs_more_than_returns_is_refused() -> None:
    """Noise on returns would change nothing there."""
    judge = LinearGAE(gamma=0.99, lmbda=0.95, ridge=1.0)
    gradient = PolicyGradient(trajectories=2, rate=0.1, surrogate="ratio", advantage=judge)
    with pytest.raises(Sim2RealError, match="does not adapt by returns alone"):
        NoisyReturns(gradient)


def test_it_is_composed() -> None:
    """`adapt=noisy` with another operator in it."""
    words = ["+experiment=quad8_es", "adapt=noisy", "adapt@adapt.operator=average"]
    _, given = instantiate(compose(words), __file__)  # type: ignore[arg-type]
    adapt = given["parts"].adapt
    assert isinstance(adapt, NoisyReturns) and str(adapt).endswith(
        "one_sided errors of 0.5 in the returns"
    )
    assert isinstance(adapt.operator, HillClimb) and adapt.operator.mode == "average"
