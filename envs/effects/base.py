"""An effect: one named way in which a robot differs from its model.

A new effect is one class: its `parameters` list its scalars on a given model, and `bind` connects
it to a plant. Randomization, evaluation grids, `effects.yaml` and diagnosis then all use it.

    class DryFriction(FieldEffect):
        name, place, unit, hows = "dry_friction", "joint", "N·m", ("add", "set")
        field = "dof_frictionloss"

At its parameters' neutral values, an effect does not change the plant.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from envs.effects.bound import BoundEffect
from envs.effects.extras import Extra, Sizes
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.errors import EffectError, did_you_mean
from envs.params import How, Parameter, Side
from envs.physics.base import Engine

Place = Literal["joint", "actuator", "body", "contact", "robot"]


RENAMED = {  # attributes that users' own effects set
    "words": "display_name",
    "closes_gaps": "visible_in_replay",
    "why_not_mjcf": "mjcf_limitation",
}
BOTH: tuple[Engine, ...] = ("batch", "warp")  # engines of what does not act between steps
PLAIN, RULES = "plain", "rules"  # groups of effects that can be simulated in one batch


class Effect:
    """A named difference from the model, bound to a plant.

    Args:
        where: the joint, actuator, body or geom. None: the whole robot; for a joint effect every
            joint that an actuator drives, for an actuator effect every actuator that can have it,
            with one value for all.
        how: `set`, `add` or `scale`; None: the first that the effect lists.
        side: for backlash and compliance, the side of the encoder: `motor` or `link`.
        free: extras that are parameters, to be drawn or fitted; the others are constants.
        extra: values of constant extras, and neutral values of free extras.

    Raises:
        EffectError: the effect does not have this `how`, side or extra, or `where` is missing or
            not allowed.
    """

    name: ClassVar[str]
    place: ClassVar[Place]
    unit: ClassVar[str]
    hows: ClassVar[tuple[How, ...]] = ("add",)
    sides: ClassVar[tuple[Side, ...]] = ()
    extras: ClassVar[tuple[Extra, ...]] = ()
    # What real robots show, in the first way; a fit starts inside.
    typical: ClassVar[tuple[float, float]] = (0.0, 1.0)
    limits: ClassVar[tuple[float, float]] = (-np.inf, np.inf)  # of its value
    components: ClassVar[Sequence[str]] = ()  # names of its values, where it has several
    neutral: ClassVar[float | None] = None  # its value where it is absent; None: that of the way
    # Where a search looks first: factors of what it scales; values (K,) or (K, k), see `probes`.
    factors: ClassVar[tuple[float, ...]] = (0.5, 0.75, 1.3, 1.8)
    first_values: ClassVar[Any] = None

    # For people. Sentences without a full stop.
    display_name: ClassVar[str] = ""  # the name in words; "": the standard name without underscores
    symptom: ClassVar[str]  # what a person sees in the log when it is there
    source: ClassVar[str]  # where its equation comes from
    experiment: ClassVar[str]  # the recording that isolates it

    # For the simulator.
    law: ClassVar[type[Any]]  # what acts on a plant, made of plant and effect; see `bind`
    engines: ClassVar[tuple[Engine, ...]] = ("batch",)  # that have it
    constants: ClassVar[bool] = False  # whether the model's derived constants depend on it
    moves_mass: ClassVar[bool] = False  # whether it moves a centre of mass or turns principal axes
    jumps: ClassVar[bool] = False  # whether its force jumps at an edge that a long step overshoots
    composes: ClassVar[bool] = False  # whether it may stand twice at a place, added or multiplied

    # For diagnosis and exam; see also `variants`, `probes`, `batch`, `mjcf_limitation`, `to_mjcf`.
    group: ClassVar[str] = ""  # PLAIN, RULES or "", alone: what it is simulated side by side with
    visible_in_replay: ClassVar[bool] = True  # False: noise, what a camera sees
    shared: ClassVar[bool] = False  # whether one value for all its places is tried as well
    no_mjcf: ClassVar[str | None] = "its class does not declare that MJCF can"  # None: MJCF can
    own_mjcf: ClassVar[bool] = False  # whether `to_mjcf` writes it, and not its model fields
    comparable: ClassVar[bool] = False  # whether the emulator's law takes the same value
    sizes: ClassVar[Sizes | None] = None  # what an exam hides of it; None: nothing

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Take attributes of a user's effect under the names that they had before 0.2."""
        super().__init_subclass__(**kwargs)
        for old, new in RENAMED.items():
            if old in cls.__dict__:
                message = f"{cls.__name__}.{old} is now {new}; the old name goes in 0.3"
                warnings.warn(message, DeprecationWarning, stacklevel=2)
                setattr(cls, new, cls.__dict__[old])

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
                f"choose one of: {', '.join(self.sides)}"
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
        """Return the name of the effect's parameter or of one of its extras."""
        return ".".join([self.name, *([self.where] if self.where else []), *scalar])

    def parameter(self, *scalar: str, **changes: Any) -> Parameter:
        """Return a Parameter with this effect's name, location, `how` and unit, unless changed."""
        own: dict[str, Any] = {
            "side": self.side,
            "unit": self.unit,
            "neutral": float(self.how == "scale") if self.neutral is None else self.neutral,
            "how": self.how,
        }
        return Parameter(self.label(*scalar), self.name, self.where, **{**own, **changes})

    def options(self) -> dict[str, Any]:
        """Return the non-numeric arguments by name, as in `effects.yaml`."""
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
        """Return an extra's values, (n,): from the values written, (n, k), or its constant."""
        free = [e.name for e in self.extras if e.name in self.free]
        if name in free:
            return values[:, values.shape[1] - len(free) + free.index(name)]
        return np.full(len(values), self.extra[name])

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the elements that the effect needs to the model."""

    @property
    def edits(self) -> bool:
        """Whether the effect adds elements, so that the model has to be recompiled."""
        return type(self).edit is not Effect.edit

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError if the model cannot have the effect, for example without the joint."""
        if self.place == "joint":
            joints(model, self.where)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the parameters on this model: by default the value, then the free extras.

        Raises:
            EffectError: the model cannot have the effect.
        """
        self.check(model)
        low, high = self.limits
        names = [(name,) for name in self.components] or [()]
        values = (self.parameter(*name, low=low, high=high) for name in names)
        return (*values, *self.free_parameters())

    def bind(self, plant: PlantView) -> BoundEffect:
        """Connect the effect to a plant: by default its `law`."""
        return self.law(plant, self)

    @classmethod
    def in_words(cls) -> str:
        """Return the name for a sentence: `Coulomb friction`."""
        return cls.display_name or cls.name.replace("_", " ")

    @property
    def variant(self) -> str:
        """Return the option that two such effects at one location differ in: `link side` or ""."""
        return f"{self.side} side" if self.side else ""

    @classmethod
    def places(cls, scale: RobotScale) -> list[str | None]:
        """Return the locations on a robot that a search tries; None: the whole robot."""
        kinds = {"joint": scale.joints, "actuator": scale.actuators, "body": scale.bodies}
        if cls.place not in kinds:
            return [None]
        own = kinds[cls.place]
        return [*own, None] if cls.shared and len(own) > 1 else [*own]

    @classmethod
    def variants(cls, scale: RobotScale) -> list[dict[str, Any]]:
        """Return the arguments other than `where` that a search tries.

        All sides are tried, with the fitted extras free but those for later. Required extras are
        taken from the robot; if one is unknown, nothing is returned.
        """
        needed = [e.name for e in cls.extras if e.default is None]
        if not scale.known.keys() >= set(needed):
            return []
        more: dict[str, Any] = {name: scale.known[name] for name in needed}
        if free := tuple(e.name for e in cls.extras if e.fit is not None and not e.later):
            more["free"] = free
        return [{"side": side, **more} for side in cls.sides] or [more]

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return values that span the usual range on a robot, with which a search starts.

        Args:
            scale: sizes of the robot.

        Returns:
            (K,), or (K, k) for its first k parameters; the others stay neutral. A search looks at
            every second one first.
        """
        if self.first_values is not None:
            return np.array(self.first_values)
        if self.how == "scale":
            return np.array(self.factors)
        low, high = self.typical
        values = low + (high - low) * np.array([0.08, 0.25, 0.7])
        return np.concatenate([values, -values]) if low < 0 else values

    def batch(self) -> str:
        """Return the group of effects that can be simulated in one batch.

        `PLAIN` for effects that only write model fields, `RULES` for effects stepped from Python;
        a separate group if the effect adds elements or does not state its group.
        """
        return self.group or self.name

    def memory(self, model: mujoco.MjModel) -> list[str]:
        """Return names of what it remembers that a log does not tell at the start of a window.

        For each, a substep rule that it binds has that `memory` and can `misremember`.
        """
        return []

    def mjcf_limitation(self) -> str | None:
        """Return why MJCF cannot express the effect, or None if it can."""
        return self.no_mjcf

    def to_mjcf(self, spec: mujoco.MjSpec, model: mujoco.MjModel, values: Sequence[float]) -> None:
        """Write the effect into a spec, if `own_mjcf` is set.

        Args:
            spec: the model, with the other effects.
            model: the same model, compiled.
            values: values of its parameters.
        """
        raise NotImplementedError(f"{self.name} is written through the model fields of its plant")

    @classmethod
    def draw_extras(cls, units: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw the extras of an effect that an exam hides.

        Args:
            units: scales of the sizes at its location.
            rng: random generator.
        """
        return {}
