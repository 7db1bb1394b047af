"""Effects that need an additional joint between motor and link: play and elasticity.

The motor's joint keeps its name, actuator, friction and armature; a second joint about the same
axis follows it. Where encoders sit is two choices, since a robot may have two: `side` is where the
servo's own sits, `encoder` where the log's does (left out: the same one):

* `motor`: the motor's angle. Such a servo never knows of the play; such a log leaves it out.
* `link`: the sum. Such a servo closes its loop over the play: the law's bias is shifted by it
  before each substep.

In neutral rows of a plant with such a joint it has no axis: nothing moves it, it moves nothing, and
they agree with a plant without it but for the order of additions. (A large inertia would hold it as
well, but MuJoCo's solver stops by a tolerance relative to the trace of the inertia matrix, and with
1e9 kg·m² in it, before contacts have converged.) A motor without inertia of its own gets the least
with which the loop is stable at the model's time step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import mujoco
import numpy as np

from envs.effects.base import BOTH, Effect, Extra, Sizes
from envs.effects.bound import BoundEffect, Measurement, SubstepRule
from envs.effects.layout import SERIES
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale, link_inertia
from envs.effects.servo import is_joint_servo
from envs.errors import EffectError, did_you_mean, refuse_unknown
from envs.params import How, Side

BETWEEN = 0.05  # of the link's inertia: what lies between a spring and a play at one joint
STABLE = 0.25  # largest (dt w)² of a spring that the explicit integration carries well


class Series(BoundEffect):
    """A joint in series with a motor's; the plant's layout adds its angle to the motor's."""

    order: ClassVar[int] = 20

    def __init__(self, plant: PlantView, effect: SeriesEffect, motor: int) -> None:
        model = plant.model
        self.plant, self.effect, self.motor = plant, effect, motor
        self.joint = int(
            mujoco.mj_name2id(
                model, mujoco.mjtObj.mjOBJ_JOINT, effect.joint_name(model.joint(motor).name)
            )
        )
        self.q, self.v = int(model.jnt_qposadr[self.joint]), int(model.jnt_dofadr[self.joint])
        self.motor_side = effect.encoder == "motor"
        self.rotor = int(model.jnt_dofadr[motor])
        self.armature, self.axis = plant.field("dof_armature"), plant.field("jnt_axis")
        self.value = np.zeros(plant.num_rows)
        self.least = least_rotor(plant, motor)
        others = [part for part in plant.layout.joints if part.motor == motor]
        self.between = BETWEEN * link_inertia(model, motor) if others else 0.0
        plant.layout.joints.append(self)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Give the joint its size, and no axis where the value is 0."""
        self.value[ids] = values[:, 0]
        loose, rotor = values[:, 0] > 0, self.armature[ids, self.rotor]
        self.axis[ids[~loose], self.joint] = 0.0
        self.armature[ids, self.v] = np.where(loose, self.between, self.least)
        self.armature[ids, self.rotor] = np.where(loose, np.maximum(rotor, self.least), rotor)

    def settle(self, ids: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return where the joint rests under the load (n,) [N·m] that the motor carries, (n,)."""
        return np.zeros(len(ids))


class MotorSide(Measurement):
    """Leaves a series joint out of what the encoder says."""

    order = 10

    def __init__(self, series: Series) -> None:
        self._series, self._layout = series, series.plant.layout
        self._address = self._layout.address(series.motor)

    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Subtract the joint's angle and speed."""
        qpos[:, self._address[0]] -= self._layout.raw_qpos[ids, self._series.q]
        qvel[:, self._address[1]] -= self._layout.raw_qvel[ids, self._series.v]

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Do nothing: the layout has left the joint out of what the encoder sees."""


class LinkSide(SubstepRule):
    """Closes servo loops over a series joint: kp (u - q) becomes kp (u - q - p), kv likewise."""

    order = 20

    def __init__(self, series: Series, servos: list[int]) -> None:
        self._series, self._servos = series, servos
        series.plant.live("actuator_biasprm")
        self._gear = [float(gear) for gear in series.plant.model.actuator_gear[:, 0]]

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Find the laws in the engine."""
        self._bias = self._series.plant.now("actuator_biasprm")

    def before_substep(self, ids: Any) -> None:
        """Shift the laws by where the joint is now."""
        layout = self._series.plant.layout
        p, speed = layout.raw_qpos[ids, self._series.q], layout.raw_qvel[ids, self._series.v]
        for i in self._servos:
            shift = self._bias[ids, i, 1] * p + self._bias[ids, i, 2] * speed
            self._bias[ids, i, 0] += self._gear[i] * shift


