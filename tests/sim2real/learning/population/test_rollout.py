"""Whole episodes of a policy: returns, lengths and ends are those of the rows."""

from functools import partial

import numpy as np
import torch
from torch import nn
from torchrl.envs import EnvBase

from envs import MujocoEnv, Simulation
from envs.tasks import Hopper
from envs.toys import Nav2D, ToyEnv
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.acting import Acting
from sim2real.learning.population.rollout import run_episodes


class Constant(nn.Module):
    """The same action whatever is seen."""

    def __init__(self, *action: float) -> None:
        super().__init__()
        self.action = torch.tensor(action)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return it for each row."""
        return self.action.expand(len(observation), -1)


def world(base: partial[EnvBase], count: int) -> EnvBase:
    """Return an environment of so many rows."""
    return EnvironmentFactory(base).make(count)


def test_a_policy_that_stays_is_paid_its_distance() -> None:
    """In Nav-2D each of 20 steps costs the squared distance to the goal."""
    goals = np.array([[0.3, 0.4], [-0.6, 0.8]])
    env = world(partial(ToyEnv, partial(Nav2D, max_steps=20)), 2)
    played = run_episodes(env, Acting(Constant(0.0, 0.0)), goals, np.arange(2, dtype=np.uint64))
    np.testing.assert_allclose(played.returns, -20 * np.square(goals).sum(axis=1), rtol=1e-6)
    assert played.lengths.tolist() == [20, 20] and not played.failed.any()


def test_episodes_that_end_early_are_paid_no_more() -> None:
    """A falling Hopper's return and length are those of stepping it alone until it falls."""
    seeds = np.arange(3, dtype=np.uint64)
    env, actor = world(partial(MujocoEnv, task=Hopper()), 3), Acting(Constant(0.4, -0.2, 0.1))
    played = run_episodes(env, actor, np.zeros((3, 0)), seeds)
    assert len(set(played.lengths.tolist())) > 1
    for number, seed in enumerate(seeds):
        rows, total, steps, over = Simulation(Hopper(), 1, threads=1), 0.0, 0, False
        rows.reset(np.zeros(1, np.int64), np.zeros((1, 0)), np.array([seed]))
        while not over:
            step = rows.step(None, torch.tensor([[0.4, -0.2, 0.1]]).double().numpy())
            total, steps = total + step.reward[0], steps + 1
            over = bool(step.terminated[0] | step.truncated[0])
        assert steps == played.lengths[number]
        np.testing.assert_allclose(played.returns[number], total, rtol=1e-6)  # float32 rewards
