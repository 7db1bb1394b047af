"""Populations: rows, shards and refilling change nothing; numbers are those of a plain loop."""

import numpy as np
import pytest

from envs.toys import AngleBias, BiasedCartPole, Nav2D
from sim2real.learning.adapt import Adaptation, GradientAdaptation, HillClimb, NoAdaptation
from sim2real.learning.modules.mlp_policy import MLPPolicy
from sim2real.learning.modules.normalizer import Normalizer
from sim2real.learning.population.population import (
    Population,
    PopulationRequest,
    PopulationResult,
    evaluate_adaptation,
)

MEMBERS, FINALS = 12, 2
OPERATORS = [
    NoAdaptation(),
    GradientAdaptation(queries=4, sigma=0.1, rate=0.1, baseline="mean"),
    HillClimb(mode="sequential", queries=3, parallel=1, sigma=0.3),
    HillClimb(
        mode="batch",
        queries=2,
        parallel=2,
        sigma=0.3,
        incumbent_episodes=1,
        reevaluate_incumbent=True,
    ),
]


def make_policy() -> MLPPolicy:
    """Policy for CartPole."""
    limit = np.array([10.0])
    return MLPPolicy(
        4, 1, -limit, limit, hidden=(8,), activation="tanh", output="tanh", initial="normal"
    )


def make_members(adapt: Adaptation) -> PopulationRequest:
    """Members with tasks, seeds and perturbations of their own; the same at each call."""
    rng, policy = np.random.default_rng(0), make_policy()
    thetas = np.stack([policy.initial(rng) for _ in range(MEMBERS)])
    rngs = [np.random.default_rng(i) for i in range(MEMBERS)]
    values = AngleBias().sample(rng, MEMBERS)
    seeds = rng.integers(0, 2**63, (MEMBERS, adapt.episodes + FINALS), dtype=np.uint64)
    return PopulationRequest(adapt.start_many(thetas, rngs), values, values / 2, seeds)


def make_normalizer() -> Normalizer:
    """Normalizer that has seen something."""
    normalizer = Normalizer(4)
    seen = np.random.default_rng(1).normal([0.1, 0, 0.02, 0], [0.5, 1, 0.1, 1], (100, 4))
    normalizer.update(100, seen.sum(axis=0), (seen**2).sum(axis=0))
    return normalizer


def run(adapt: Adaptation, counts: list[int], refill: int = 1) -> PopulationResult:
    """Run the members over shards of these numbers of rows."""
    population = Population([BiasedCartPole(n) for n in counts], make_policy(), refill)
    return population.run(make_members(adapt), make_normalizer())


