"""Environment steps whose observation is an image of 84 x 84, under random actions."""

import os

import numpy as np
import torch
from torchrl.envs import EnvBase, GymEnv

from benchmarks.rows.base import Row
from envs.errors import RenderError
from envs.pixels.env import PixelsEnv
from envs.pixels.library import library
from envs.pixels.renderers import Kind
from envs.tasks import Hopper

TASK, SIZE = "Hopper-v5", 84


class Pixels(Row):
    """An environment that draws each of its steps."""

    of: str | None = None  # what the others are divided by

    def __init__(self, name: str, simulations: int, steps: int, setup: str) -> None:
        self.name, self.simulations, self.setup = name, simulations, setup
        self._steps = steps

    def missing(self) -> str | None:
        """Return why nothing can be drawn here, or None."""
        try:
            library()
        except RenderError as error:
            return f"{self.name}: {error}"
        return None

    def make(self) -> EnvBase:
        """Return TorchRL's own wrapper, drawn by Gymnasium's renderer as it comes."""
        os.environ.setdefault("MUJOCO_GL", library())  # else Gymnasium looks for a screen
        return GymEnv(TASK, from_pixels=True, pixels_only=True, width=SIZE, height=SIZE)

    def build(self) -> None:
        """Make the environment and step it a little."""
        self._env = self.make()
        self._env.set_seed(0)
        torch.manual_seed(0)
        self._tensordict = self._env.reset()
        self._play(2)

    @torch.no_grad()
    def work(self) -> tuple[float, int]:
        """Step on from where the last run stopped."""
        return self._steps * self.simulations, self._play(self._steps)

    def _play(self, steps: int) -> int:
        episodes = 0
        for _ in range(steps):
            acted = self._env.rand_action(self._tensordict)
            done, self._tensordict = self._env.step_and_maybe_reset(acted)
            episodes += int(done["next", "done"].sum())
        image = np.asarray(self._tensordict["pixels"])
        if image.shape[-3:] != (SIZE, SIZE, 3) or image.std() < 1.0:
            raise RuntimeError(f"{self.name} drew no image: {image.shape}")
        return episodes

    def close(self) -> None:
        """Close the environment."""
        self._env.close()


class BatchedPixels(Pixels):
    """This project's environment with one of its renderers."""

    of: str | None = "pixels_gymenv"

    def __init__(self, kind: Kind, simulations: int, steps: int, setup: str) -> None:
        super().__init__(f"pixels_{kind}", simulations, steps, setup)
        self._kind: Kind = kind

    def missing(self) -> str | None:
        """Return why nothing can be drawn here; rays always can."""
        return super().missing() if self._kind == "gl" else None

    def make(self) -> EnvBase:
        """Return the environment."""
        return PixelsEnv(Hopper(), self.simulations, renderer=self._kind, size=SIZE)
