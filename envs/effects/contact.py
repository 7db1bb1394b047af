"""Effects on how the robot touches the world."""

from copy import copy
from dataclasses import replace
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect
from envs.effects.bound import BoundEffect
from envs.effects.field import BoundFieldGroup, FieldEffect
from envs.effects.places import find
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.errors import EffectError, refuse_unknown
from envs.params import How, Parameter

FrictionMode = Literal["contact", "seed"]


STANDING = 5e-3  # m: a geom this near to the ground in a logged pose is taken to stand on it
DOMINANT = 1e6  # solmix of a geom whose contacts are its own affair


def ground(model: mujoco.MjModel) -> np.ndarray:
    """Return the geoms of fixed bodies that something which moves can touch, (k,)."""
    fixed, moving = _sides(model)
    return fixed[_meet(model, fixed, moving).any(axis=1)]


def soles(model: mujoco.MjModel) -> np.ndarray:
    """Return the geoms of moving bodies that can touch the ground, (k,)."""
    fixed, moving = _sides(model)
    return moving[_meet(model, fixed, moving).any(axis=0)]


def _sides(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the geoms of fixed bodies and of moving ones."""
    fixed = model.body_weldid[model.geom_bodyid] == 0
    return np.flatnonzero(fixed), np.flatnonzero(~fixed)


def _meet(model: mujoco.MjModel, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return which geoms the engine lets collide, by their masks, (one, other) bool."""
    kind, affinity = model.geom_contype, model.geom_conaffinity
    forth = kind[one][:, None] & affinity[other]
    return (forth | (affinity[one][:, None] & kind[other])) > 0


def touching(model: mujoco.MjModel, poses: np.ndarray) -> tuple[str, ...]:
    """Return the names of what stands on the ground in any of the poses (K, nq).

    A geom's own name, or that of its body where it has none.
    """
    near, data = copy(model), mujoco.MjData(model)
    near.geom_margin[:] = model.geom_margin + STANDING
    still, feet, found = set(ground(model)), set(soles(model)), set()
    for pose in poses if still and feet else ():
        data.qpos[:] = pose
        mujoco.mj_kinematics(near, data)
        mujoco.mj_collision(near, data)
        for pair in data.contact.geom:
            found |= set(pair) & feet if set(pair) & still else set()
    names = [_name_of(model, int(i)) for i in sorted(found)]
    return tuple(dict.fromkeys(name for name in names if name))


def _name_of(model: mujoco.MjModel, geom: int) -> str:
    """Return how `where` calls a geom: its own name, or its body's where it has none."""
    return model.geom(geom).name or model.body(int(model.geom_bodyid[geom])).name


class _ContactEffect(Effect):
    """An effect on the contacts of one foot with the ground, or of all the robot's feet.

    `where` is a geom, or a body whose geoms have no names: all of those that can touch the ground.
    Without `where` the feet are the geoms with `foot` in their names; of a robot that names none,
    every geom that can touch the ground.
    """

    place = "contact"

    @classmethod
    def places(cls, scale: RobotScale) -> list[str | None]:
        """Return all feet as one, and each geom that touches the ground where several do."""
        each = list(scale.touching) if len(scale.touching) > 1 else []
        return [None, *each] if scale.touching else []

    def _feet(self, model: mujoco.MjModel) -> list[int]:
        can = soles(model).tolist()
        if self.where is not None:
            named = [i for i in can if _name_of(model, i) == self.where]
            return named or [find(model, "geom", self.where)]
        if not can:
            raise EffectError(
                f"{self.name}: no geom of this model can touch the ground; give its feet contacts"
            )
        return [i for i in can if "foot" in model.geom(i).name] or can

    def _ground(self, model: mujoco.MjModel) -> list[int]:
        found = ground(model).tolist()
        if not found:
            raise EffectError(f"{self.name} needs a ground: a fixed geom that collides")
        return found


class GroundFriction(_ContactEffect, FieldEffect):
    """Sliding friction coefficient between the ground and the robot.

    MuJoCo uses the larger coefficient of the two geoms, so `friction_mode: contact` sets both;
    with `where`, other geoms keep theirs. `friction_mode: seed` sets the robot's geom only, which
    has no effect below the floor's coefficient.

    Args:
        where: the geom of the robot, or a body whose geoms have no names; None for all its feet,
            with one value: the geoms with "foot" in their names, or, where there is none, every
            geom that can touch the ground.
        how: `set` (default) or `scale`.
        friction_mode: "contact" or "seed".
    """

    name = "ground_friction"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("set", "scale")
    field = "geom_friction"
    typical = (0.3, 1.5)
    symptom = "feet that slip more, or less, than in the model when the tangential load changes"
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
        refuse_unknown("friction_mode", friction_mode, ("contact", "seed"))
        self.friction_mode = friction_mode

    def options(self) -> dict[str, Any]:
        """Return the friction mode."""
        return {"friction_mode": self.friction_mode}

    def elements(self, model: mujoco.MjModel) -> tuple[Any, ...]:
        """Return the sliding coefficients of the feet and, in mode contact, of the ground."""
        feet, floor = self._feet(model), self._ground(model)
        return np.array(feet + (floor if self.friction_mode == "contact" else [])), 0

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the coefficient, whose neutral value is that of the contact as it is."""
        (parameter,) = super().parameters(model)
        if self.how == "set" and self.friction_mode == "contact":
            both = [self._feet(model)[0], *self._ground(model)]
            return (replace(parameter, neutral=float(model.geom_friction[both, 0].max())),)
        return (parameter,)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the coefficients of each row."""
        if self.where is None or self.friction_mode == "seed":
            return super().bind(plant)
        (parameter,) = self.parameters(plant.model)
        foot, floor = np.array(self._feet(plant.model)), self._ground(plant.model)
        return _Grip(plant, foot, np.array(floor), parameter)


class _Grip(BoundEffect):
    """Writes the friction of one foot on the ground, and leaves that of the others as it is."""

    def __init__(
        self, plant: PlantView, foot: np.ndarray, floor: np.ndarray, parameter: Parameter
    ) -> None:
        self._friction, self._foot, self._floor = plant.field("geom_friction"), foot, floor
        self._others = np.setdiff1d(soles(plant.model), foot)
        self._how, self._neutral = parameter.how, parameter.neutral

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        changed = values[:, 0] != (1.0 if self._how == "scale" else self._neutral)
        ids, value = ids[changed], values[changed, 0]
        row, friction = ids[:, None], self._friction
        own, floor = friction[row, self._foot, 0].max(axis=1), friction[row, self._floor, 0]
        highest = floor.max(axis=1)
        new = value * np.maximum(own, highest) if self._how == "scale" else value
        friction[row, self._others, 0] = np.maximum(
            friction[row, self._others, 0], highest[:, None]
        )
        friction[row, self._floor, 0] = np.minimum(floor, new[:, None])
        friction[row, self._foot, 0] = new[:, None]


class _Stiffness(BoundEffect):
    """Scales the stiffness of geoms' contacts at their damping ratio."""

    def __init__(self, plant: PlantView, geoms: np.ndarray) -> None:
        self._solref, self._geoms = plant.field("geom_solref"), geoms  # (N, ngeom, 2)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        at = (ids[:, None], self._geoms)
        self._solref[at] = stiffened(self._solref[at], values[..., None])


def stiffened(reference: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Return solver references (n, k, 2) for a factor (n, 1, 1) on the stiffness."""
    root = np.sqrt(factor)
    standard = np.concatenate(
        [reference[..., :1] / root, reference[..., 1:]], axis=-1
    )  # (time constant, damping ratio)
    direct = np.concatenate(
        [reference[..., :1] * root**2, reference[..., 1:] * root], axis=-1
    )  # (-stiffness, -damping)
    return np.where(reference[..., :1] > 0, standard, direct)


class _OwnStiffness(BoundEffect):
    """Scales the stiffness of one geom's contacts, which it then decides alone."""

    def __init__(self, plant: PlantView, foot: int, floor: int) -> None:
        self._solref, self._mix = plant.field("geom_solref"), plant.field("geom_solmix")
        self._foot, self._floor = foot, floor

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        changed = values[:, 0] != 1.0
        ids, factor = ids[changed], values[changed]  # (n, 1)
        share = self._mix[ids, self._foot] / (
            self._mix[ids, self._foot] + self._mix[ids, self._floor]
        )
        pair = (
            share[:, None] * self._solref[ids, self._foot]
            + (1 - share)[:, None] * self._solref[ids, self._floor]
        )  # what the engine makes of both, (n, 2)
        self._solref[ids, self._foot] = stiffened(pair[:, None], factor[..., None])[:, 0]
        self._mix[ids, self._foot] = DOMINANT


class ContactStiffness(_ContactEffect):
    """Stiffness of the contacts with the ground, as a factor; the damping ratio is unchanged.

    The engine keeps a contact's time constant at two time steps or more, which limits large
    factors.
    """

    name = "contact_stiffness"
    engines = BOTH
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale",)
    composes = True
    typical = (0.1, 10.0)
    no_mjcf = None
    symptom = "landings that are softer or harder, and feet that sink in"
    source = "MuJoCo documentation, Modeling, solver parameters: stiffness ~ 1 / time constant²"
    experiment = "drop tests from two heights"
    group = PLAIN

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the factor.

        Raises:
            EffectError: no ground, or one geom whose contacts are given by stiffness and damping
                (a negative `solref`): of two such references the engine takes the smaller one.
        """
        geoms = self._feet(model) + self._ground(model)
        if (
            self.where is not None
            and (model.geom_solref[geoms, 0] <= 0).any()
            and self._shared(model)
        ):
            raise EffectError(
                f"{self.label()}: its contacts have a negative solref; give it as a time constant"
                " and a damping ratio, or leave out where"
            )
        return (self.parameter(low=1e-6),)

    def _shared(self, model: mujoco.MjModel) -> bool:
        """Return whether other geoms than this one can touch the same ground."""
        return len(soles(model)) > len(self._feet(model))

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the contacts' reference of each row."""
        feet, floor = self._feet(plant.model), self._ground(plant.model)
        if self.where is not None and self._shared(plant.model):
            return BoundFieldGroup([_OwnStiffness(plant, foot, floor[0]) for foot in feet])
        return _Stiffness(plant, np.array(feet + floor))
