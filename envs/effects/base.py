"""An effect: one named way in which a robot differs from its model.

A new effect is one class: its `parameters` say what scalars it has on a given model, `bind`
connects it to a plant. It is then known to randomization, evaluation grids, `effects.yaml` and
diagnosis alike.

    class DryFriction(FieldEffect):
        name, place, unit, hows = "dry_friction", "joint", "N·m", ("add", "set")
        field = "dof_frictionloss"

An effect is absent at its parameters' neutral values: the plant then behaves as if it were not
there.

In one control step a plant calls its bound effects in this order, within a kind by their `order`,
then as given:

1. `CommandRule`: what arrives of the command (packet loss), once a control step;
2. `SubstepRule`: before each physics substep (goal profiles 10, servo feedback 20, dead zone 30,
   supply 40, friction 50, applied torques 60); the command's delay is the engine's own and follows;
3. `Measurement`: what the sensors say afterwards (side of a play 10, sampling delay 20, encoder
   offset 30, noise 40, quantization 50, speed filter 60).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import mujoco
import numpy as np

from envs.effects.plant_view import PlantView
from envs.errors import EffectError, did_you_mean
from envs.params import How, Parameter, Side

Place = Literal["joint", "actuator", "body", "contact", "robot"]


class Extra(NamedTuple):
    """A further scalar of an effect: a constant, or a parameter where it is in `free`."""

    name: str
    unit: str
    default: float | None  # None: must be given
    low: float
    high: float
    about: str


class Bound:
    """An effect connected to one plant, which calls it; each method does nothing by default."""

    order: ClassVar[int] = 100  # among the bound effects of its kind, small first

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put the values (n, k) of the effect's k parameters into the rows ids.

        The plant restores the model's own values of the fields it gave out (`Plant.field`) before
        it calls this, so that effects on one field compose: each adds to or scales what the ones
        before it left.
        """

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        """Forget what the rows ids remember; their state is set, nothing is measured yet."""

    def start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        """Take note of the commands (n, nu) held from before the episodes in the rows ids."""


class CommandRule(Bound, ABC):
    """A bound effect that changes what arrives of the command, once a control step."""

    @abstractmethod
    def command(self, ids: np.ndarray | slice, ctrl: np.ndarray) -> None:
        """Change the commands ctrl (n, nu) of the rows ids in place."""


class SubstepRule(Bound, ABC):
    """A bound effect that acts before each physics substep, on all the rows of a call at once.

    Rows in which all of its parameters are neutral are left out: what it remembers stands still
    there. A mechanism that several effects share acts on every row.

    It changes controls (`plant.ctrl`), model fields (`Plant.live`, restored before each substep) or
    adds to the applied forces (`Plant.applied`, zeroed before each substep).
    """

    @abstractmethod
    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Act on the rows ids, through the plant's batch (controls, applied forces)."""


