"""Grounded actions: in the simulator, in no world that stands for a robot."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from envs.mujoco import MujocoEnv
from envs.tasks import CartPole
from sim2real.learning.collectors.fast import FastCollector
from sim2real.learning.environment import Environment
from sim2real.learning.grounding import Ground, read, write
from sim2real.learning.modules.acting import Acting, Actor
from sim2real.runs.errors import Sim2RealError

WEIGHTS = torch.tensor([[0.5, 0.0, 0.0, 0.0, -0.6]])  # what is seen, and what is said


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file that adds half of the cart's place less 0.6 of the action."""
    layer = nn.Linear(5, 1)
    with torch.no_grad():
        layer.weight.copy_(WEIGHTS)
        layer.bias.zero_()
    ends = (np.zeros(5), np.ones(5), -np.ones(1), np.ones(1))
    write(tmp_path / "grounding.npz", Actor(nn.Sequential(layer), *ends))
    return tmp_path / "grounding.npz"


class Fixed(nn.Module):
    """A policy that says the same."""

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return 0.8."""
        return torch.full((*seen.shape[:-1], 1), 0.8)


def moved(world: Environment) -> torch.Tensor:
    """Return what five steps of the same policy show, (2, 5, 4), and its actions."""
    env = world.make(2, threads=1, seed=3)
    batch = next(iter(FastCollector(env, Acting(Fixed()), frames_per_batch=10, total_frames=10)))
    assert (batch["action"] == 0.8).all()  # what is learned from is what the policy said
    return batch["next", "observation"]


def test_the_simulator_gets_what_the_file_makes_of_an_action(file: Path) -> None:
    """Step by step as a simulation that is given the changed action; plain collectors alike."""
    world = Environment(
        partial(MujocoEnv, task=CartPole()), transforms={"g": partial(Ground, file)}
    )
    shown = moved(world)
    plain = world.over(world.base).make(2, threads=1, seed=3)
    now = plain.reset()
    for step in range(5):
        said = torch.full((2, 1), 0.8)
        more = read(file)(now["observation"].double().numpy(), said.double().numpy())
        now["action"] = said + torch.as_tensor(more).float()
        now = plain.step(now)["next"]
        torch.testing.assert_close(shown[:, step], now["observation"])
    env = world.make(2, threads=1, seed=3)
    rolled = env.rollout(5, Acting(Fixed()), break_when_any_done=False)
    torch.testing.assert_close(rolled["next", "observation"], shown)


def test_a_robot_is_what_it_is(file: Path) -> None:
    """Over another base, as in evaluations on named robots, actions are not changed."""
    world = Environment(
        partial(MujocoEnv, task=CartPole()), transforms={"g": partial(Ground, file)}
    )
    plain = Environment(partial(MujocoEnv, task=CartPole()))
    torch.testing.assert_close(moved(world.over(world.base)), moved(plain))
    assert not torch.allclose(moved(world), moved(plain))


def test_what_cannot_ground_is_refused(file: Path) -> None:
    """No file, and one of another task."""
    with pytest.raises(Sim2RealError, match="run=garat wrote"):
        Ground(None)
    ground = Ground(file)
    from tensordict import TensorDict

    data = TensorDict({"observation": torch.zeros(2, 3), "action": torch.zeros(2, 1)}, [2])
    with pytest.raises(Sim2RealError, match="is for 4 observations and 1 actions"):
        ground.inv(data)
