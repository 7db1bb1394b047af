"""Adaptation operators: they climb, they spend what they say, and a session resumes anywhere."""

import io
from typing import Any, cast

import numpy as np
import pytest
import torch

from sim2real.learning.adapt import Adaptation, GradientAdaptation, HillClimb, NoAdaptation
from sim2real.learning.adapt.first_order import FirstOrder

OPERATORS = {
    "none": NoAdaptation(),
    "gradient": GradientAdaptation(queries=5, sigma=0.1, rate=0.05, baseline="mean"),
    "pivot": GradientAdaptation(queries=5, sigma=0.1, rate=0.05, baseline="pivot", orthogonal=True),
    "sequential": HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1),
    "average": HillClimb(mode="average", queries=3, parallel=4, sigma=0.1),
    "batch": HillClimb(mode="batch", queries=3, parallel=4, sigma=0.1, incumbent_episodes=1),
    "again": HillClimb(
        mode="batch",
        queries=3,
        parallel=2,
        sigma=0.1,
        incumbent_episodes=1,
        reevaluate_incumbent=True,
    ),
    "annealed": HillClimb(
        mode="sequential", queries=4, parallel=1, sigma=0.2, grow=0.5, shrink=0.5
    ),
    "one fifth": HillClimb(
        mode="sequential", queries=6, parallel=1, sigma=0.1, grow=1.5, shrink=1.5**-0.25
    ),
}
EPISODES = {
    "none": 0, "gradient": 6, "pivot": 6, "sequential": 3, "average": 16, "batch": 13, "again": 9,
    "annealed": 5, "one fifth": 7,
}  # fmt: skip
operators = pytest.mark.parametrize("name", list(OPERATORS))


def value(theta: np.ndarray) -> float:
    """Height of a smooth hill with its top at 1."""
    return -float(((theta.astype(np.float64) - 1) ** 2).sum())


def run(operator: Adaptation, seed: int, size: int = 6) -> tuple[np.ndarray, list[np.ndarray]]:
    """Adapt on the hill; return the result and all candidates."""
    session = operator.start(np.zeros(size, np.float32), np.random.default_rng(seed))
    asked = []
    while (theta := session.ask()) is not None:
        asked.append(theta)
        session.tell(value(theta))
    return session.result, asked


@operators
def test_spends_the_stated_episodes(name: str) -> None:
    """A session asks for `episodes` episodes, the unchanged policy's first, then refuses more."""
    operator = OPERATORS[name]
    _, asked = run(operator, 0)
    assert len(asked) == operator.episodes == EPISODES[name]
    if asked:
        assert not asked[0].any()
    session = operator.start(np.zeros(6, np.float32), np.random.default_rng(0))
    for _ in asked:
        session.tell(0.0)
    with pytest.raises(ValueError, match="have been reported"):
        session.tell(0.0)


@pytest.mark.parametrize("name", [name for name in OPERATORS if name != "none"])
def test_improves_on_average(name: str) -> None:
    """On a smooth hill adapted parameters beat the start, on average over 50 draws."""
    gains = [value(run(OPERATORS[name], seed)[0]) - value(np.zeros(6)) for seed in range(50)]
    assert np.mean(gains) > 0.05


@operators
def test_cohort_equals_sessions_in_any_order(name: str) -> None:
    """Members of a cohort that report in shuffled order get the bits that single sessions get."""
    operator, count = OPERATORS[name], 5
    cohort = operator.start_many(
        np.zeros((count, 6), np.float32), [np.random.default_rng(seed) for seed in range(count)]
    )
    order = np.random.default_rng(0)
    open_episodes = [(m, e) for m in range(count) for e in cohort.available(m)]
    while open_episodes:
        picks = order.permutation(len(open_episodes))[: order.integers(1, 6)]
        members, episodes = np.array([open_episodes[i] for i in picks]).T
        thetas = cohort.candidates(members, episodes)
        open_episodes = [p for i, p in enumerate(open_episodes) if i not in picks]
        for member in cohort.tell(members, episodes, np.array([value(t) for t in thetas])):
            open_episodes += [(member, e) for e in cohort.available(member)]
    for seed in range(count):
        np.testing.assert_array_equal(cohort.results[seed], run(operator, seed)[0])


