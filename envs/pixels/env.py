"""The TorchRL environment whose observations hold images.

    env = PixelsEnv(HopperPolito(), 16, renderer="rays", size=84)
    env = TransformedEnv(env, Compose(ToTensorImage(), GrayScale(), CatFrames(4, dim=-3)))
    env.rollout(10)["pixels"].shape                     # (16, 10, 4, 84, 84)

Images are under "pixels", (N, size, size, 3) uint8, drawn at that size. The task's own observation
is kept, for a critic or a measure that may know the state.
"""

from typing import Any

import numpy as np
import torch
from torchrl.data import Bounded

from envs.mujoco import MujocoEnv
from envs.pixels.renderers import Kind, make_renderer
from envs.tasks.base import Task

CHANNELS = 3
BRIGHTEST = 255


class PixelsEnv(MujocoEnv):
    """num_envs simulations of a task, seen by its camera.

    Args:
        task: what is simulated.
        num_envs: N.
        renderer: "rays" (no graphics library needed) or "gl".
        size: the side of the square images [px].
        camera: one of the model's cameras; None: that of the task.
        others: further arguments of `MujocoEnv`.

    Raises:
        TaskError: an unknown renderer, a size out of range, or a camera that the model lacks.
        RenderError: `gl` on a machine where nothing can be drawn.
    """

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        renderer: Kind = "rays",
        size: int = 84,
        camera: str | None = None,
        **others: Any,
    ) -> None:
        super().__init__(task, num_envs, **others)
        self._renderer = make_renderer(renderer, self.simulation, size, camera)
        shape = torch.Size((num_envs, size, size, CHANNELS))
        self._images = np.zeros(shape, np.uint8)  # the newest of every row
        self.observation_spec["pixels"] = Bounded(
            0, BRIGHTEST, shape, device=self.device, dtype=torch.uint8
        )

    def _seen(self, ids: np.ndarray | None) -> dict[str, torch.Tensor]:
        rows = slice(None) if ids is None else ids
        self._images[rows] = self._renderer.render(ids)
        return super()._seen(ids) | {"pixels": self._tensor(self._images, torch.uint8)}

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Close the environment and its renderer."""
        self._renderer.close()
        super().close(raise_if_closed=raise_if_closed)
