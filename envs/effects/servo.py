"""Effects on an actuator's control law and limit.

A *servo* here is an actuator of the affine kind, force = g u + b0 + b1 length + b2 velocity with b1
< 0, as MuJoCo's `position` makes it. A *motor* has no b1 and b2.
"""

import itertools
from typing import Any, ClassVar

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, RULES, Effect, Extra, Sizes
from envs.effects.bound import BoundEffect, SubstepRule
from envs.effects.field import BoundFieldGroup, FieldBound, FieldEffect
from envs.effects.history import DelayedCommands
from envs.effects.places import block, members
from envs.effects.plant_view import PlantView
from envs.effects.registry import EFFECTS
from envs.effects.scale import RobotScale
from envs.errors import EffectError
from envs.params import How, Parameter

FIXED, PID = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_PID)
NONE, AFFINE = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
UNLIMITED = 1e6  # N·m: the torque limit of an actuator that has none


class ActuatorEffect(Effect):
    """An effect that only some kinds of actuator can have; `can` says which."""

    place = "actuator"
    shared = True

    @staticmethod
    def can(model: mujoco.MjModel, actuator: int) -> bool:
        """Return whether this actuator can have the effect."""
        raise NotImplementedError

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError where no actuator, or the named one, can have the effect."""
        self.actuators(model)

    def actuators(self, model: mujoco.MjModel) -> np.ndarray:
        """Return the ids of the actuators that the effect acts on, (k,).

        Raises:
            EffectError: no such actuator, or one that cannot have the effect; lists the effects
                that it can have.
        """
        if self.where is not None:
            index = members(model, "actuator", self.where)
            if not all(self.can(model, int(i)) for i in index):
                raise EffectError(
                    f"actuator {self.where!r} cannot have {self.name}; "
                    f"{_possible(model, index.tolist())}"
                )
            return index
        found = [i for i in range(model.nactuator) if self.can(model, i)]
        if not found:
            every = list(range(model.nactuator))
            raise EffectError(
                f"no actuator of this model can have {self.name}; {_possible(model, every)}"
            )
        return np.array(found)


def _possible(model: mujoco.MjModel, actuators: list[int]) -> str:
    kinds = [e for e in EFFECTS.values() if issubclass(e, ActuatorEffect)]
    names = sorted(e.name for e in kinds if any(e.can(model, i) for i in actuators))
    return f"it can have: {', '.join(names) or 'none of these effects'}"


def is_linear(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether an actuator's force is affine in control, length and velocity."""
    fixed = int(model.actuator_gaintype[actuator]) == FIXED
    return fixed and int(model.actuator_biastype[actuator]) in (NONE, AFFINE)


def is_servo(model: mujoco.MjModel, i: int) -> bool:
    """Return whether an actuator closes a position loop with a plain proportional gain."""
    affine = is_linear(model, i) and int(model.actuator_biastype[i]) == AFFINE
    return affine and model.actuator_biasprm[i, 1] < 0 and model.actuator_gainprm[i, 0] > 0


class _Gain(ActuatorEffect):
    """A factor on entries of an actuator's law."""

    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale",)
    typical = (0.4, 2.5)
    composes = True
    no_mjcf = None
    bias_column: ClassVar[int]
    with_gain: ClassVar[bool]
    limits = (0.0, np.inf)
    group = PLAIN

    def bind(self, plant: PlantView) -> BoundEffect:
        """Scale the law of each row."""
        (parameter,) = self.parameters(plant.model)
        index = self.actuators(plant.model)
        fields = [FieldBound(plant.field("actuator_biasprm"), (index, self.bias_column), parameter)]
        plain = index[plant.model.actuator_gaintype[index] == FIXED]
        if self.with_gain and plain.size:
            fields.append(FieldBound(plant.field("actuator_gainprm"), (plain, 0), parameter))
        return BoundFieldGroup(fields)