class SeriesEffect(Effect):
    """A joint between the motor of a hinge or slide and its link."""

    place = "joint"
    constants = True
    no_mjcf = None
    sides: ClassVar[tuple[Side, ...]] = ("motor", "link")
    bound: ClassVar[type[Series]]
    limits = (0.0, np.inf)

    def __init__(
        self,
        where: str | None = None,
        how: How | None = None,
        side: Side | None = None,
        encoder: Side | None = None,
        **arguments: Any,
    ) -> None:
        super().__init__(where, how, side, **arguments)
        if encoder is not None:
            refuse_unknown(f"{self.label()}: encoder", encoder, self.sides)
        self.encoder = encoder or self.side

    def options(self) -> dict[str, Any]:
        """Return where the log's encoder sits, if not on the servo's side."""
        return {} if self.encoder == self.side else {"encoder": self.encoder}

    @property
    def variant(self) -> str:
        """Where the servo's encoder sits, and the log's if that is elsewhere."""
        apart = "" if self.encoder == self.side else f", logged on the {self.encoder} side"
        return f"{self.side} side{apart}"

    @classmethod
    def variants(cls, scale: RobotScale) -> list[dict[str, Any]]:
        """Return one encoder on either side, and a servo's and a log's on two sides.

        Without any servo it is the log's encoder alone that matters.
        """
        one = super().variants(scale)
        if not any(is_joint_servo(scale.model, i) for i in range(scale.model.nactuator)):
            return one
        other = {"motor": "link", "link": "motor"}
        return [*one, *({**more, "encoder": other[more["side"]]} for more in one)]

    def joint_name(self, motor: str) -> str:
        """Return the name of the joint that the effect adds after a motor's."""
        return f"{motor}{SERIES}{self.name}"

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the joint to each place.

        Raises:
            EffectError: no such joint, one that is not a hinge or slide, or one that is not its
                body's last.
        """
        for joint in _motors(spec, self.where):
            own = [j for j in joint.parent.joints if SERIES not in j.name]
            if own[-1].name != joint.name:
                raise EffectError(
                    f"{self.label()}: joint {joint.name!r} is not the last joint of body"
                    f" {joint.parent.name!r}; move the joint to a separate body"
                )
            self._add(spec, joint)

    def _add(self, spec: mujoco.MjSpec, motor: Any) -> None:
        added = motor.parent.add_joint(
            name=self.joint_name(motor.name), type=motor.type, axis=motor.axis, pos=motor.pos
        )
        added.damping, added.stiffness, added.frictionloss = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.0
        added.armature = 1.0  # until a value is written: compiling needs one
        added.ref, added.springref, added.margin = 0.0, 0.0, 0.0
        added.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        added.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        self.shape(added, spec.option.timestep)

    def shape(self, joint: Any, timestep: float) -> None:
        """Set the limits or the spring of the added joint, an MjsJoint."""

    def bind(self, plant: PlantView) -> BoundEffect:
        """Make the added joints part of the plant's layout, and of what the encoder sees."""
        parts = [self.bound(plant, self, int(motor)) for motor in joints(plant.model, self.where)]
        for part in parts:
            place = f"{self.label()} at {part.joint}"
            if part.motor_side:
                plant.shared_mechanism(f"log of {place}", lambda part=part: MotorSide(part))
            if self.side == "motor":
                continue
            servos = [
                i
                for i in range(plant.model.nactuator)
                if is_joint_servo(plant.model, i) and plant.model.actuator_trnid[i, 0] == part.motor
            ]
            if servos:
                plant.shared_mechanism(
                    f"servo of {place}", lambda part=part, s=servos: LinkSide(part, s)
                )
        return SeriesGroup(parts)

    def batch(self) -> str:
        """Return a separate group: no other effect has its joint."""
        return f"{self.label()} {self.variant}"

    def mjcf_limitation(self) -> str | None:
        """Return why a loop that is closed behind the joint cannot be said."""
        if self.side == "link":
            return "a position actuator cannot close its loop on the far side of a play or spring"
        return self.no_mjcf


