"""A simulation that is seen by its camera: rows whose observations are images.

    rows = PixelSimulation(HopperPolito(), num_rows=16, renderer="rays", size=84, frames=4)
    observation = rows.reset(ids, values, seeds)     # (n, 4·84·84) float32 in [0, 1]

The observation is the last `frames` images, oldest first, channels before rows before columns: what
TorchRL's ToTensorImage, GrayScale and CatFrames make of `PixelsEnv`, flat. An episode begins with
its first image repeated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.effects.base import Effect
from envs.errors import TaskError
from envs.pixels.renderers import Kind, make_renderer
from envs.plant import Fixed
from envs.rows import Step
from envs.simulation import Simulation
from envs.tasks.base import Task

GREY = np.array([0.2989, 0.587, 0.114], np.float32)  # luma of ITU-R BT.601, as GrayScale weighs
BRIGHTEST = 255.0


class PixelSimulation(Simulation):
    """num_rows episodes of a task, observed through images alone.

    Args:
        task: what is simulated.
        num_rows: N, episodes at a time.
        effects: what may differ per row.
        threads: CPU threads; 0 for all cores.
        fixed: effects that every row has, with their values.
        renderer: "rays" (no graphics library needed) or "gl".
        size: S of the square images [px].
        frames: K, how many of the last images are seen.
        grey: one channel of brightness instead of three of colour.
        camera: one of the model's cameras; None takes the task's own.

    Raises:
        TaskError: an unknown renderer, a size or number of frames out of range, or a camera that
            the model lacks.
        RenderError: `gl` on a machine where nothing can be drawn.
    """

    def __init__(
        self,
        task: Task,
        num_rows: int = 1,
        effects: Sequence[Effect] = (),
        threads: int = 0,
        fixed: Sequence[Fixed] = (),
        *,
        renderer: Kind,
        size: int,
        frames: int,
        grey: bool,
        camera: str | None = None,
    ) -> None:
        if frames < 1:
            raise TaskError(f"frames={frames} must be at least 1")
        super().__init__(task, num_rows, effects, threads, fixed)
        self.renderer = make_renderer(renderer, self, size, camera)
        self._grey, self._channels = grey, 1 if grey else 3
        self._seen = np.zeros((num_rows, frames * self._channels, size, size), np.float32)
        self.observation_size = self._seen[0].size

    def set_state(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Put rows into a state as if their episodes had started there; see `Simulation`.

        Returns:
            The first images, (n, K·C·S·S).
        """
        super().set_state(ids, qpos, qvel)
        first = self._look(ids)
        frames = self._seen.shape[1] // self._channels
        self._seen[ids] = np.tile(first, (1, frames, 1, 1))
        return self._seen[ids].reshape(len(ids), -1)

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Advance the rows ids (None: all) by one control step of action (n, A)."""
        step = super().step(ids, action)
        rows = np.arange(self.num_rows) if ids is None else ids
        seen = np.concatenate([self._seen[rows][:, self._channels :], self._look(ids)], axis=1)
        seen[step.failed] = 0.0
        self._seen[rows] = seen
        return step._replace(observation=seen.reshape(len(rows), -1))

    def _look(self, ids: np.ndarray | None) -> np.ndarray:
        """Return new images of the rows ids, (n, C, S, S) float32 in [0, 1]."""
        image = self.renderer.render(ids).astype(np.float32)
        image /= BRIGHTEST
        return (image @ GREY)[:, None] if self._grey else image.transpose(0, 3, 1, 2)

    def close(self) -> None:
        """Free the renderer."""
        self.renderer.close()