class PositionGain(_Gain):
    """The proportional gain of a position servo, as a factor."""

    name = "position_gain"
    engines = BOTH
    bias_column = 1
    with_gain = True
    comparable = True
    sizes = Sizes("factor", "one", 0.02, 1.2)
    factors = (0.02, 0.1, 0.5, 0.75, 1.3, 1.8)  # models are published with stand-ins such as 1000
    symptom = "a static sag under load, and steps that are too fast or too slow for their size"
    source = (
        "tau = kp (goal - q); the unit of the gain register may differ from the manual's (by a"
        " factor of 2 in the XL330)"
    )
    experiment = "steps and loaded holds at two gains; compare the PWM with the position error"

    @staticmethod
    def can(model: mujoco.MjModel, actuator: int) -> bool:
        """Return whether it has a gain on the position."""
        pid = (
            int(model.actuator_gaintype[actuator]) == PID
            and model.actuator_biasprm[actuator, 1] < 0
        )
        return is_servo(model, actuator) or bool(pid)


class DerivativeGain(_Gain):
    """The derivative gain of a servo, as a factor."""

    name = "derivative_gain"
    engines = BOTH
    bias_column = 2
    with_gain = False
    symptom = "overshoot after steps, or creeping towards the goal"
    source = "tau = -kv w; MuJoCo XML reference, position/kv"
    experiment = "steps from rest at two gains"

    @staticmethod
    def can(model: mujoco.MjModel, actuator: int) -> bool:
        """Return whether it has a gain on the velocity besides one on the position."""
        servo = is_servo(model, actuator) or int(model.actuator_gaintype[actuator]) == PID
        return servo and bool(model.actuator_biasprm[actuator, 2] < 0)


def limited(spec: mujoco.MjSpec, where: str | None) -> None:
    """Give actuators without a force range one that never acts; None: all of them."""
    for actuator in spec.actuators:
        wanted = where is None or actuator.name == where
        free = actuator.forcerange[0] >= actuator.forcerange[1]
        free = free or actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_FALSE
        if wanted and free and actuator.gaintype != mujoco.mjtGain.mjGAIN_SO3:
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.forcerange = [-UNLIMITED, UNLIMITED]


class TorqueLimit(FieldEffect, ActuatorEffect):
    """The largest torque at the joint, in either direction, even if the model has no limit."""

    name = "torque_limit"
    place = "actuator"
    unit = "N·m"
    hows: ClassVar[tuple[How, ...]] = ("set", "scale")
    field = "actuator_forcerange"
    typical = (0.1, 5.0)
    comparable = True
    sizes = Sizes("limit", "stall", 1.05, 20.0)
    symptom = "fast or heavily loaded motions lag; slow and lightly loaded motions do not"
    source = (
        "MuJoCo XML reference, actuator/forcerange; the servo's current limit times its"
        " torque constant"
    )
    experiment = "steps of growing size, and a lift of growing weight"

    @staticmethod
    def can(model: mujoco.MjModel, actuator: int) -> bool:
        """Return whether its force can be limited (every kind but three-dimensional ones)."""
        return int(model.actuator_gaintype[actuator]) != int(mujoco.mjtGain.mjGAIN_SO3)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Switch the limit on: the engine ignores a range that is not."""
        limited(spec, self.where)

    def elements(self, model: mujoco.MjModel) -> tuple[np.ndarray]:
        """Return the index of the actuators' ranges."""
        return (self.actuators(model),)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the limit at the joint, or its factor."""
        index = self.actuators(model)
        if self.how == "scale":
            return (self.parameter(low=0.0),)
        joint = np.abs(model.actuator_forcerange[index, 1] * model.actuator_gear[index, 0])
        return (
            self.parameter(low=0.0, high=max(UNLIMITED, float(joint[0])), neutral=float(joint[0])),
        )

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the limit of each row."""
        (parameter,) = self.parameters(plant.model)
        index = self.actuators(plant.model)
        if self.how == "scale":
            return FieldBound(plant.field(self.field), (index,), parameter)
        return _Limit(plant, index, parameter)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the motor's torque."""
        # Joints that carry little need the small ones.
        return np.array([0.7, 0.45, 0.25, 0.12, 0.04]) * scale.torque_at(self.where)


class _Limit(BoundEffect):
    """Sets both ends of a force range from a torque at the joint."""

    def __init__(self, plant: PlantView, index: np.ndarray, parameter: Parameter) -> None:
        self._range, self._index, self._neutral = (
            plant.field("actuator_forcerange"),
            index,
            parameter.neutral,
        )
        self._gear = np.abs(plant.model.actuator_gear[index, 0])

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        at = (ids[:, None], self._index)
        force = values / self._gear  # (n, k)
        ends = np.stack([-force, force], axis=-1)
        self._range[at] = np.where(values[..., None] == self._neutral, self._range[at], ends)