class Measurement(Bound, ABC):
    """A bound effect that changes what the robot's sensors say, not what the robot does."""

    @abstractmethod
    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Change the measured qpos (n, nq) [rad, m] and qvel (n, nv) of the rows ids in place.

        Called once after each reset and each control step: a measurement may remember the ones
        before.
        """

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray) -> None:
        """Turn measured positions (n, nq) into true ones in place, as far as that can be told."""


class Effect(ABC):
    """A named way to differ from the model; a plant binds it.

    Args:
        where: the joint, actuator, body or geom. None: the whole robot; for a joint effect every
            joint that an actuator drives, for an actuator effect every actuator that can have it,
            with one value for all.
        how: `set`, `add` or `scale`; None takes the effect's first way.
        side: for backlash and compliance: `motor` (the encoder is before them) or `link` (the servo
            sees them).
        free: the extras that are parameters of their own, to be drawn or fitted; the others are
            constants.
        extra: values of the extras that are constants, or neutral values of the free ones.

    Raises:
        EffectError: a way, side or extra that the effect does not have, or a missing or needless
            place.
    """

    name: ClassVar[str]
    place: ClassVar[Place]
    unit: ClassVar[str]
    hows: ClassVar[tuple[How, ...]] = ("add",)
    sides: ClassVar[tuple[Side, ...]] = ()
    extras: ClassVar[tuple[Extra, ...]] = ()
    typical: ClassVar[tuple[float, float]] = (
        0.0,
        1.0,
    )  # what real robots show, in the first way; a fit starts inside
    looks_like: ClassVar[str]  # what a person sees in the log when it is there
    source: ClassVar[str]  # where its equation comes from
    experiment: ClassVar[str]  # the recording that isolates it
    constants: ClassVar[bool] = (
        False  # whether the model's derived constants follow from what it writes
    )
    composes: ClassVar[bool] = False  # whether it may stand twice at one place, added or multiplied

    def __init__(
        self,
        where: str | None = None,
        how: How | None = None,
        side: Side | None = None,
        free: Sequence[str] = (),
        **extra: float,
    ) -> None:
        self.where = where
        self.how: How = how or self.hows[0]
        if self.how not in self.hows:
            raise EffectError(
                f"{self.name} cannot {self.how!r} a value; it can: {', '.join(self.hows)}"
            )
        if self.place == "robot" and where is not None:
            raise EffectError(f"{self.name} acts on the whole robot; leave out where={where!r}")
        if self.place == "body" and where is None:
            raise EffectError(f"{self.name} needs where: the name of a {self.place}")
        self.side = self._checked_side(side)
        self.free = tuple(free)
        self.extra = self._checked_extra(extra)

    def _checked_side(self, side: Side | None) -> Side | None:
        if side is None:
            return self.sides[0] if self.sides else None
        if side not in self.sides:
            allowed = (
                f"it can be: {', '.join(self.sides)}"
                if self.sides
                else "it has no sides; leave it out"
            )
            raise EffectError(
                f"{self.label()}: side={side!r} is unknown"
                f"{did_you_mean(str(side), self.sides)}; {allowed}"
            )
        return side

    def _checked_extra(self, given: dict[str, float]) -> dict[str, float]:
        known = {e.name: e for e in self.extras}
        for name in (*given, *self.free):
            if name not in known:
                there = ", ".join(known) or "none"
                raise EffectError(
                    f"{self.label()} has no extra {name!r}{did_you_mean(name, known)};"
                    f" it has: {there}"
                )
        values = {}
        for e in self.extras:
            value = given.get(e.name, e.default)
            if value is None:
                raise EffectError(f"{self.label()} needs {e.name} [{e.unit}]: {e.about}")
            if (
                isinstance(value, bool)
                or not isinstance(value, int | float)
                or not math.isfinite(value)
                or not e.low <= value <= e.high
            ):
                raise EffectError(
                    f"{self.label()}: {e.name}={value!r} {e.unit} is outside"
                    f" [{e.low:g}, {e.high:g}]"
                )
            values[e.name] = float(value)
        return values

    def label(self, *scalar: str) -> str:
        """Return the name of the effect's parameter, or of one of its further scalars."""
        return ".".join([self.name, *([self.where] if self.where else []), *scalar])

    def parameter(self, *scalar: str, **changes: Any) -> Parameter:
        """Return a Parameter with this effect's name, place, way, unit and the given changes."""
        own: dict[str, Any] = {
            "side": self.side,
            "unit": self.unit,
            "neutral": {"add": 0.0, "scale": 1.0, "set": 0.0}[self.how],
            "how": self.how,
        }
        return Parameter(self.label(*scalar), self.name, self.where, **{**own, **changes})

    def options(self) -> dict[str, Any]:
        """Return the arguments that are no numbers, by name, as `effects.yaml` keeps them."""
        return {}

    def free_parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of the free extras, in the order of the class."""
        return tuple(
            self.parameter(
                e.name, unit=e.unit, neutral=self.extra[e.name], low=e.low, high=e.high, how="set"
            )
            for e in self.extras
            if e.name in self.free
        )

    def scalar(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return an extra's values, (n,), from values (n, k) of a write or its constant."""
        free = [e.name for e in self.extras if e.name in self.free]
        if name in free:
            return values[:, values.shape[1] - len(free) + free.index(name)]
        return np.full(len(values), self.extra[name])

    def edit(self, spec: mujoco.MjSpec) -> None:  # noqa: B027 - most effects need no structure
        """Add to the model's structure what the effect needs."""

    @abstractmethod
    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the parameters on this model; raises EffectError if it cannot have the effect."""

    @abstractmethod
    def bind(self, plant: PlantView) -> Bound:
        """Connect the effect to a plant."""


def find(
    model: mujoco.MjModel, kind: Literal["joint", "actuator", "body", "geom"], name: str | None
) -> int:
    """Return the id of a named object; raises EffectError that lists the model's names."""
    kinds = {
        "joint": model.njnt,
        "actuator": model.nactuator,
        "body": model.nbody,
        "geom": model.ngeom,
    }
    names = [getattr(model, kind)(i).name for i in range(kinds[kind])]
    if name is None or name not in names:
        known = ", ".join(n for n in names if n and n != "world")
        hint = did_you_mean(str(name), names)
        raise EffectError(f"the model has no {kind} {name!r}{hint}; it has: {known}")
    return names.index(name)


