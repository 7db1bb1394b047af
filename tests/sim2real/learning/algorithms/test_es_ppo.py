"""Evolution strategies over policies that adapt by PPO: rows, shards, resuming, learning."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import nn
from torchrl.modules import MLP

from envs.toys import AngleBias, BiasedCartPole
from sim2real.config.compose import compose
from sim2real.learning.adapt import HillClimb, NoAdaptation
from sim2real.learning.algorithms.base import build
from sim2real.learning.algorithms.esmaml import ESMAML
from sim2real.learning.modules.actor_critic import actor_critic
from sim2real.learning.population.population import Population, PopulationRequest, PopulationResult
from sim2real.learning.population.remote import ClusterError, RemotePopulation
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.learning.adapt.test_ppo import ADAPT
from tests.sim2real.learning.algorithms.test_esmaml import OPTIONS, SMALL, made
from tests.sim2real.trained import make_learner

NETWORK = partial(MLP, num_cells=[8], activation_class=nn.ReLU)
POLICY = partial(actor_critic, actor=NETWORK, critic=NETWORK, log_std=0.5, orthogonal=False)
QUICK = replace(ADAPT, rounds=2)
OWN: dict[str, Any] = {**OPTIONS, **SMALL, "critic": True, "pairs": 3, "final_episodes": 2}


def small(adapt: Any = QUICK, seed: int = 0, **changes: Any) -> ESMAML:
    """Return the algorithm on CartPole."""
    return made(BiasedCartPole, AngleBias(), POLICY, adapt, seed, **{**OWN, **changes})


def members(algorithm: ESMAML, count: int = 7) -> PopulationRequest:
    """Return members with parameters, robots and seeds of their own."""
    rng, adapt = np.random.default_rng(0), algorithm._operator()
    noise = rng.standard_normal((count, len(algorithm.theta))).astype(np.float32)
    thetas = algorithm.theta + np.float32(0.1) * noise
    values = AngleBias().sample(rng, count)
    seeds = rng.integers(0, 2**63, (count, adapt.episodes + 2), dtype=np.uint64)
    none = np.zeros((count, 0, len(algorithm.theta)), np.float32)
    return PopulationRequest(adapt.start_batch(thetas, none), values, values / 2, seeds)


def test_rows_and_shards_change_no_bit() -> None:
    """One row, several, more than there are members, two shards: the same results and sums."""
    algorithm = small()
    algorithm.iterate()

    def run(counts: list[int]) -> PopulationResult:
        rows = [BiasedCartPole(count) for count in counts]
        return Population(rows, algorithm.policy).run(members(algorithm), algorithm.normalizer)

    first = run([1])
    assert first.returns.shape == (7, 4) and (first.lengths[:, :2] == 40).all()
    assert first.frames == 7 * 80 + first.lengths[:, 2:].sum()
    for counts in ([7], [40], [3, 2]):
        again = run(counts)
        for name in ("returns", "lengths", "failed", "thetas", "sums", "squares", "paid"):
            found, expected = getattr(again, name), getattr(first, name)
            np.testing.assert_array_equal(found, expected, err_msg=name)


def test_the_final_episodes_are_those_of_what_was_learned() -> None:
    """Played by an unchanging population, the adapted parameters earn the same."""
    algorithm = small()
    one = members(algorithm)
    results = algorithm.population.run(one, algorithm.normalizer)
    assert (np.abs(results.thetas - members(algorithm).cohort.results) > 0).any(axis=1).all()
    cohort = NoAdaptation().start_batch(results.thetas, np.zeros((7, 0, 1), np.float32))
    fresh = PopulationRequest(cohort, one.final_values, one.final_values, one.seeds[:, 2:])
    played = algorithm.population.run(fresh, algorithm.normalizer)
    np.testing.assert_array_equal(played.returns, results.final)


def test_training_resumes_bit_for_bit() -> None:
    """Another seed, other rows and two shards: after the state is loaded, the same numbers."""
    one = small()
    one.iterate()
    other = small(seed=5, num_rows=5, shards=2)
    other.load_state_dict(one.state_dict())
    assert one.iterate() == other.iterate()
    np.testing.assert_array_equal(one.theta, other.theta)
    first, second = one.trained().critic, other.trained().critic
    assert first is not None and second is not None
    assert first.unit == second.unit > 1.0


@pytest.mark.slow
def test_it_learns_where_ppo_leads() -> None:
    """The return after two rounds of PPO rises by half, and is above that of the rounds."""
    search = {"pairs": 12, "num_rows": 24, "sigma": 0.3, "learning_rate": 0.2}
    algorithm = small(replace(QUICK, steps=64), **search, shaping="centred_ranks")
    metrics = [algorithm.iterate() for _ in range(16)]
    first, last = metrics[:3], metrics[-3:]
    after = np.mean([one["train/return"] for one in last])
    assert after > 1.5 * np.mean([one["train/return"] for one in first])
    assert after > np.mean([one["train/return_before"] for one in last])


def test_what_is_trained_is_the_actor_and_its_critic() -> None:
    """The actor's parameters act; the critic stands beside it; both adapt on one robot."""
    algorithm = small()
    algorithm.iterate()
    trained = algorithm.trained()
    assert trained.critic is not None
    critic = sum(p.numel() for p in trained.critic.module.parameters())
    assert len(trained.theta) + critic == len(algorithm.theta)
    values = AngleBias().sample(np.random.default_rng(0), 1)[0]
    found = algorithm.adapted(values, np.random.default_rng(1))
    assert found is not None and found.shape == trained.theta.shape
    assert not np.array_equal(found, trained.theta)
    other = small(HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1))
    other.load_state_dict(algorithm.state_dict())  # which adapts otherwise, too
    scores = other.scores(values[None], np.array([3], np.uint64), 2)
    assert scores.after.shape == (1, 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["es_ppo", "es_ppo_lite"])
def test_the_experiments_search_the_whole_policy(name: str, tmp_path: Path) -> None:
    """Two small iterations: 64 or 192 pairs of actor, log-deviation and critic [128, 64]."""
    few = ["algorithm.pairs=2", "algorithm.num_rows=4", "adapt.steps=16", "env.task.max_steps=12"]
    settings = compose([f"+experiment={name}"])["algorithm"]
    assert settings["pairs"] == {"es_ppo": 192, "es_ppo_lite": 64}[name]
    algorithm = make_learner([f"+experiment={name}", *few, "logger=csv"], tmp_path)
    for _ in range(2):
        metrics = algorithm.iterate()
    networks = [(11 + 1) * 128 + (128 + 1) * 64 + (64 + 1) * outputs for outputs in (3, 1)]
    assert len(algorithm.parts.adapt.stages) == 6 and np.isfinite(list(metrics.values())).all()
    assert isinstance(algorithm, ESMAML) and len(algorithm.theta) == sum(networks) + 3


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """A critic that is not searched or not there, and a cluster, which tells returns alone."""
    lacking = small(critic=False)
    with pytest.raises(Sim2RealError, match=r"algorithm\.critic=true"):
        build(lambda parts: lacking, lacking.parts)
    actor = partial(actor_critic, actor=NETWORK, critic=None)
    with pytest.raises(Sim2RealError, match="but found none; train with policy=actor_"):
        made(BiasedCartPole, AngleBias(), actor, QUICK, 0, **OWN)
    algorithm = small()
    remote = RemotePopulation([], algorithm.policy, algorithm.population.space)
    with pytest.raises(ClusterError, match="use cluster=none"):
        remote.run(members(algorithm), None)
