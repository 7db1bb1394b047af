"""Policies that are told their robot's parameters: what they see, and what is refused."""

from typing import Any

import numpy as np
import pytest
import torch

from sim2real.config.compose import compose
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.environment import EnvironmentFactory, environment_of
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import make_learner

HOPPER = ["env=hopper", "params=mass_friction", "transforms=with_params"]
ROBOTS = np.array([[1.0, 1.5], [9.0, 2.5], [5.0, 2.25], [11.0, 0.2]])
SEEDS = np.arange(4, dtype=np.uint64)
SMALL = ["algorithm.num_rows=4", "env.task.max_steps=20", "seed=3"]
ES = [*HOPPER, "policy=mlp", *SMALL, "algorithm.shards=1", "algorithm.pairs=2"]
PPO = [
    *("env=hopper", "params=mass_friction", "transforms=normalized_with_params", "algorithm=ppo"),
    *(*SMALL, "algorithm.steps=16", "algorithm.minibatch_size=32", "algorithm.epochs=1"),
]
SAC = [
    *("env=hopper", "params=mass_friction", "transforms=with_params", "algorithm=sac"),
    *("env.task.max_steps=20", "seed=3", "algorithm.num_rows=2", "policy.actor.num_cells=[8]"),
    *("policy.qvalue.num_cells=[8]", "algorithm.steps=8", "algorithm.warmup_frames=4"),
    "algorithm.batch_size=8",
]


def hopper(*words: str) -> EnvironmentFactory:
    """Return Hoppers of which the policy is told mass and friction."""
    return environment_of(compose([*HOPPER, *words]))


def learner(words: list[str]) -> Algorithm:
    """Return what trains."""
    return make_learner(words)


@pytest.fixture(scope="module")
def trained() -> TrainedPolicy:
    """Return a small policy of evolution strategies, after an iteration."""
    made = learner(ES)
    made.iterate()
    return made.trained()


def test_parameters_stand_behind_the_observation_over_their_range() -> None:
    """Ends of the range of training are -1 and 1; a robot outside is told as the nearest one."""
    told = hopper().context_spec
    assert told is not None and told.names == ("link_mass.torso", "ground_friction")
    observation = hopper().rows(4).reset(np.arange(4), ROBOTS, SEEDS)
    plain = environment_of(compose(["env=hopper", "params=mass_friction", "transforms=none"]))
    same = plain.make(4, threads=1).reset(values=ROBOTS, seeds=SEEDS)["observation"]
    np.testing.assert_allclose(observation[:, :11], same, atol=1e-6)
    np.testing.assert_allclose(observation[:, 11:], [[-1, -1], [1, 1], [0, 0.5], [1, -1]])
    wide = hopper("transforms.with_params.limit=2.0").rows(4).reset(np.arange(4), ROBOTS, SEEDS)
    np.testing.assert_allclose(wide[3, 11:], [1.5, -2.0])


def test_another_base_is_told_the_same() -> None:
    """A robot that says nothing of itself is told the middle, of the same parameters."""
    env = hopper("transforms.with_params.limit=2.0")
    other = env.with_base(env.base)
    assert (
        other.context_spec is env.context_spec
        and not hopper("transforms.with_params.truth=false").context_is_true
    )
    assert other.with_base(other.base).context_spec is env.context_spec and other.context_is_true
    seen = other.make(3, threads=1).reset()["observation"]
    assert seen.shape == (3, 13) and (seen[:, 11:] == 0).all()
    untold = hopper("transforms.with_params.truth=false").rows(4)
    assert (untold.reset(np.arange(4), ROBOTS, SEEDS)[:, 11:] == 0).all()


def test_a_robot_that_is_told_the_middle_stays_what_it_is() -> None:
    """Without the truth the rows move as those of robots that nobody is told of."""
    untold = hopper("transforms.with_params.truth=false").rows(4)
    plain = hopper().rows(4)
    action = np.random.default_rng(0).uniform(-1, 1, (4, 3))
    for rows in (untold, plain):
        rows.reset(np.arange(4), ROBOTS, SEEDS)
    for _ in range(20):
        moved, as_told = untold.step(None, action), plain.step(None, action)
    np.testing.assert_array_equal(moved.observation[:, :11], as_told.observation[:, :11])
    assert np.ptp(moved.observation[:, 0]) > 1e-3  # and they are not all the same robot