class SeriesGroup(BoundEffect):
    """Several series joints with one value."""

    def __init__(self, parts: list[Any]) -> None:
        self._parts = parts

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Write values (n, k) to each."""
        for part in self._parts:
            part.write(ids, values)


def _motors(spec: mujoco.MjSpec, where: str | None) -> list[Any]:
    """Return the joints of a spec at which an effect acts."""
    scalar = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    named = {j.name: j for j in spec.joints if j.type in scalar and SERIES not in j.name}
    if where is not None:
        if where not in named:
            known = ", ".join(n for n in named if n)
            hint = did_you_mean(where, named)
            raise EffectError(f"the model has no hinge or slide {where!r}{hint}; it has: {known}")
        return [named[where]]
    driven = {a.target for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_JOINT}
    return [joint for name, joint in named.items() if name in driven]


def least_rotor(plant: PlantView, motor: int) -> float:
    """Return the least inertia of a motor that is free of its link [kg·m²].

    Stable under its servo at the model's time step, and small next to the link's.
    """
    model, dt = plant.model, plant.model.opt.timestep
    servos = [
        i
        for i in range(model.nactuator)
        if is_joint_servo(model, i) and model.actuator_trnid[i, 0] == motor
    ]
    stiffness = sum(-model.actuator_biasprm[i, 1] * model.actuator_gear[i, 0] ** 2 for i in servos)
    return max(float(stiffness) * dt * dt, 1e-3 * link_inertia(model, motor))


class Spring(Series):
    """See `JointCompliance`."""

    def __init__(self, plant: PlantView, effect: SeriesEffect, motor: int) -> None:
        super().__init__(plant, effect, motor)
        model = plant.model
        self.stiffness, self.damping = plant.field("jnt_stiffness"), plant.field("dof_damping")
        rotor = max(float(model.dof_armature[self.rotor]), self.least)
        link = max(link_inertia(model, motor), 1e-12)
        names = [model.joint(j).name for j in range(model.njnt)]
        if sum(name.startswith(model.joint(motor).name + SERIES) for name in names) > 1:
            link *= BETWEEN
        reduced = 1.0 / (1.0 / rotor + 1.0 / link)
        self.smallest = model.opt.timestep**2 / (STABLE * reduced)  # rad/(N·m)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Free the spring where the value is not 0, and give it its stiffness and damping."""
        super().write(ids, values)
        value = np.maximum(values[:, 0], self.smallest)
        self.value[ids] = np.where(values[:, 0] > 0, value, 0.0)
        self.stiffness[ids, self.joint] = np.where(values[:, 0] > 0, 1.0 / value, 0.0)
        self.damping[ids, self.v] = np.where(
            values[:, 0] > 0, self.effect.scalar("damping", values), 0.0
        )

    def settle(self, ids: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return how far the load bends the spring."""
        return -load * self.value[ids]


class JointCompliance(SeriesEffect):
    """A spring between motor and link: deflection = torque * value.

    `side` is the location of the servo's encoder. `encoder` is the location of the logged encoder,
    if they differ. Springs too stiff for the time step act as the stiffest possible spring.
    """

    name = "joint_compliance"
    engines = BOTH
    unit = "rad/(N·m)"
    extras = (
        Extra(
            "damping",
            "N·m·s/rad",
            0.0,
            0.0,
            1e3,
            "the spring's damping",
            fit=(0.0, 1e3),
            typical=(0.0, 0.5),
        ),
    )
    shared = True
    typical = (0.0, 0.5)
    bound = Spring
    comparable = True
    sizes = Sizes("add", "softness", 0.01, 3.0)
    symptom = (
        "a sag in proportion to the load, which the encoder may not measure, and ringing at"
        " sqrt(k/J) after stops"
    )
    source = "tau = k (motor - link); a sprung hinge in series"
    experiment = "hammer taps or fast stops; the frequency of a resonance falls with the load"

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return springs that a torque bends little and much, with a third of critical damping.

        With much less, a loop that is closed behind the spring swings by itself.
        """
        soft = np.array([0.005, 0.02, 0.08, 0.3, 0.8]) / scale.torque_at(self.where)
        return np.column_stack([soft, 0.6 * np.sqrt(scale.inertia(self.where) / soft)])

    @classmethod
    def draw_extras(cls, units: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw 5 to 30 % of critical damping, were the spring as soft as the servo."""
        ratio = rng.uniform(0.05, 0.3)
        return {"damping": float(2 * ratio * math.sqrt(units["inertia"] / units["softness"]))}
