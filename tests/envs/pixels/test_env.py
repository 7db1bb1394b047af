"""Images in a TorchRL environment."""

import numpy as np
import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs import CatFrames, Compose, GrayScale, ToTensorImage, TransformedEnv
from torchrl.envs.utils import check_env_specs

from envs.errors import TaskError
from envs.pixels.env import PixelsEnv
from envs.tasks import Hopper, HopperPolito

ROWS, SIZE = 4, 24


def stacked(env: PixelsEnv, frames: int = 4) -> TransformedEnv:
    """Return the environment with its last grey images."""
    steps = (ToTensorImage(), GrayScale(), CatFrames(frames, dim=-3))
    return TransformedEnv(env, Compose(*steps))  # type: ignore[call-arg]


def test_specs_hold_and_a_collector_drives_it() -> None:
    """TorchRL's own check passes; a collector returns stacked grey frames in [0, 1]."""
    env = PixelsEnv(HopperPolito(), ROWS, size=SIZE, seed=1)
    check_env_specs(env)
    collector = Collector(stacked(env), None, frames_per_batch=80, total_frames=80)
    (batch,) = list(collector)
    assert batch["pixels"].shape == (ROWS, 20, 4, SIZE, SIZE)
    assert 0.0 <= batch["pixels"].min() < batch["pixels"].max() <= 1.0
    collector.shutdown()


def test_the_newest_image_is_the_last_of_the_stack() -> None:
    """At a reset the stack is one image repeated; after a step it has moved on by one."""
    env = stacked(PixelsEnv(Hopper(), ROWS, size=SIZE, seed=1))
    first = env.reset()
    assert (first["pixels"] == first["pixels"][:, :1]).all()
    first["action"] = torch.ones(ROWS, 3)
    after = env.step(first)["next", "pixels"]
    assert torch.equal(after[:, :3], first["pixels"][:, 1:])
    assert not torch.equal(after[:, 3], first["pixels"][:, 3])


def test_rows_that_restart_are_drawn_anew_and_the_others_are_not() -> None:
    """A partial reset changes the images of its rows alone."""
    env = PixelsEnv(Hopper(), ROWS, size=SIZE, seed=1)
    state = env.reset()
    for _ in range(3):
        state = env.step(state.set("action", torch.ones(ROWS, 3)))["next"]
    before = state["pixels"].clone()
    mask = torch.tensor([[True], [False], [False], [True]])
    state["_reset"] = mask
    after = env.reset(state)["pixels"]
    changed = (after != before).flatten(1).any(1)
    np.testing.assert_array_equal(changed.numpy(), mask[:, 0].numpy())


def test_bad_sizes_and_names_are_refused() -> None:
    """An unknown renderer, camera or a silly size is one sentence."""
    with pytest.raises(TaskError, match=r"renderer='ray' is unknown \(did you mean 'rays'\?\)"):
        PixelsEnv(Hopper(), 1, renderer="ray")  # type: ignore[arg-type]
    with pytest.raises(TaskError, match="size=2 px must be within"):
        PixelsEnv(Hopper(), 1, size=2)
    with pytest.raises(TaskError, match="no camera 'front'; it has: track"):
        PixelsEnv(Hopper(), 1, camera="front")
