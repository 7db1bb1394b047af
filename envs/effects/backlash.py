"""Play in a gear: the link moves freely between two ends."""

import math
from typing import Any

import mujoco
import numpy as np

from envs.effects.base import BOTH, Sizes
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.effects.structure import Series, SeriesEffect

STIFF_LIMIT = (0.99, 0.999, 1e-4, 0.5, 2.0)  # solimp of the play's ends


class _Play(Series):
    """See `Backlash`."""

    def __init__(self, plant: PlantView, effect: SeriesEffect, motor: int) -> None:
        super().__init__(plant, effect, motor)
        self.range, self.memory = plant.field("jnt_range"), plant.model.joint(self.joint).name

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        half = np.where(values[:, 0] > 0, values[:, 0] / 2, 1.0)  # a frozen joint meets no end
        self.range[ids, self.joint] = np.stack([-half, half], axis=1)

    def settle(self, ids: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return the end against which the load pulls the link; the middle without load."""
        return -np.where(np.abs(load) > 1e-9, np.sign(load), 0.0) * self.value[ids] / 2

    def misremember(self, ids: np.ndarray) -> None:
        """Move the link from where it settled, by the spread of an even distribution."""
        qpos, motor = self.plant.batch.bind("qpos"), self.plant.model.jnt_qposadr[self.motor]
        moved = np.where(qpos[ids, self.q] > 0, -1, 1) * self.value[ids] / math.sqrt(12)
        qpos[ids, self.q] += moved
        if not self.motor_side:
            qpos[ids, motor] -= moved  # the link stays where its encoder saw it


class Backlash(SeriesEffect):
    """Play: the link moves freely within ± value / 2 of the motor's angle.

    `side` is the location of the servo's encoder. `encoder` is the location of the logged encoder,
    if they differ.
    """

    name = "backlash"
    engines = BOTH
    unit = "rad"
    shared = True
    typical = (0.0, 0.06)
    bound = _Play
    comparable = True
    sizes = Sizes("add", "one", 3e-3, 0.25)
    symptom = (
        "the link lags by a fixed angle after each reversal; the link rattles where no load"
        " holds it"
    )
    source = (
        "a hinge with limits in series; Dynamixel X: 15 arcmin (e-manual), SO-101 models: 1 degree"
    )
    experiment = "slow reversals; the lag does not depend on the load, and a preload removes it"
    first_values = (0.004, 0.015, 0.05, 0.15)

    def shape(self, joint: Any, timestep: float) -> None:
        """Give the joint stiff ends."""
        joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-1.0, 1.0]
        joint.solref_limit, joint.solimp_limit = [2 * timestep, 1.0], STIFF_LIMIT

    def memory(self, model: mujoco.MjModel) -> list[str]:
        """Return where in each play the link lies."""
        return [self.joint_name(model.joint(int(i)).name) for i in joints(model, self.where)]
