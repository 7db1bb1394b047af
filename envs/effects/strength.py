"""The strength of a motor, and what a weaker drive does to a servo's law.

make("motor_strength", where="elbow")                    # the torque constant
make("motor_strength", where="elbow", braking="kept")    # less voltage at this motor alone
"""

from typing import Any, ClassVar, Literal, get_args

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Sizes
from envs.effects.bound import BoundEffect
from envs.effects.field import FieldBound
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.effects.servo import ActuatorEffect, is_linear
from envs.errors import refuse_unknown
from envs.params import How, Parameter

Braking = Literal["scaled", "kept"]
BRAKING: tuple[Braking, ...] = get_args(Braking)


class LawScale(BoundEffect):
    """Scales what an actuator's law yields and the limit on it."""

    def __init__(
        self, plant: PlantView, index: np.ndarray, parameter: Parameter, law: bool, damping: bool
    ) -> None:
        limited = index[plant.model.actuator_forcelimited[index].astype(bool)]
        parts = (
            [FieldBound(plant.field("actuator_forcerange"), (limited,), parameter)]
            if limited.size
            else []
        )
        if law:
            parts += [
                FieldBound(plant.field("actuator_gainprm"), (index, 0), parameter),
                FieldBound(plant.field("actuator_biasprm"), (index, slice(0, 3)), parameter),
            ]
        if damping and plant.model.actuator_damping[index].any():
            parts.append(FieldBound(plant.field("actuator_damping"), (index,), parameter))
        self._parts = parts

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Scale by values (n, 1)."""
        for part in self._parts:
            part.write(ids, values)


class MotorStrength(ActuatorEffect):
    """A factor on the motor's torque, its limit and its back-EMF; the no-load speed is unchanged.

    With `braking: kept` the back-EMF is unchanged, as with a voltage drop in one servo's cable.

    Args:
        braking: of the back-EMF: `scaled` or `kept`.
    """

    name = "motor_strength"
    engines = BOTH
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale",)
    constants = True
    composes = True
    typical = (0.6, 1.4)
    no_mjcf = None
    comparable = True
    factors = (0.5, 0.75, 0.94, 0.98, 1.02, 1.06, 1.3, 1.8)  # a few per cent shift a whole motion
    sizes = Sizes("factor", "one", 0.02, 0.8)
    symptom = "static sag, acceleration and largest torque are all too small or too large"
    source = "kt -> (1 + e) kt; identified motor constants differ by 12 to 42 % from data sheets"
    experiment = "the largest torque against a stop or a weight, compared with steps without load"
    group = PLAIN
    can = staticmethod(is_linear)

    def __init__(
        self,
        where: str | None = None,
        how: How | None = None,
        braking: Braking = "scaled",
        **arguments: Any,
    ) -> None:
        super().__init__(where, how, **arguments)
        refuse_unknown(f"{self.label()}: braking", braking, BRAKING)
        self.braking: Braking = braking

    def options(self) -> dict[str, Any]:
        """Return what happens to the back-EMF, unless it is scaled."""
        return {} if self.braking == "scaled" else {"braking": self.braking}

    @property
    def variant(self) -> str:
        """What tells it apart from the same effect at the same place."""
        return "" if self.braking == "scaled" else f"braking {self.braking}"

    @classmethod
    def variants(cls, scale: RobotScale) -> list[dict[str, Any]]:
        """Return both ways where a motor of the model has a back-EMF, else one."""
        both = bool(scale.model.actuator_damping.any())
        return [{"braking": one} for one in (BRAKING if both else BRAKING[:1])]

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the factor."""
        self.actuators(model)
        scalar = () if self.braking == "scaled" else (f"braking_{self.braking}",)
        return (self.parameter(*scalar, low=0.0),)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Scale gain, bias, limit and damping of each row."""
        return LawScale(
            plant,
            self.actuators(plant.model),
            self.parameters(plant.model)[0],
            law=True,
            damping=self.braking == "scaled",
        )
