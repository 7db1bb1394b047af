"""Effects that are one plain field of the model.

class SpringStiffness(FieldEffect):
name, place, unit, hows = "spring_stiffness", "joint", "N·m/rad", ("scale", "add", "set")
field = "jnt_stiffness"
"""

from collections.abc import Sequence
from typing import Any, ClassVar

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect
from envs.effects.bound import BoundEffect
from envs.effects.places import find, is_pattern, joints, members
from envs.effects.plant_view import PlantView
from envs.errors import EffectError
from envs.params import Parameter


class FieldBound(BoundEffect):
    """Writes k = 1 value a row into the same elements of one model field."""

    def __init__(self, field: np.ndarray, elements: tuple[Any, ...], parameter: Parameter) -> None:
        self._field, self._elements, self._parameter = field, elements, parameter  # field (N, ...)
        self._value_ones = [1] * np.ndim(field[(0, *elements)])
        self._ids_ones = [1] * max(np.ndim(e) for e in elements if not isinstance(e, slice))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Set, add to or scale the elements in the rows ids; values (n, 1)."""
        value = values[:, 0].reshape(-1, *self._value_ones)
        index = (ids.reshape(-1, *self._ids_ones), *self._elements)
        own = self._field[index]
        if self._parameter.how == "add":
            self._field[index] = own + value
        elif self._parameter.how == "scale":
            self._field[index] = own * value
        else:  # absent means the model's own values, which may differ between the elements
            self._field[index] = np.where(value == self._parameter.neutral, own, value)


class BoundFieldGroup(BoundEffect):
    """Writes the same value into several places."""

    def __init__(self, parts: Sequence[BoundEffect]) -> None:
        self._parts = parts

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Write values (n, 1) into each."""
        for part in self._parts:
            part.write(ids, values)


class FieldEffect(Effect):
    """An effect that is one plain field of the model at one joint, actuator or body.

    Subclasses name the `field`; `elements` says which entries of it belong to the place.
    """

    engines = BOTH
    field: ClassVar[str]
    minimum: ClassVar[float] = 0.0  # the smallest value that the field may take
    column: ClassVar[int | None] = None  # the entry of a row of the field, where it has several
    composes: ClassVar[bool] = True
    no_mjcf: ClassVar[str | None] = None
    group = PLAIN

    def elements(self, model: mujoco.MjModel) -> tuple[Any, ...]:
        """Return the index into the field, without the row axis."""
        if self.place == "joint":
            index: Any = joints(model, self.where)
            index = model.jnt_dofadr[index] if self.field.startswith("dof_") else index
        elif self.place in ("actuator", "body"):
            pick = members if is_pattern(self.where) else find
            index = pick(model, self.place, self.where)  # type: ignore[arg-type]
        else:
            raise NotImplementedError(
                f"{type(self).__name__} must define which elements of {self.field} it writes"
            )
        return (index,) if self.column is None else (index, self.column)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the value, whose range keeps the field at or above its minimum, and free extras.

        Raises:
            EffectError: no such place, or a factor on a field that is 0 there.
        """
        nominal = np.asarray(getattr(model, self.field)[self.elements(model)], dtype=np.float64)
        if self.how == "add":
            value = self.parameter(low=float(np.max(self.minimum - nominal)))
        elif self.how == "scale":
            if not nominal.any():
                raise EffectError(
                    f"{self.label()}: the model's {self.field} is 0 there, so a factor changes "
                    f"nothing; use how: add"
                )
            value = self.parameter(low=0.0)
        else:
            value = self.parameter(low=self.minimum, neutral=float(nominal.flat[0]))
        return (value, *self.free_parameters())

    def bind(self, plant: PlantView) -> BoundEffect:
        """Give the field a value per row."""
        parameter, *_ = self.parameters(plant.model)
        return FieldBound(plant.field(self.field), self.elements(plant.model), parameter)