@operators
def test_session_resumes_after_every_episode(name: str) -> None:
    """A session saved to bytes after any episode and loaded elsewhere ends with the same bits."""
    operator = OPERATORS[name]
    expected, asked = run(operator, 3)
    for stop in range(len(asked) + 1):
        session = operator.start(np.zeros(6, np.float32), np.random.default_rng(3))
        for theta in asked[:stop]:
            session.tell(value(theta))
        buffer = io.BytesIO()
        torch.save(session.state_dict(), buffer)
        buffer.seek(0)
        other = operator.start(np.ones(6, np.float32), np.random.default_rng(99))
        other.load_state_dict(torch.load(buffer, weights_only=True))
        while (theta := other.ask()) is not None:
            other.tell(value(theta))
        np.testing.assert_array_equal(other.result, expected)


def test_gradient_step_is_the_published_formula() -> None:
    """The step is alpha / K * sum of normalized return times perturbation / sigma squared."""
    operator = GradientAdaptation(queries=3, sigma=0.2, rate=0.05, baseline="mean")
    session = operator.start(np.zeros(4, np.float32), np.random.default_rng(0))
    values, thetas = np.array([1.0, 4.0, -2.0, 7.0]), []
    for v in values:
        thetas.append(session.ask())
        session.tell(v)
    normalized = (values - values.mean()) / values.std()
    steps = np.array(thetas[1:], np.float64)
    expected = 0.05 / 3 * (normalized[1:, None] * steps / 0.2**2).sum(axis=0)
    np.testing.assert_allclose(session.result, expected, rtol=1e-4)


@pytest.mark.parametrize("name", ["gradient", "pivot", "sequential", "average", "batch"])
def test_equal_returns_change_nothing(name: str) -> None:
    """Where all episodes return the same the policy stays as it was."""
    session = OPERATORS[name].start(np.full(6, 0.3, np.float32), np.random.default_rng(0))
    while session.ask() is not None:
        session.tell(0.1)
    np.testing.assert_array_equal(session.result, np.full(6, 0.3, np.float32))


def test_batch_takes_the_best_of_a_round_and_average_the_mean() -> None:
    """In a batch one proposal above the incumbent suffices; an averaged one needs the mean."""
    batch = HillClimb(mode="batch", queries=1, parallel=3, sigma=0.1)
    session = batch.start(np.zeros(4, np.float32), np.random.default_rng(0))
    asked = []
    for v in (0.0, 0.0, 0.0, -5.0, 1.0, -5.0):
        asked.append(session.ask())
        session.tell(v)
    np.testing.assert_array_equal(session.result, asked[4])
    average = HillClimb(mode="average", queries=1, parallel=3, sigma=0.1)
    session = average.start(np.zeros(4, np.float32), np.random.default_rng(0))
    for v in (0.0, 0.0, 0.0, -5.0, 1.0, -5.0):
        session.ask()
        session.tell(v)
    assert not session.result.any()


def steps(operator: HillClimb, returns: list[float]) -> list[np.ndarray]:
    """Return the steps from the incumbent to each proposal, in units of its noise, (3,) each."""
    noise = operator.draw(np.random.default_rng(0), 3)
    session = operator.start(np.zeros(3, np.float32), np.random.default_rng(0))
    found, told = [], iter(returns)
    while (theta := session.ask()) is not None:
        found.append(theta - session.result)
        session.tell(next(told))
    return [step / perturbation for step, perturbation in zip(found[1:], noise, strict=True)]


def test_an_annealed_climb_takes_ever_smaller_steps() -> None:
    """Sigma is halved from round to round, whether a proposal was better or not."""
    operator = OPERATORS["annealed"]
    assert isinstance(operator, HillClimb)
    found = steps(operator, [0.0, 1.0, 0.5, 2.0, 0.0])
    for step, sigma in zip(found, (0.2, 0.1, 0.05, 0.025), strict=True):
        np.testing.assert_allclose(step, sigma, rtol=1e-4)


def test_the_one_fifth_rule_holds_the_step_at_one_success_in_five() -> None:
    """A success is worth four failures: after one of five rounds sigma is what it was."""
    operator = OPERATORS["one fifth"]
    assert isinstance(operator, HillClimb)
    found = steps(operator, [0.0, -1.0, -1.0, 1.0, 0.5, 0.5, 0.5])
    sizes = [float(step.mean()) for step in found]
    down = 1.5**-0.25
    ideal = [0.1, 0.1 * down, 0.1 * down**2, 0.15 * down**2, 0.15 * down**3, 0.1]
    np.testing.assert_allclose(sizes, ideal, rtol=1e-3)


