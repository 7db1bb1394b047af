"""What may differ around the robot: hypotheses like any other.

    for change in list_world_changes(data): change.label, change.probes

A tilted base is an effect that every verb knows; gravity that one side compensates and the other
does not is known to the diagnosis alone.
"""

from typing import ClassVar

import mujoco
import numpy as np

from envs.effects import BoundEffect, Effect
from envs.effects.base import PLAIN
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.params import How, Parameter
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.lean import undrawn
from sim2real.diagnosis.inference.candidates import Candidate, candidate_of
from sim2real.diagnosis.inference.probes import robot_scale


class _Compensation(BoundEffect):
    """See `GravityCompensation`."""

    def __init__(self, plant: PlantView) -> None:
        self._own = plant.model.ngravcomp > 0
        self._gravity = plant.field("body_gravcomp" if self._own else "opt.gravity")

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        if self._own:
            self._gravity[ids, 1:] += values
        else:
            self._gravity[ids] *= 1 - values


class GravityCompensation(Effect):
    """Gravity that the robot's motors compensate and the model's do not, or the other way round.

    The value is the part of the weight of every body that the robot holds beyond the model: 1 where
    it compensates all of it and the model nothing, -1 where the model alone does.
    """

    name = "gravity_compensation"
    place = "robot"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("add",)
    symptom = "the robot stands higher than the model, the more the further it reaches out"
    source = "MuJoCo XML reference, body: gravcomp"
    experiment = "holds stretched out and folded, with and without compensation"

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the part."""
        return (self.parameter(low=-1.0, high=1.0),)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write what each row compensates."""
        return _Compensation(plant)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return all of it, on either side."""
        return np.array([[1.0], [-1.0]])

    def batch(self) -> str:
        """Return the group of effects that only write model fields."""
        return PLAIN


def list_world_changes(data: Data) -> list[Candidate]:
    """Return what may differ around the robot."""
    scale, spec = robot_scale(data), undrawn(data.specs[0])
    tilt = candidate_of("gravity_tilt", {}, spec, scale)
    effect = GravityCompensation()
    (parameter,) = effect.parameters(scale.model)
    neutral, low, high = (np.array([v]) for v in (parameter.neutral, parameter.low, parameter.high))
    own = Candidate(effect, None, effect.probes(scale), neutral, low, high, effect.batch())
    return [own] if tilt is None else [own, tilt]
