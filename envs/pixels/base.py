"""A renderer: what a task's own camera sees of every row, as small colour images.

    renderer = RayRenderer(simulation, size=84)
    images = renderer.render(None)               # (N, 84, 84, 3) uint8; ids for some of the rows
    renderer.close()

Images are drawn at the size that is asked for: nothing is resized afterwards. What each row's model
says about colours, lights and cameras is drawn, so that effects may change it from row to row.
"""

from abc import ABC, abstractmethod

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.quiet import quiet_engine
from envs.simulation import Simulation

SMALLEST, LARGEST = 8, 1024  # px


class Renderer(ABC):
    """Draws the rows of a simulation.

    Args:
        simulation: whose rows are drawn.
        size: the side of the square images [px].
        camera: the name of one of the model's cameras; None: that of the task.

    Raises:
        TaskError: a size out of range, or a camera that the model lacks.
    """

    def __init__(self, simulation: Simulation, size: int, camera: str | None = None) -> None:
        if not SMALLEST <= size <= LARGEST:
            raise TaskError(f"size={size} px must be within [{SMALLEST}, {LARGEST}]")
        self.size, self.closed = size, False
        self.plant = simulation.plant
        self.model = self.plant.model
        name = simulation.task.camera if camera is None else camera
        names = [self.model.camera(i).name for i in range(self.model.ncam)]
        if name not in names:
            there = ", ".join(names) or "none"
            raise TaskError(f"the model has no camera {name!r}; it has: {there}")
        self.camera = names.index(name)
        if self.model.cam_projection[self.camera] != int(mujoco.mjtProjection.mjPROJ_PERSPECTIVE):
            raise TaskError(f"camera {name!r} is orthographic; choose a perspective one")

    def watch(self, *names: str) -> list[np.ndarray]:
        """Return live arrays of derived quantities, (N, ...) each, up to date from now on.

        The engine fills them in at its next call; one is made here that leaves the rows as they
        are, so that rendering does not change the episodes.
        """
        batch = self.plant.batch
        watched = [batch.bind(name) for name in names]
        guess = batch.bind("qacc_warmstart")
        kept = guess.copy()
        with quiet_engine():
            batch.forward(None)
        guess[:] = kept
        return watched

    @abstractmethod
    def render(self, ids: np.ndarray | None) -> np.ndarray:
        """Draw the rows ids (n,), None for all; returns (n, size, size, 3) uint8, row 0 on top."""

    def close(self) -> None:
        """Free what the renderer holds outside this process; it draws nothing after."""
        self.closed = True