def joints(model: mujoco.MjModel, where: str | None) -> np.ndarray:
    """Return the id of the joint of that name, or those of every driven hinge and slide, (k,).

    Raises:
        EffectError: no such joint, one that does not turn about or slide along one axis, or no
            actuator on a joint.
    """
    if where is None:
        driven = {
            int(model.actuator_trnid[i, 0])
            for i in range(model.nactuator)
            if joint_driven(model, i)
        }
        found = np.array(sorted(j for j in driven if _scalar(model, j)), dtype=int)
        if not found.size:
            raise EffectError(
                "no actuator of this model drives a hinge or slide; say where: the name of a joint"
            )
        return found
    index = find(model, "joint", where)
    if not _scalar(model, index):
        raise EffectError(f"joint {where!r} is a ball or free joint; name a hinge or slide")
    return np.array([index])


def joint_driven(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether an actuator acts on a joint."""
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return int(model.actuator_trntype[actuator]) in [int(k) for k in kinds]


def _scalar(model: mujoco.MjModel, joint: int) -> bool:
    return int(model.jnt_type[joint]) in (
        int(mujoco.mjtJoint.mjJNT_HINGE),
        int(mujoco.mjtJoint.mjJNT_SLIDE),
    )


class FieldBound(Bound):
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


class FieldEffect(Effect):
    """An effect that is one plain field of the model at one joint, actuator or body.

    Subclasses name the `field`; `elements` says which entries of it belong to the place.
    """

    field: ClassVar[str]
    minimum: ClassVar[float] = 0.0  # the smallest value that the field may take
    column: ClassVar[int | None] = None  # the entry of a row of the field, where it has several
    composes: ClassVar[bool] = True

    def elements(self, model: mujoco.MjModel) -> tuple[Any, ...]:
        """Return the index into the field, without the row axis."""
        if self.place == "joint":
            index: Any = joints(model, self.where)
            index = model.jnt_dofadr[index] if self.field.startswith("dof_") else index
        elif self.place in ("actuator", "body"):
            index = find(model, self.place, self.where)  # type: ignore[arg-type]
        else:
            raise NotImplementedError(
                f"{type(self).__name__} must say which elements of {self.field} it writes"
            )
        return (index,) if self.column is None else (index, self.column)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the one parameter; the range keeps the field at or above its minimum.

        Raises:
            EffectError: no such place, or a factor on a field that is 0 there.
        """
        nominal = np.asarray(getattr(model, self.field)[self.elements(model)], dtype=np.float64)
        if self.how == "add":
            low = float(np.max(self.minimum - nominal))
            return (self.parameter(low=low),)
        if self.how == "scale":
            if not nominal.any():
                raise EffectError(
                    f"{self.label()}: the model's {self.field} is 0 there, and a factor changes"
                    " nothing; use how: add"
                )
            return (self.parameter(low=0.0),)
        return (self.parameter(low=self.minimum, neutral=float(nominal.flat[0])),)

    def bind(self, plant: PlantView) -> Bound:
        """Give the field a value per row."""
        (parameter,) = self.parameters(plant.model)
        return FieldBound(plant.field(self.field), self.elements(plant.model), parameter)