def test_each_operator_says_what_it_spends() -> None:
    """In words, for the log of a training and of a deployment."""
    assert str(OPERATORS["none"]) == "no adaptation"
    assert str(OPERATORS["gradient"]) == "a gradient step, 6 episodes: 1 unperturbed, 5 perturbed"
    assert str(OPERATORS["again"]) == (
        "batch hill climbing, 9 episodes: 1 of the policy so far in each round, 3 rounds of 2"
    )
    for name, operator in OPERATORS.items():
        assert name == "none" or f" {EPISODES[name]} episodes" in str(operator)


def test_a_budget_that_does_not_fit_is_refused() -> None:
    """The sentence says what would fit; the budget itself, or none, is accepted."""
    batch: dict[str, Any] = {"mode": "batch", "parallel": 7, "sigma": 0.1, "incumbent_episodes": 1}
    HillClimb(**batch, queries=7, budget=50)
    with pytest.raises(
        ValueError, match=r"budget=50 .* 57 episodes.*; queries=7 spends 50, or leave"
    ):
        HillClimb(**batch, queries=8, budget=50)
    with pytest.raises(ValueError, match="queries=6 spends 48"):
        HillClimb(**batch, queries=7, reevaluate_incumbent=True, budget=50)
    with pytest.raises(ValueError, match=r"budget=5 does not fit a gradient step, 6 .* queries=4,"):
        GradientAdaptation(queries=5, sigma=0.1, rate=0.05, baseline="mean", budget=5)


def test_a_lucky_incumbent_is_forgiven_only_when_run_again() -> None:
    """After a lucky first value only a climb that runs its incumbent again accepts a proposal."""

    def climb(again: bool) -> np.ndarray:
        operator = HillClimb(
            mode="sequential", queries=2, parallel=1, sigma=0.1, reevaluate_incumbent=again
        )
        session = operator.start(np.zeros(4, np.float32), np.random.default_rng(0))
        returns = [100.0, 0.0, 0.0, 5.0] if again else [100.0, 0.0, 5.0]
        for v in returns:
            session.ask()
            session.tell(v)
        return session.result

    assert not climb(again=False).any()
    assert climb(again=True).any()


def test_first_order_gradient_is_taken_where_adaptation_arrives() -> None:
    """Over many draws the estimate points along the gradient at the adapted parameters."""
    operator = FirstOrder(GradientAdaptation(queries=9, sigma=0.1, rate=0.05, baseline="mean"), 40)
    noise = np.random.default_rng(0).standard_normal((20, operator.queries, 3), dtype=np.float32)
    cohort = operator.start_batch(np.zeros((20, 3), np.float32), noise)
    target = np.array([1.0, -2.0, 0.5])
    for _ in range(len(operator.stages)):
        members = np.repeat(np.arange(20), len(cohort.available(0)))
        episodes = np.tile(np.array(cohort.available(0)), 20)
        thetas = cohort.candidates(members, episodes)
        cohort.tell(members, episodes, -((thetas - target) ** 2).sum(axis=1))
    truth = target - cohort.results
    cosine = (cohort.gradients * truth).sum(axis=1)
    cosine /= np.linalg.norm(cohort.gradients, axis=1) * np.linalg.norm(truth, axis=1)
    assert cosine.mean() > 0.9
    assert np.abs(cohort.results).max() > 0.1


def test_bad_input_is_refused() -> None:
    """Impossible operators and returns are errors that name the value."""
    with pytest.raises(ValueError, match="must be 1"):
        HillClimb(mode="sequential", queries=2, parallel=3, sigma=0.1)
    with pytest.raises(ValueError, match="mode='greedy'"):
        HillClimb(mode=cast(Any, "greedy"), queries=2, parallel=1, sigma=0.1)
    with pytest.raises(ValueError, match="grow=0"):
        HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1, grow=0)
    with pytest.raises(ValueError, match="queries=0"):
        GradientAdaptation(queries=0, sigma=0.1, rate=0.1, baseline="mean")
    with pytest.raises(ValueError, match="finite"):
        OPERATORS["sequential"].start(np.zeros(3), np.random.default_rng(0)).tell(float("nan"))
    with pytest.raises(ValueError, match="gradient adaptation"):
        FirstOrder(OPERATORS["batch"], 10)