class _DeadZone(SubstepRule):
    """See `DeadZone`."""

    order = 30

    def __init__(self, plant: PlantView, effect: ActuatorEffect) -> None:
        index = effect.actuators(plant.model)
        self.plant, self.index, self.arrivals = plant, index, DelayedCommands.of(plant)
        self.arrays, self.effect = plant.arrays, effect
        for name in ("actuator_gainprm", "actuator_biasprm"):
            plant.live(name)
        self.value, self.punch = np.zeros(plant.num_rows), np.ones(plant.num_rows)
        self.gear = self.arrays.own(plant.model.actuator_gear[index, 0])
        self.turn = self.arrays.xp.abs(self.gear)
        joint = plant.model.actuator_trnid[index, 0]
        self.q = plant.model.jnt_qposadr[joint]

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[ids] = values[:, 0]
        self.punch[ids] = self.effect.scalar("punch", values)

    def prepare(self, ids: np.ndarray | slice) -> None:
        own, index = self.arrays.own, self.arrays.index
        self.gain, self.bias = (
            self.plant.now(name) for name in ("actuator_gainprm", "actuator_biasprm")
        )
        self.at, self.places = index(block(ids, self.index)), index(block(ids, self.q))
        self.width = own(self.value[ids, None])
        missing = (1.0 - self.punch[ids, None]) * self.value[ids, None]
        self.missing = own(missing) * self.turn if missing.any() else None  # (n, k)

    def before_substep(self, ids: Any) -> None:
        xp = self.arrays.xp
        gain, held, stiff = self.gain[(*self.at, 0)], *(self.bias[(*self.at, c)] for c in (0, 1))
        length = self.gear * self.plant.layout.raw_qpos[self.places]
        law = gain * self.arrivals.at(self.at) + held + stiff * length  # (n, k)
        error = xp.abs(law) / xp.where(gain > 0, gain, 1.0) / self.turn  # rad at the joint
        idle = error < self.width
        if self.missing is not None:
            held = held - xp.sign(law) * gain * self.missing
        if self.missing is not None or idle.any():
            self.gain[(*self.at, 0)] = xp.where(idle, 0.0, gain)
            self.bias[(*self.at, 0)] = xp.where(idle, 0.0, held)
            self.bias[(*self.at, 1)] = xp.where(idle, 0.0, stiff)


class DeadZone(ActuatorEffect):
    """Position error that a servo ignores: below it the proportional term is zero.

    Beyond it the whole error counts (`punch` 1), or only the excess (`punch` 0, as in older
    servos). A diagnosis considers these two.
    """

    name = "dead_zone"
    engines = BOTH
    jumps = True
    unit = "rad"
    extras = (
        Extra(
            "punch",
            "",
            1.0,
            0.0,
            1.0,
            "fraction of the proportional torque that acts at the edge of the zone",
            fit=(0.0, 1.0),
        ),
    )
    typical = (0.0, 0.03)
    no_mjcf = "a position actuator has no zone in which it is idle"
    comparable = True
    sizes = Sizes("add", "one", 3e-3, 0.12)
    symptom = "the servo stops a fixed angle short, whatever the gain, and its PWM is zero there"
    source = (
        "u = 0 if |e| < d, else kp (e - (1 - punch) d sign(e)); compliance margin and punch in the"
        " AX-12's manual. An XL430 stops 4 to 5 counts short (answers.ros.org 303081)"
    )
    experiment = "very slow ramps without load, at two gains"
    limits = (0.0, np.inf)
    first_values = tuple(itertools.product((0.004, 0.012, 0.035, 0.1), (1.0, 0.0)))
    group = RULES
    law = _DeadZone

    @staticmethod
    def can(model: mujoco.MjModel, actuator: int) -> bool:
        """Return whether it is a position servo on a joint."""
        return is_joint_servo(model, actuator)


def is_joint_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether a position servo acts on a hinge or slide."""
    on_joint = int(model.actuator_trntype[actuator]) == int(mujoco.mjtTrn.mjTRN_JOINT)
    return on_joint and is_servo(model, actuator)
