"""The external forces on each body, which `mujoco.batch` leaves at zero.

    forces = ContactForces(plant)          # of a plant made with persistent=True
    forces.compute(ids)                    # after a step
    forces.values[ids]                     # (n, bodies, 6)

The engine computes them in mj_rnePostConstraint, from quantities of the last substep that only a
persistent batch keeps. It runs on one row at a time, so this costs several times what a step does.
"""

import mujoco
import numpy as np

from envs.plant import Plant


class ContactForces:
    """The forces of each row of a persistent plant.

    Attributes:
        values: torque and force on each body about its tree's centre of mass [N·m, N],
            (N, bodies, 6).
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._model, self._data = plant.batch.get_model(0), mujoco.MjData(plant.model)
        self.values = np.zeros((plant.num_rows, plant.model.nbody, 6))

    def clear(self, ids: np.ndarray) -> None:
        """Set the forces in the rows ids (n,) to zero, as Gymnasium shows them after a reset."""
        self.values[ids] = 0.0

    def compute(self, ids: np.ndarray | None) -> None:
        """Compute the forces in the rows ids (None: all) at their last substep."""
        batch = self._plant.batch
        for row in range(self._plant.num_rows) if ids is None else ids:
            if self._plant.space.size:  # each row has its own model
                batch.get_model(int(row), self._model)
            batch.get_data(int(row), self._data)
            mujoco.mj_rnePostConstraint(self._model, self._data)
            self.values[row] = self._data.cfrc_ext
