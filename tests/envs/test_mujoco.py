"""The TorchRL environment over a simulation."""

import numpy as np
import torch

from envs.mujoco import MujocoEnv
from envs.simulation import Simulation
from envs.tasks import Hopper


def test_it_is_its_simulation() -> None:
    """A step's observation and reward are those of the simulation from the same seeds, rounded."""
    env = MujocoEnv(Hopper(), 5, threads=2, seed=4)
    td = env.reset()
    seeds = np.random.default_rng(4).integers(0, 2**63, 5).astype(np.uint64)
    plain = Simulation(Hopper(), 5, threads=1)
    first = plain.reset(np.arange(5), np.zeros((5, 0)), seeds)
    first = np.asarray(first, np.float32)
    np.testing.assert_array_equal(td["observation"].numpy(), first)
    td = env.rand_action(td)
    step = plain.step(None, np.asarray(td["action"], np.float64))
    data = env.step(td)["next"]
    np.testing.assert_array_equal(data["observation"].numpy(), step.observation.astype(np.float32))
    np.testing.assert_array_equal(data["reward"][:, 0].numpy(), step.reward.astype(np.float32))
    assert env.simulation.num_rows == 5


def test_actions_are_bounded_as_the_actuators() -> None:
    """Random actions fill the actuators' range and keep within it."""
    env = MujocoEnv(Hopper(), 200, threads=1)
    action = env.rand_action(env.reset())["action"]
    assert action.shape == (200, 3)
    assert action.abs().max() <= 1.0
    assert action.std() > 0.5


def test_a_policy_with_gradients_can_act() -> None:
    """Actions that carry gradients are taken without them."""
    env = MujocoEnv(Hopper(), 2, threads=1)
    weight = torch.zeros(11, 3, requires_grad=True)
    rollout = env.rollout(3, lambda td: td.set("action", td["observation"] @ weight))
    assert not rollout["next", "reward"].requires_grad
