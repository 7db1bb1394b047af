"""Effects on what resists a joint: friction, damping, the rotor's inertia.

What depends on speed, load or direction is in `friction_rules.py`.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import ClassVar

import mujoco
import numpy as np

from envs.effects.base import PLAIN, RULES, Sizes
from envs.effects.bound import BoundEffect
from envs.effects.bristles import EXTRAS as BRISTLES
from envs.effects.bristles import Bristles, has_bristles
from envs.effects.field import FieldBound, FieldEffect
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.effects.scale import FASTEST, RobotScale
from envs.params import How

# The engine's default friction creeps: 1.4 degrees in 10 s under three quarters of its torque.
STIFF_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
STICKS = 0.999  # impedance from which a model's own friction is left as it is


PARTS = np.array([0.01, 0.035, 0.12, 0.35])  # of a motor's torque: dry friction that is probed
TAKEN_AWAY = 0.9  # of the model's own friction that a probe takes away


def with_less(sizes: np.ndarray, own: float) -> np.ndarray:
    """Append to `sizes` the removal of most of the model's own friction, if it has any."""
    return np.append(sizes, -TAKEN_AWAY * own) if own > 0 else sizes


def stiffen(spec: mujoco.MjSpec, where: str | None) -> None:
    """Make friction stick without creep in joints whose model has none.

    See `NoCreepFriction` for others.
    """
    driven = {actuator.target for actuator in spec.actuators}
    for joint in spec.joints:
        if joint.frictionloss == 0 and (
            fnmatchcase(joint.name, where) if where is not None else joint.name in driven
        ):
            joint.solimp_friction = STIFF_SOLIMP
            joint.solref_friction = [2 * spec.option.timestep, 1.0]


class NoCreepFriction:
    """Makes a model's own creeping friction stick, in the rows to which an effect adds some.

    Rows without keep what the model says, bit for bit. A joint whose model sticks keeps it, too.

    Args:
        plant: the simulations.
        where: the joint; None for all driven ones.
    """

    def __init__(self, plant: PlantView, where: str | None) -> None:
        model = plant.model
        dofs = model.jnt_dofadr[joints(model, where)]  # (k,)
        creeps = (model.dof_frictionloss[dofs] > 0) & (model.dof_solimp[dofs, 0] < STICKS)
        self._dofs = dofs[creeps]
        if len(self._dofs):
            self._solimp, self._solref = plant.field("dof_solimp"), plant.field("dof_solref")
            self._reference = (2 * model.opt.timestep, 1.0)

    def hold(self, ids: np.ndarray) -> None:
        """Make dry friction stick instead of creep, in the rows `ids` (n,)."""
        if len(self._dofs) and len(ids):
            self._solimp[ids[:, None], self._dofs] = STIFF_SOLIMP
            self._solref[ids[:, None], self._dofs] = self._reference


class _Coulomb(BoundEffect):
    """See `CoulombFriction`."""

    def __init__(self, plant: PlantView, effect: CoulombFriction) -> None:
        parameter, *_ = effect.parameters(plant.model)
        elements = effect.elements(plant.model)
        self._loss = FieldBound(plant.field(effect.field), elements, parameter)
        self._grip, self._neutral = NoCreepFriction(plant, effect.where), parameter.neutral
        self._effect, self._bristles = effect, None
        if has_bristles(effect):
            dofs = plant.model.jnt_dofadr[joints(plant.model, effect.where)]
            self._bristles = Bristles.of(plant, effect, dofs)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self._loss.write(ids, values)
        self._grip.hold(ids[values[:, 0] != self._neutral])
        if self._bristles is not None:
            self._bristles.take(self._effect, ids, values)


class CoulombFriction(FieldEffect):
    """Dry friction: a torque that opposes motion at any speed; at rest, the joint sticks below it.

    With MuJoCo's default constraints, a loaded joint creeps against its dry friction; with this
    effect, it sticks. With `bristle` it yields elastically before it breaks away (LuGre model); all
    dry friction of the joint then acts through the bristles.
    """

    name = "coulomb_friction"
    place = "joint"
    unit = "N·m"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_frictionloss"
    extras = BRISTLES
    typical = (0.0, 0.2)
    display_name = "Coulomb friction"
    comparable = True
    sizes = Sizes("add", "stall", 2e-3, 0.3)
    shared = True
    symptom = "the joint stops short of its goal from both sides, and sticks at every reversal"
    source = (
        "tau = -K sgn(w), sticking below K; MuJoCo XML reference, joint/frictionloss, made stiff;"
        " bristles: Canudas de Wit, Olsson, Åström, Lischinsky 1995"
    )
    experiment = "a slow ramp with reversals, and holds reached from both sides"

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Make the joint stick where it had no friction."""
        stiffen(spec, self.where)

    def batch(self) -> str:
        """Return the group of effects of model fields; bristles act between physics steps."""
        return RULES if has_bristles(self) else PLAIN

    def mjcf_limitation(self) -> str | None:
        """Return that MJCF has no bristles, where they bend."""
        return "MJCF has no friction that yields before it slips" if has_bristles(self) else None

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the friction loss, and let it stick where it is not the model's own."""
        return _Coulomb(plant, self)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the motor's torque, and less of the model's own friction."""
        sizes = PARTS * scale.torque_at(self.where)
        return with_less(sizes, scale.own("dof_frictionloss", self.where))


class ViscousFriction(FieldEffect):
    """A torque that opposes motion, in proportion to speed."""

    name = "viscous_friction"
    place = "joint"
    unit = "N·m·s/rad"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_damping"
    typical = (0.0, 0.1)
    comparable = True
    sizes = Sizes("add", "braking", 0.02, 10.0)
    shared = True
    symptom = "lag in proportion to speed, and swings that die out exponentially"
    source = "tau = -K w; MuJoCo XML reference, joint/damping"
    experiment = "a swing with the motor off, without back-EMF"

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return sizes that cost fractions of the torque at speed, and less than the model has."""
        sizes = np.array([0.02, 0.1, 0.4, 1.2]) * scale.torque_at(self.where) / FASTEST
        return with_less(sizes, scale.own("dof_damping", self.where))


class Armature(FieldEffect):
    """Inertia of the rotor at the joint, that is, multiplied by the squared gear ratio."""

    name = "armature"
    place = "joint"
    unit = "kg·m²"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_armature"
    constants = True
    typical = (0.0, 0.03)
    comparable = True
    sizes = Sizes("add", "inertia", 0.03, 10.0)
    shared = True
    symptom = "slow starts and overshoot that do not depend on the pose"
    source = "rotor inertia times the gear ratio squared; MuJoCo XML reference, joint/armature"
    experiment = "steps from rest with two amplitudes, and a chirp"

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return shares and multiples of the inertia at the joint, and less of its armature.

        A gear multiplies a rotor's inertia by its squared ratio, often beyond that of the link.
        """
        own = scale.own("dof_armature", self.where)
        whole = scale.inertia(self.where) + own
        return np.append(np.array([0.1, 0.4, 1.5, 6.0]) * whole, -0.4 * own)
