"""Effects on the surface of one geom, whatever it touches: how it slides and how it bounces.

A contact takes friction and reference from the geom of higher priority, else mixes those of both
(`GroundFriction` minds that). Give a geom `priority="1"` in the MJCF to make its contacts its own.
"""

from typing import Any, ClassVar

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN
from envs.effects.bound import BoundEffect
from envs.effects.contact import _ContactEffect
from envs.effects.field import FieldEffect
from envs.effects.places import members
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.params import How, Parameter

LEAST = 0.01  # a smaller bounce is indistinguishable from none
HIGHEST = 10.0  # damping ratio of the table: restitution below LEAST
STEPS = 4001  # of the table


class _SurfaceEffect(_ContactEffect):
    """An effect on one geom, on those of a pattern, or on all whose priority is above the others'.

    No diagnosis looks for it: `ground_friction` and `contact_stiffness` are its candidates.
    """

    @classmethod
    def places(cls, scale: RobotScale) -> list[str | None]:
        """Return nowhere."""
        return []

    def _feet(self, model: mujoco.MjModel) -> list[int]:
        if self.where is not None:
            return members(model, "geom", self.where).tolist()
        first = np.flatnonzero(model.geom_priority > 0)
        return first.tolist() or super()._feet(model)


class SurfaceFriction(_SurfaceEffect, FieldEffect):
    """Sliding friction coefficient of a geom's surface.

    Args:
        where: the geom; None for all whose priority is above 0, with one value.
    """

    name = "surface_friction"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale", "set")
    field = "geom_friction"
    typical = (0.5, 1.5)
    symptom = "objects on it slip more, or less, easily"
    source = "MuJoCo documentation, Computation, contact parameters: priority"
    experiment = "tilt the surface until an object on it slides"

    def elements(self, model: mujoco.MjModel) -> tuple[Any, ...]:
        """Return the sliding coefficients of the geoms."""
        return np.array(self._feet(model)), 0


def restitution_of(ratio: np.ndarray) -> np.ndarray:
    """Return the speed after over that before a bounce on a damped spring of damping ratios.

    The contact ends where the spring and damper would pull: e = exp(-2 z acos(z) / sqrt(1 - z²)),
    beyond z = 1 with acosh and sqrt(z² - 1) (Schwager and Pöschel, Granular Matter 9, 2007).
    """
    ratio = np.asarray(ratio, dtype=np.float64)
    inside, outside = np.minimum(ratio, 1.0), np.maximum(ratio, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        below = np.arccos(inside) / np.sqrt(1.0 - inside**2)
        above = np.arccosh(outside) / np.sqrt(outside**2 - 1.0)
    slope = np.where(ratio < 1.0, below, np.where(ratio > 1.0, above, 1.0))
    return np.exp(-2.0 * ratio * slope)


_RATIOS = np.linspace(0.0, HIGHEST, STEPS)
_BOUNCES = restitution_of(_RATIOS)


def ratio_of(restitution: np.ndarray) -> np.ndarray:
    """Undo `restitution_of`, for values of LEAST to 1."""
    return np.interp(-np.asarray(restitution), -_BOUNCES, _RATIOS)


class _Bounce(BoundEffect):
    """Writes the damping of geoms' contacts, and leaves their stiffness."""

    def __init__(self, plant: PlantView, geoms: np.ndarray, parameter: Parameter) -> None:
        self._solref, self._geoms, self._neutral = (
            plant.field("geom_solref"),
            geoms,
            parameter.neutral,
        )

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        changed = values[:, 0] != self._neutral
        if not changed.any():
            return
        at = (ids[changed][:, None], self._geoms)
        own, ratio = self._solref[at], ratio_of(values[changed])  # (n, k, 2), (n, 1)
        root = np.sqrt(np.maximum(-own[..., 0], 0.0))  # of a direct reference's stiffness
        direct = np.stack([own[..., 0], -2.0 * ratio * root], axis=-1)
        time = own[..., 0] * own[..., 1] / np.maximum(ratio, 1e-6)  # the same stiffness
        ratios = np.broadcast_to(ratio, time.shape)
        standard = np.stack([time, ratios], axis=-1)
        self._solref[at] = np.where(own[..., :1] > 0, standard, direct)


class Restitution(_SurfaceEffect):
    """Speed after a bounce on a geom, relative to the speed before; the stiffness is unchanged.

    The contact's damping is set accordingly, which is accurate if the time step resolves the
    contact.

    Args:
        where: the geom; None for all whose priority is above 0, with one value.
    """

    name = "restitution"
    engines = BOTH
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("set",)
    typical = (0.1, 0.9)
    no_mjcf = None
    symptom = "falling objects bounce higher, or not at all"
    source = "e = exp(-2 z acos(z) / sqrt(1 - z²)) with damping ratio z; MuJoCo reference, solref"
    experiment = "drop a ball and compare the heights"
    group = PLAIN

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the coefficient, whose neutral value is that of the model's own damping."""
        first, second = model.geom_solref[self._feet(model)[0]]
        ratio = second if first > 0 else -second / (2 * np.sqrt(-first))
        neutral = float(np.maximum(restitution_of(ratio), LEAST))
        return (self.parameter(low=LEAST, high=1.0, neutral=neutral),)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the references of each row."""
        return _Bounce(plant, np.array(self._feet(plant.model)), self.parameters(plant.model)[0])
