"""Rows that are seen through images."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torchrl.envs import CatFrames, Compose, GrayScale, ToTensorImage, TransformedEnv

from envs.errors import TaskError
from envs.pixels.env import PixelsEnv
from envs.pixels.simulation import PixelSimulation
from envs.simulation import Simulation
from envs.tasks import Hopper

ROWS, SIZE = 3, 20
EVERY = np.arange(ROWS)
SEEDS = EVERY.astype(np.uint64)


def pixels(frames: int = 4, grey: bool = True) -> PixelSimulation:
    """Return a small simulation."""
    return PixelSimulation(Hopper(), ROWS, renderer="rays", size=SIZE, frames=frames, grey=grey)


@pytest.mark.parametrize(("frames", "grey"), [(4, True), (1, False), (2, False)])
def test_it_sees_what_torchrls_transforms_make_of_the_images(frames: int, grey: bool) -> None:
    """The flat observation equals ToTensorImage, GrayScale and CatFrames of the same episode."""
    rows, env = pixels(frames, grey), PixelsEnv(Hopper(), ROWS, size=SIZE)
    steps = [ToTensorImage(), *([GrayScale()] if grey else []), CatFrames(frames, dim=-3)]
    seen = TransformedEnv(env, Compose(*steps))  # type: ignore[call-arg]
    torch.manual_seed(0)
    seen.set_seed(5)
    theirs = seen.reset()
    qpos, qvel = env.simulation.plant.qpos, env.simulation.plant.qvel
    ours = rows.set_state(EVERY, qpos.copy(), qvel.copy())
    for _ in range(6):
        expected = theirs["pixels"].flatten(1).numpy()
        np.testing.assert_allclose(ours, expected, atol=2e-6)
        action = np.random.default_rng(1).uniform(-1, 1, (ROWS, 3)).astype(np.float32)
        theirs = seen.step(theirs.set("action", torch.from_numpy(action)))["next"]
        ours = rows.step(None, action.astype(np.float64)).observation


def test_the_episode_is_the_same_as_without_a_camera() -> None:
    """Rewards and ends are those of the plain simulation; some rows alone see what all see."""
    plain, seen, alone = Simulation(Hopper(), ROWS), pixels(), pixels()
    values = np.zeros((ROWS, 0))
    plain.reset(EVERY, values, SEEDS)
    seen.reset(EVERY, values, SEEDS)
    ids = np.array([0, 2])
    first = alone.reset(ids, values[ids], SEEDS[ids])
    np.testing.assert_array_equal(first, seen.reset(EVERY, values, SEEDS)[ids])
    rng = np.random.default_rng(0)
    for _ in range(30):
        action = rng.uniform(-1, 1, (ROWS, 3))
        a, b, c = plain.step(None, action), seen.step(None, action), alone.step(ids, action[ids])
        np.testing.assert_array_equal(a.reward, b.reward)
        np.testing.assert_array_equal(a.terminated, b.terminated)
        np.testing.assert_array_equal(b.observation[ids], c.observation)


def test_no_frames_are_refused() -> None:
    """Zero frames show nothing."""
    with pytest.raises(TaskError, match="frames=0 must be at least 1"):
        pixels(frames=0)