def assert_same(one: PopulationResult, other: PopulationResult) -> None:
    """Require the same bits everywhere."""
    for name in ("returns", "lengths", "failed", "thetas", "sums", "squares"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("adapt", OPERATORS, ids=lambda a: type(a).__name__)
def test_rows_shards_and_refilling_change_no_bit(adapt: Adaptation) -> None:
    """One row, many rows, several shards and lazy refilling give the same results and sums."""
    expected = run(adapt, [1])
    for counts, refill in (([7], 1), ([64], 1), ([3, 4], 1), ([2, 1, 5], 2), ([16, 16], 5)):
        assert_same(expected, run(adapt, counts, refill))


@pytest.mark.parametrize("adapt", OPERATORS, ids=lambda a: type(a).__name__)
def test_equals_a_plain_loop_over_sessions(adapt: Adaptation) -> None:
    """Each member's returns are those of a session that runs its episodes one by one."""
    results, members, normalizer = run(adapt, [5, 3]), make_members(adapt), make_normalizer()
    policy, rows = make_policy(), BiasedCartPole(1)
    for member in range(MEMBERS):
        session = adapt.start(members.cohort.results[member], np.random.default_rng(member))
        for episode, seed in enumerate(members.seeds[member]):
            theta = session.ask()
            adapting = theta is not None
            values = members.values if adapting else members.final_values
            slots = policy.slots(1)
            slots.load(np.array([0]), (theta if adapting else session.result)[None])
            observation = rows.reset(np.array([0]), values[member : member + 1], np.array([seed]))
            total, over = 0.0, False
            while not over:
                action = slots.act(None, (observation - normalizer.mean) / normalizer.std)
                step = rows.step(None, action)
                observation, total = step.observation, total + float(step.reward[0])
                over = bool(step.terminated[0] | step.truncated[0])
            assert results.returns[member, episode] == total
            if adapting:
                session.tell(total)
        np.testing.assert_array_equal(results.thetas[member], session.result)


def test_observation_statistics_are_those_of_all_steps() -> None:
    """The normalizer's mean and std are those of every observation that a policy acted on."""
    seen: list[np.ndarray] = []

    class Recorder(BiasedCartPole):
        def reset(self, ids, values, seeds):
            seen.append(super().reset(ids, values, seeds))
            return seen[-1]

        def step(self, ids, action):
            step = super().step(ids, action)
            seen.append(step.observation[~(step.terminated | step.truncated)])
            return step

    adapt, normalizer = OPERATORS[2], Normalizer(4)
    results = Population([Recorder(5)], make_policy()).run(make_members(adapt), normalizer)
    normalizer.update(results.frames, results.sums, results.squares)
    everything = np.concatenate(seen)
    assert len(everything) == results.frames
    np.testing.assert_allclose(normalizer.mean, everything.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(normalizer.std, everything.std(axis=0), rtol=1e-9)


def test_normalizer_merges_batches_exactly() -> None:
    """Updates in parts give mean and std of the whole, even far from 0; constants keep std 1."""
    data = np.random.default_rng(0).normal([1e3, -5, 0], [0.1, 2, 1], (300, 3))
    data[:, 2] = 4
    normalizer = Normalizer(3)
    for part in np.split(data, [50, 120]):
        centred = part - normalizer.mean
        normalizer.update(len(part), centred.sum(axis=0), (centred**2).sum(axis=0))
    np.testing.assert_allclose(normalizer.mean, data.mean(axis=0))
    np.testing.assert_allclose(normalizer.std[:2], data.std(axis=0)[:2], rtol=1e-6)
    other = Normalizer(3)
    other.load_state_dict(normalizer.state_dict())
    np.testing.assert_array_equal(other.std, normalizer.std)


def test_an_error_in_a_shard_reaches_the_caller() -> None:
    """An environment that fails in another thread ends the run with its own error."""

    class Broken(BiasedCartPole):
        def step(self, ids, action):
            raise RuntimeError("the disk is full")

    population = Population([BiasedCartPole(2), Broken(2)], make_policy())
    with pytest.raises(RuntimeError, match="the disk is full"):
        population.run(make_members(NoAdaptation()), None)


def test_failed_episodes_are_flagged_and_their_rows_go_on() -> None:
    """An episode that broke is flagged, keeps its return up to there, and spoils no other."""

    class Fragile(BiasedCartPole):
        def step(self, ids, action):
            step = super().step(ids, action)
            rows = slice(None) if ids is None else ids
            broken = (self._steps[rows] == 3) & (self._values[rows, 0] > 0)
            reward = np.where(broken, 0.0, step.reward)
            return step._replace(reward=reward, terminated=step.terminated | broken, failed=broken)

    members = make_members(NoAdaptation())
    whole = Population([BiasedCartPole(4)], make_policy()).run(members, None)
    results = Population([Fragile(4)], make_policy()).run(make_members(NoAdaptation()), None)
    struck = np.repeat(members.final_values > 0, FINALS, axis=1)
    np.testing.assert_array_equal(results.failed, struck)
    assert (results.returns[struck] == 2).all()
    np.testing.assert_array_equal(results.returns[~struck], whole.returns[~struck])


def test_evaluation_scores_before_and_after_on_the_same_fresh_episodes() -> None:
    """Without adaptation both scores are equal and run once; with it they differ."""
    rng, policy = np.random.default_rng(0), make_policy()
    population, theta = Population([BiasedCartPole(6)], policy), policy.initial(rng)
    values = AngleBias().sample(rng, 4)
    seeds = rng.integers(0, 2**63, 4, dtype=np.uint64)
    none = evaluate_adaptation(population, theta, None, NoAdaptation(), values, seeds, 5)
    np.testing.assert_array_equal(none.before, none.after)
    climb = evaluate_adaptation(population, theta, None, OPERATORS[2], values, seeds, 5)
    assert climb.before.shape == climb.after.shape == (4, 5)
    assert (climb.after.mean(axis=1) != climb.before.mean(axis=1)).any()
    assert none.steps == none.before.sum() + (none.before < 500).sum()  # run once for both


def test_bad_members_are_refused() -> None:
    """Members whose arrays do not agree are refused before anything runs."""
    adapt = OPERATORS[2]
    cohort = adapt.start_many(np.zeros((3, 9), np.float32), [np.random.default_rng(0)] * 3)
    with pytest.raises(ValueError, match="3 members"):
        PopulationRequest(cohort, np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((2, 9), np.uint64))
    with pytest.raises(ValueError, match="at least 1"):
        Population([], make_policy())
    assert Population([Nav2D(3), Nav2D(4)], make_nav_policy()).num_rows == 7


def make_nav_policy() -> MLPPolicy:
    """Policy for Nav-2D."""
    limit = np.full(2, 0.1)
    return MLPPolicy(
        2, 2, -limit, limit, hidden=(), activation="tanh", output="linear", initial="zero"
    )