@pytest.mark.parametrize("products", ["false", "true"])
def test_rows_and_environment_tell_the_same(products: str) -> None:
    """Populations and TorchRL's collectors see the same numbers, products among them."""
    env = hopper(f"transforms.with_params.products={products}")
    rows, world = env.rows(4), env.make(4, threads=1)
    now, seen = world.reset(values=ROBOTS, seeds=SEEDS), rows.reset(np.arange(4), ROBOTS, SEEDS)
    action = np.random.default_rng(0).uniform(-1, 1, (4, 3))
    for _ in range(3):
        np.testing.assert_allclose(now["observation"], seen, atol=1e-5)
        now = world.step(now.set("action", torch.tensor(action, dtype=torch.float32)))["next"]
        seen = rows.step(None, action).observation
    if products == "true":
        np.testing.assert_allclose(seen[:, 13:24], seen[:, :11] * seen[:, 11:12])
        assert seen.shape == (4, 11 + 2 + 22)


def test_told_the_truth_a_robot_s_policy_is_the_oracle(trained: TrainedPolicy) -> None:
    """The same observation gets another action under other parameters, the oracle's if true."""
    env = trained.make_env(4, threads=1)
    now = env.reset(values=ROBOTS, seeds=SEEDS)
    with torch.no_grad():
        wanted = trained.actor(trained.theta)(now)["action"].numpy()
    assert trained.context is not None
    raw = now["observation"][:, :11].numpy()
    said = trained.context.normalize(ROBOTS, 1.0)
    np.testing.assert_allclose(trained.controller(num_rows=4, said=said)(raw), wanted, atol=1e-5)
    middle = trained.controller(num_rows=4)(raw)
    np.testing.assert_allclose(
        trained.controller(num_rows=4, said=np.zeros(2))(raw), middle, atol=1e-9
    )
    assert np.abs(middle - wanted).max(axis=1).min() > 1e-3
    behind = np.concatenate([trained.theta, said[0]]).astype(np.float32)
    np.testing.assert_allclose(trained.controller(behind)(raw[:1]), wanted[:1], atol=1e-5)


@pytest.mark.parametrize("words", [ES, PPO, SAC], ids=["es", "ppo", "sac"])
def test_the_program_takes_parameters_in_their_units(words: list[str]) -> None:
    """Any algorithm's policy is one program of raw observations with kg and coefficients."""
    made = learner(words)
    made.iterate()
    trained = made.trained()
    env = trained.make_env(4, threads=1)
    now = env.reset(values=ROBOTS[:3].repeat(2, 0)[:4], seeds=SEEDS)
    robots = np.stack([now["params", name].numpy() for name in trained.context.names], -1)  # type: ignore[union-attr]
    shown: Any = env.base_env._last
    raw = np.hstack([shown, robots])
    assert trained.program is not None
    with torch.no_grad():
        said = trained.program(trained.theta)(torch.from_numpy(raw)).numpy()
    pilot = trained.controller(num_rows=4, said=trained.context.normalize(robots, 1.0))  # type: ignore[union-attr]
    np.testing.assert_allclose(said, pilot(shown), atol=1e-4)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["params=none"], "params draws nothing"),
        (["params=mass_friction", "params.draws.0.high=1.0"], "link_mass.torso = 1"),
        (["transforms.with_params.limit=0.5"], "limit=0.5 must be at least 1"),
    ],
)
def test_what_cannot_be_told_is_refused(words: list[str], sentence: str) -> None:
    """Tasks that draw nothing, a range without width, a limit inside the range."""
    with pytest.raises(Sim2RealError, match=sentence):
        hopper(*words).make(2, threads=1)
