"""Training on MuJoCo Warp, on its CPU device: a population's episodes, and PPO's iterations."""

import os
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.mujoco import MujocoEnv
from envs.randomization import Draw, Randomization
from envs.tasks import Hopper
from sim2real.config.compose import compose, instantiate
from sim2real.learning.adapt import HillClimb
from sim2real.learning.algorithms.base import build
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.device_slots import Slots
from sim2real.learning.population.population import (
    Population,
    PopulationRequest,
    PopulationResult,
    draw_seeds,
)
from sim2real.runs.errors import Sim2RealError

if find_spec("mujoco_warp") is None and "SIM2REAL_GPU_EXTRA" not in os.environ:
    pytest.skip("needs MuJoCo Warp: pip install 'sim2real[gpu]'", allow_module_level=True)


def adapted(physics: str) -> tuple[PopulationResult, float]:
    """Five members that adapt by hill climbing, in four rows of an engine; the part in use."""
    draws = Randomization([Draw(make("link_mass", where="torso"), low=0.0, high=2.0)])
    base: Any = partial(MujocoEnv, task=Hopper(max_steps=30), physics=physics)
    environment = EnvironmentFactory(base, draws)
    with_policy = compose(["policy=linear"])
    _, given = instantiate(with_policy, Path())
    policy = given["parts"].policy(environment.on_host.make(1, threads=1))
    rows = environment.rows(4, 1)
    draws.check(rows.space)
    rng = np.random.default_rng(0)
    thetas = 0.1 * rng.standard_normal((5, policy.num_parameters)).astype(np.float32)
    adapt = HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1)
    cohort = adapt.start_many(thetas, [np.random.default_rng(i) for i in range(5)])
    values = draws.sample(rng, 5)
    seeds = draw_seeds(rng, (5, adapt.episodes + 1))
    population = Population([rows], policy)
    return population.run(PopulationRequest(cohort, values, values, seeds), None), population.in_use


@pytest.mark.slow
def test_a_population_is_the_same_on_both_engines() -> None:
    """Episodes taken from one queue, common random numbers, adaptation between them."""
    (batch, whole), (warp, used) = adapted("batch"), adapted("warp")
    assert np.array_equal(batch.lengths, warp.lengths)
    assert np.allclose(batch.returns, warp.returns, rtol=1e-4, atol=1e-3)
    assert np.array_equal(batch.thetas, warp.thetas)
    assert whole == used
    assert 0.5 < used <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_collects_where_the_tensors_are(algorithm: str) -> None:
    """An iteration of each, resets included, with finite numbers; it can be resumed."""
    small = {
        "ppo": ["algorithm.num_rows=4", "algorithm.steps=32", "algorithm.minibatch_size=32"],
        "sac": ["algorithm.num_rows=4", "algorithm.steps=8", "algorithm.warmup_frames=16"],
    }[algorithm]
    _, given = instantiate(
        compose([f"algorithm={algorithm}", "env.physics=warp", "params=mass_friction", *small]),
        Path(),
    )
    learner: Any = build(given["algorithm"], given["parts"])
    for _ in range(3):
        found = learner.iterate()
    assert learner.frames == 3 * 4 * (32 if algorithm == "ppo" else 8)
    assert all(np.isfinite(v) for k, v in found.items() if k.startswith("train/loss"))
    assert learner.trained().run_episodes(np.arange(2, dtype=np.uint64)).returns.shape == (2,)


def test_what_a_device_cannot_act_by_is_refused_by_name() -> None:
    """A population on a device takes perceptrons."""
    rows = MujocoEnv(Hopper(), 2).rows
    with pytest.raises(Sim2RealError, match="populations of perceptrons, not of a str"):
        Slots("a policy", rows)
