"""`mujoco.batch`: float64 on the CPU's threads, the same bits in whichever row."""

from typing import Any

import numpy as np
from mujoco.batch import Batch, SimulationError

from envs.physics.arrays import NUMPY
from envs.physics.base import Engine
from envs.quiet import quiet_engine


class BatchPhysics:
    """Steps a batch itself: nothing has to be taken over.

    Args:
        batch: the simulations.
    """

    name: Engine = "batch"
    arrays = NUMPY

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        # (N, kinds), how often each warning was raised in the running step
        self._warnings = batch.warning[..., 1]
        self._raised: list[np.ndarray] = []  # rows in which the engine raised an error

    def bind(self, name: str) -> np.ndarray:
        """Return the batch's own array (N, ...) of a field of MjData."""
        return self._batch.bind(name)

    def field(self, name: str, own: np.ndarray) -> np.ndarray:
        """Return the batch's own array (N, ...)."""
        return own

    def written(self, ids: np.ndarray) -> None:
        """Do nothing: the batch's fields are what it steps with."""

    def started(self, ids: np.ndarray) -> None:
        """Forget the warnings of the rows ids (n,)."""
        self._warnings[ids] = 0

    def step(self, ids: np.ndarray | None, nstep: int) -> None:
        """Advance the rows ids (None: all) by nstep substeps."""
        try:
            with quiet_engine():
                self._batch.step(ids, nstep)
        except SimulationError as error:
            self._raised.append(error.ids)

    def broken(self, rows: Any) -> np.ndarray:
        """Return in which of the rows an error or a warning was raised, (n,) bool."""
        broken = np.zeros(len(self._warnings), dtype=bool)
        for ids in self._raised:
            broken[ids] = True
        self._raised.clear()
        if self._warnings.any():
            warned = self._warnings[rows].any(axis=1)  # (n,)
            # the engine's own reset clears counts: only a rise from 0 is visible
            self._warnings[rows] = 0
            return broken[rows] | warned
        return broken[rows]
