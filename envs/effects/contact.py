"""Effects on how the robot touches the world."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from envs.effects.base import PLAIN, Bound, Effect
from envs.effects.field import FieldEffect
from envs.effects.places import find
from envs.effects.plant_view import PlantView
from envs.errors import EffectError
from envs.params import How, Parameter

FrictionMode = Literal["contact", "seed"]


class GroundFriction(FieldEffect):
    """Sliding friction coefficient between the ground and the geom that stands on it.

    MuJoCo takes the larger of the two geoms' coefficients, so `friction_mode: contact` writes both;
    `seed` writes the robot's geom alone, as the study did whose grid is repeated here: below the
    floor's own coefficient it then changes nothing. Writing a geom's priority instead would also
    impose its contact dimension, which makes Hopper's links frictionless.

    Args:
        where: the geom of the robot; None for the only geom named "foot" or "foot_geom".
        how: `set` (default) or `scale`.
        friction_mode: "contact" or "seed".
    """

    name = "ground_friction"
    place = "contact"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("set", "scale")
    field = "geom_friction"
    typical = (0.3, 1.5)
    symptom = "feet that slip, or grip, when the tangential load changes"
    source = (
        "MuJoCo documentation, Computation, contact parameters: element-wise maximum of"
        " the two geoms"
    )
    experiment = "push off from a standing start with growing force"

    def __init__(
        self,
        where: str | None = None,
        how: How | None = None,
        friction_mode: FrictionMode = "contact",
        **arguments: Any,
    ) -> None:
        super().__init__(where, how, **arguments)
        if friction_mode not in ("contact", "seed"):
            raise EffectError(
                f"friction_mode={friction_mode!r} is unknown; it can be: contact, seed"
            )
        self.friction_mode = friction_mode

    def options(self) -> dict[str, Any]:
        """Return the friction mode."""
        return {"friction_mode": self.friction_mode}

    def elements(self, model: mujoco.MjModel) -> tuple[Any, ...]:
        """Return the sliding coefficients of the feet and, in mode contact, of the planes."""
        ground = _ground(model, self.name)
        return (
            np.array(
                _feet(model, self.where) + (ground if self.friction_mode == "contact" else [])
            ),
            0,
        )


def _ground(model: mujoco.MjModel, name: str) -> list[int]:
    ground = [i for i in range(model.ngeom) if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_PLANE]
    if not ground:
        raise EffectError(f"{name} needs a plane in the model to stand on; it has none")
    return ground


def _feet(model: mujoco.MjModel, where: str | None) -> list[int]:
    if where is not None:
        return [find(model, "geom", where)]
    feet = [i for i in range(model.ngeom) if "foot" in model.geom(i).name]
    if not feet:
        names = ", ".join(n for i in range(model.ngeom) if (n := model.geom(i).name))
        raise EffectError(f"no geom's name has 'foot' in it; say where: one of {names}")
    return feet


class _Stiffness(Bound):
    """Scales the stiffness of geoms' contacts at their damping ratio."""

    def __init__(self, plant: PlantView, geoms: np.ndarray) -> None:
        self._solref, self._geoms = plant.field("geom_solref"), geoms  # (N, ngeom, 2)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        at = (ids[:, None], self._geoms)
        own, root = self._solref[at], np.sqrt(values)[..., None]  # (n, k, 2), (n, 1, 1)
        standard = np.concatenate(
            [own[..., :1] / root, own[..., 1:]], axis=-1
        )  # (time constant, damping ratio)
        direct = np.concatenate(
            [own[..., :1] * root**2, own[..., 1:] * root], axis=-1
        )  # (-stiffness, -damping)
        self._solref[at] = np.where(own[..., :1] > 0, standard, direct)


class ContactStiffness(Effect):
    """Stiffness of the contact between the ground and the geom that stands on it, as a factor.

    The damping ratio stays. The engine holds a contact's time constant at two time steps or more,
    which bounds what a large factor can do.
    """

    name = "contact_stiffness"
    place = "contact"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale",)
    composes = True
    typical = (0.1, 10.0)
    no_mjcf = None
    symptom = "landings that are softer or harder, and feet that sink in"
    source = (
        "MuJoCo documentation, Modeling, solver parameters: stiffness goes with 1 / time constant²"
    )
    experiment = "drop tests from two heights"

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the factor."""
        self._geoms(model)
        return (self.parameter(low=1e-6),)

    def _geoms(self, model: mujoco.MjModel) -> np.ndarray:
        return np.array(_feet(model, self.where) + _ground(model, self.name))

    def bind(self, plant: PlantView) -> Bound:
        """Write the contacts' reference of each row."""
        return _Stiffness(plant, self._geoms(plant.model))

    def batch(self) -> str:
        """Return the group of effects that only write model fields."""
        return PLAIN
