"""An effect: one named way in which a robot differs from its model.

A new effect is one class: its `parameters` say what scalars it has on a given model, `bind` connects it to a plant.
It is then known to randomization, evaluation grids, `effects.yaml` and diagnosis alike.

    class DryFriction(FieldEffect):
        name, place, unit, hows = "dry_friction", "joint", "N·m", ("add", "set")
        field = "dof_frictionloss"

An effect is absent at its parameters' neutral values: the plant then behaves as if it were not there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import mujoco
import numpy as np

from envs.errors import EffectError, did_you_mean
from envs.params import How, Parameter, Side

if TYPE_CHECKING:
    from envs.plant import Plant

Place = Literal["joint", "actuator", "body", "contact", "robot"]


class Bound:
    """An effect that is connected to one plant. The plant calls it; each method does nothing by default."""

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put the values (n, k) of the effect's k parameters into the rows ids."""

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        """Forget what the rows ids remember; called after their state was set, before the first measurement."""


class SubstepRule(Bound, ABC):
    """A bound effect that acts before each physics substep, on all the rows of a call at once."""

    @abstractmethod
    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Act on the rows ids, through the plant's batch (controls, applied forces)."""


class Measurement(Bound, ABC):
    """A bound effect that changes what the robot's sensors say, not what the robot does."""

    @abstractmethod
    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Change the measured qpos (n, nq) [rad, m] and qvel (n, nv) of the rows ids in place."""


class Effect(ABC):
    """A named way to differ from the model; a plant binds it.

    Args:
        where: the joint, actuator, body or geom; None for the whole robot.
        how: `set`, `add` or `scale`; None takes the effect's first way.

    Raises:
        EffectError: a way that the effect does not have, or a missing or needless place.
    """

    name: ClassVar[str]
    place: ClassVar[Place]
    unit: ClassVar[str]
    hows: ClassVar[tuple[How, ...]] = ("add",)
    looks_like: ClassVar[str]  # what a person sees in the log when it is there
    source: ClassVar[str]  # where its equation comes from
    experiment: ClassVar[str]  # the recording that isolates it
    constants: ClassVar[bool] = False  # whether the model's derived constants follow from what it writes

    def __init__(self, where: str | None = None, how: How | None = None) -> None:
        self.where = where
        self.side: Side | None = None
        self.how: How = how or self.hows[0]
        if self.how not in self.hows:
            raise EffectError(f"{self.name} cannot {self.how!r} a value; it can: {', '.join(self.hows)}")
        if self.place == "robot" and where is not None:
            raise EffectError(f"{self.name} acts on the whole robot; leave out where={where!r}")
        if self.place in ("joint", "body") and where is None:
            raise EffectError(f"{self.name} needs where: the name of a {self.place}")

    def label(self, *scalar: str) -> str:
        """Return the name of the effect's parameter, or of one of its further scalars."""
        return ".".join([self.name, *([self.where] if self.where else []), *scalar])

    def parameter(self, *scalar: str, **changes: Any) -> Parameter:
        """Return a Parameter of this effect with its own name, place, way and unit, and the given changes."""
        own = {"unit": self.unit, "neutral": {"add": 0.0, "scale": 1.0, "set": 0.0}[self.how], "how": self.how}
        return Parameter(self.label(*scalar), self.name, self.where, self.side, **{**own, **changes})

    def edit(self, spec: mujoco.MjSpec) -> None:  # noqa: B027 - most effects need no structure
        """Add to the model's structure what the effect needs."""

    @abstractmethod
    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the effect's parameters on this model; raises EffectError where the robot cannot have it."""

    @abstractmethod
    def bind(self, plant: Plant) -> Bound:
        """Connect the effect to a plant."""


def find(model: mujoco.MjModel, kind: Literal["joint", "actuator", "body", "geom"], name: str | None) -> int:
    """Return the id of a named object; raises EffectError that lists the model's names."""
    kinds = {"joint": model.njnt, "actuator": model.nu, "body": model.nbody, "geom": model.ngeom}
    names = [getattr(model, kind)(i).name for i in range(kinds[kind])]
    if name is None or name not in names:
        known = ", ".join(n for n in names if n and n != "world")
        hint = did_you_mean(str(name), names)
        raise EffectError(f"the model has no {kind} {name!r}{hint}; it has: {known}")
    return names.index(name)


class FieldBound(Bound):
    """Writes k = 1 value a row into the same elements of one model field, from the model's own values."""

    def __init__(self, field: np.ndarray, nominal: np.ndarray, elements: tuple[Any, ...], parameter: Parameter) -> None:
        self._field, self._elements, self._parameter = field, elements, parameter  # field (N, ...)
        self._nominal = np.array(nominal[elements], dtype=np.float64)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Set, add to or scale the nominal elements in the rows ids; values (n, 1)."""
        ones = [1] * self._nominal.ndim
        value = values.reshape(-1, *ones)
        if self._parameter.how == "add":
            new = self._nominal + value
        elif self._parameter.how == "scale":
            new = self._nominal * value
        else:  # absent means the model's own values, which may differ between the elements
            new = np.where(value == self._parameter.neutral, self._nominal, value)
        self._field[(ids.reshape(-1, *ones), *self._elements)] = new


class FieldEffect(Effect):
    """An effect that is one plain field of the model at one joint, actuator or body.

    Subclasses name the `field`; `elements` says which entries of it belong to the place.
    """

    field: ClassVar[str]
    minimum: ClassVar[float] = 0.0  # the smallest value that the field may take
    column: ClassVar[int | None] = None  # the entry of a row of the field, where it has several

    def elements(self, model: mujoco.MjModel) -> tuple[Any, ...]:
        """Return the index into the field, without the row axis."""
        kind = self.place
        if kind not in ("joint", "actuator", "body"):
            raise NotImplementedError(f"{type(self).__name__} must say which elements of {self.field} it writes")
        index = find(model, kind, self.where)
        if kind == "joint":
            index = int(model.jnt_dofadr[index]) if self.field.startswith("dof_") else index
        return (index,) if self.column is None else (index, self.column)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the one parameter; the range keeps the field at or above its minimum."""
        nominal = np.asarray(getattr(model, self.field)[self.elements(model)], dtype=np.float64)
        if self.how == "add":
            low = float(np.max(self.minimum - nominal))
            return (self.parameter(low=low),)
        if self.how == "scale":
            return (self.parameter(low=0.0),)
        return (self.parameter(low=self.minimum, neutral=float(nominal.flat[0])),)

    def bind(self, plant: Plant) -> Bound:
        """Give the field a value per row."""
        model = plant.model
        (parameter,) = self.parameters(model)
        return FieldBound(plant.batch.expand(self.field), getattr(model, self.field), self.elements(model), parameter)
