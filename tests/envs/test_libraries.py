"""Environments of other libraries: TorchRL's contract, and a sentence for what is not there."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from torchrl.envs.utils import check_env_specs

from envs.errors import TaskError
from envs.libraries import gymnasium, mjlab


def test_an_environment_of_gymnasium_moves_as_there() -> None:
    """Rewards and observations of a row are those of the environment alone, in float32."""
    env = gymnasium(2, "cpu", "Pendulum-v1")
    check_env_specs(env, seed=0)
    assert env.batch_size == (2,)
    env.set_seed(3)
    start = env.reset()
    alone = gym.make("Pendulum-v1")
    alone.reset()
    x, y, speed = start["observation"][0].tolist()
    alone.unwrapped.state = np.array([np.arctan2(y, x), speed])  # type: ignore[attr-defined]
    start["action"] = torch.tensor([[0.5], [-1.0]])
    after = env.step(start)["next"]
    wanted, reward, *_ = alone.step(np.array([0.5], np.float32))
    assert after["observation"].dtype == torch.float32
    assert after["observation"][0].numpy() == pytest.approx(wanted, abs=1e-5)
    assert float(after["reward"][0, 0]) == pytest.approx(reward, abs=1e-5)


def test_what_is_not_there_is_said() -> None:
    """A missing package, an unknown id, and mjlab, which needs another MuJoCo."""
    with pytest.raises(TaskError, match=r"Door-v1 needs no_such_one; .*install no-such-one"):
        gymnasium(1, "cpu", "Door-v1", "no_such_one")
    with pytest.raises(TaskError, match=r"env\.id=Pendulum-v77: .*env\.package must name"):
        gymnasium(1, "cpu", "Pendulum-v77")
    with pytest.raises(TaskError, match=r"needs MuJoCo 3\.11 where sim2real needs MuJoCo 4.*mjlab"):
        mjlab(4, "cpu", "Mjlab-Cartpole-Balance")


@pytest.mark.slow
def test_a_package_of_gymnasiums_installs_beside_this_mujoco() -> None:
    """Gymnasium-Robotics' hand at a door, stepped by the MuJoCo that is here."""
    pytest.importorskip("gymnasium_robotics")
    env = gymnasium(2, "cpu", "AdroitHandDoor-v1", "gymnasium_robotics")
    check_env_specs(env, seed=0)
    assert env.rollout(5)["action"].shape == (2, 5, 28)
