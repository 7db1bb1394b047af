"""Effects on how the robot touches the world."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from envs.effects.base import FieldEffect, find
from envs.errors import EffectError
from envs.params import How

FrictionMode = Literal["contact", "seed"]


class GroundFriction(FieldEffect):
    """Sliding friction coefficient between the ground and the geom that stands on it.

    MuJoCo takes the larger of the two geoms' coefficients, so `friction_mode: contact` writes both; `seed` writes the
    robot's geom alone, as the study did whose grid is repeated here: below the floor's own coefficient it then changes
    nothing. Writing a geom's priority instead would also impose its contact dimension, which makes Hopper's links
    frictionless.

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
    looks_like = "feet that slip, or grip, when the tangential load changes"
    source = "MuJoCo documentation, Computation, contact parameters: element-wise maximum of the two geoms"
    experiment = "push off from a standing start with growing force"

    def __init__(
        self, where: str | None = None, how: How | None = None, friction_mode: FrictionMode = "contact"
    ) -> None:
        super().__init__(where, how)
        if friction_mode not in ("contact", "seed"):
            raise EffectError(f"friction_mode={friction_mode!r} is unknown; it can be: contact, seed")
        self.friction_mode = friction_mode

    def elements(self, model: mujoco.MjModel) -> tuple[Any, ...]:
        """Return the sliding coefficients of the foot's geoms and, in mode contact, of the ground's planes."""
        feet = self._feet(model)
        ground = [i for i in range(model.ngeom) if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_PLANE]
        if not ground:
            raise EffectError("ground_friction needs a plane in the model to stand on; it has none")
        return (np.array(feet + (ground if self.friction_mode == "contact" else [])), 0)

    def _feet(self, model: mujoco.MjModel) -> list[int]:
        if self.where is not None:
            return [find(model, "geom", self.where)]
        feet = [i for i in range(model.ngeom) if "foot" in model.geom(i).name]
        if not feet:
            names = ", ".join(n for i in range(model.ngeom) if (n := model.geom(i).name))
            raise EffectError(f"no geom's name has 'foot' in it; say where: one of {names}")
        return feet
