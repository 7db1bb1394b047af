"""Effects on what resists a joint: friction, damping, the rotor's inertia.

Friction that depends on something is written into the engine's own friction loss before each
substep, so that a joint sticks exactly instead of chattering about zero speed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import ClassVar

import mujoco
import numpy as np

from envs.effects.base import RULES, Bound, Effect, Extra, Sizes, SubstepRule
from envs.effects.field import FieldBound, FieldEffect
from envs.effects.places import joint_driven, joints
from envs.effects.plant_view import PlantView
from envs.effects.scale import FASTEST, RobotScale
from envs.params import How, Parameter

# The engine's default friction creeps: 1.4 degrees in 10 s under three quarters of its torque.
STIFF_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
STICKS = 0.999  # impedance from which a model's own friction is left as it is


PARTS = np.array([0.01, 0.035, 0.12, 0.35])  # of a motor's torque: dry friction that is probed
MOST = 0.9  # of the model's own friction that a probe takes away


def with_less(sizes: np.ndarray, own: float) -> np.ndarray:
    """Return what may be added to a joint's own friction, and most of that taken away."""
    return np.append(sizes, -MOST * own) if own > 0 else sizes


def stiffen(spec: mujoco.MjSpec, where: str | None) -> None:
    """Make friction stick without creep in joints whose model has none; see `Grip` for others."""
    driven = {actuator.target for actuator in spec.actuators}
    for joint in spec.joints:
        if joint.frictionloss == 0 and (
            joint.name == where or (where is None and joint.name in driven)
        ):
            joint.solimp_friction = STIFF_SOLIMP
            joint.solref_friction = [2 * spec.option.timestep, 1.0]


class Grip:
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
        """Let friction stick in the rows ids (n,)."""
        if len(self._dofs) and len(ids):
            self._solimp[ids[:, None], self._dofs] = STIFF_SOLIMP
            self._solref[ids[:, None], self._dofs] = self._reference


class _Coulomb(Bound):
    """See `CoulombFriction`."""

    def __init__(self, plant: PlantView, effect: CoulombFriction) -> None:
        (parameter,) = effect.parameters(plant.model)
        elements = effect.elements(plant.model)
        self._loss = FieldBound(plant.field(effect.field), elements, parameter)
        self._grip, self._neutral = Grip(plant, effect.where), parameter.neutral

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self._loss.write(ids, values)
        self._grip.hold(ids[values[:, 0] != self._neutral])


class CoulombFriction(FieldEffect):
    """Dry friction: a torque against the motion, whatever its speed; the joint sticks below it.

    Where the model has friction of its own that creeps, as the engine's default does, any change of
    it makes all of it stick.
    """

    name = "coulomb_friction"
    place = "joint"
    unit = "N·m"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_frictionloss"
    typical = (0.0, 0.2)
    words = "Coulomb friction"
    servo_rank = 2
    comparable = True
    sizes = Sizes("add", "stall", 2e-3, 0.3)
    symptom = "the joint stops short of its goal, from both sides, and flattens at every reversal"
    source = (
        "tau = -K sgn(w), sticking below K; MuJoCo XML reference, joint/frictionloss, made stiff"
    )
    experiment = "a slow ramp with reversals, and holds reached from both sides"

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Make the joint stick where it had no friction."""
        stiffen(spec, self.where)

    def bind(self, plant: PlantView) -> Bound:
        """Write the friction loss, and let it stick where it is not the model's own."""
        return _Coulomb(plant, self)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the motor's torque, and less of the model's own friction."""
        sizes = PARTS * scale.torque_at(self.where)
        return with_less(sizes, scale.own("dof_frictionloss", self.where))


class ViscousFriction(FieldEffect):
    """A torque against the motion in proportion to its speed."""

    name = "viscous_friction"
    place = "joint"
    unit = "N·m·s/rad"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_damping"
    typical = (0.0, 0.1)
    servo_rank = 3
    comparable = True
    sizes = Sizes("add", "braking", 0.02, 10.0)
    symptom = "lag in proportion to speed, and swings that die out exponentially"
    source = "tau = -K w; MuJoCo XML reference, joint/damping"
    experiment = "a swing with the motor switched off, which has no back-EMF"

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return what takes parts of the motor's torque at speed, and less of the model's own."""
        sizes = np.array([0.02, 0.1, 0.4, 1.2]) * scale.torque_at(self.where) / FASTEST
        return with_less(sizes, scale.own("dof_damping", self.where))


class Armature(FieldEffect):
    """The rotor's inertia, seen through the gear."""

    name = "armature"
    place = "joint"
    unit = "kg·m²"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_armature"
    constants = True
    typical = (0.0, 0.03)
    comparable = True
    sizes = Sizes("add", "inertia", 0.03, 10.0)
    symptom = "slow starts and overshoot that do not depend on the pose"
    source = "rotor inertia times the gear ratio squared; MuJoCo XML reference, joint/armature"
    experiment = "steps from rest with two amplitudes, and a chirp"

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the inertia at the joint, and less of the model's own armature."""
        own = scale.own("dof_armature", self.where)
        whole = scale.inertia(self.where) + own
        return np.append(np.array([0.1, 0.4, 1.5]) * whole, -0.4 * own)


class _FrictionRule(SubstepRule):
    """Adds a friction torque of each of k joints to the engine's friction loss."""

    order = 50

    def __init__(self, plant: PlantView, where: str | None, effect: Effect) -> None:
        self.effect = effect
        self.joints = joints(plant.model, where)
        self.dofs = plant.model.jnt_dofadr[self.joints]  # (k,)
        self.loss = plant.live("dof_frictionloss")  # (N, nv)
        self.value = np.zeros((plant.num_rows, 1))
        self.qvel = plant.layout.raw_qvel
        self.grip = Grip(plant, where)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Keep the coefficient of each row."""
        self.value[ids] = values[:, :1]
        self.grip.hold(ids[values[:, 0] != 0])

    def add(self, ids: np.ndarray | slice, torque: np.ndarray) -> None:
        """Add friction torques (n, k) [N·m] for the coming substep."""
        if isinstance(ids, slice):
            self.loss[:, self.dofs] += torque
        else:
            self.loss[ids[:, None], self.dofs] += torque


class _Stribeck(_FrictionRule):
    """See `StribeckFriction`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect.where, effect)
        self.speed, self.shape = np.ones((plant.num_rows, 1)), np.ones((plant.num_rows, 1))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.speed[ids, 0] = self.effect.scalar("speed", values)
        self.shape[ids, 0] = self.effect.scalar("shape", values)

    def before_substep(self, ids: np.ndarray | slice) -> None:
        slowness = np.abs(self.qvel[ids][:, self.dofs]) / self.speed[ids]
        self.add(ids, self.value[ids] * np.exp(-(slowness ** self.shape[ids])))


class StribeckFriction(Effect):
    """More dry friction near standstill than in motion, by value exp(-|w / speed|^shape)."""

    name = "stribeck_friction"
    place = "joint"
    unit = "N·m"
    extras = (
        Extra(
            "speed",
            "rad/s",
            0.5,
            1e-3,
            np.inf,
            "the speed at which the excess has fallen to 37 %",
            fit=(0.05, 3.0),  # what has not fallen at a few rad/s is Coulomb friction
            typical=(0.1, 2.0),
        ),
        Extra("shape", "", 2.0, 0.1, 10.0, "the exponent of its decay: 1 exponential, 2 Gaussian"),
    )
    typical = (0.0, 0.15)
    words = "Stribeck friction"
    no_mjcf = "MJCF has no friction that depends on the speed"
    sizes = Sizes("add", "stall", 2e-3, 0.3)
    symptom = "stick-slip: slow motions go in jumps, fast ones are smooth"
    source = "Armstrong-Hélouvry 1991; Kcs exp(-|w/ws|^a), as in Rhoban's BAM (arXiv 2410.08650) M2"
    experiment = "ramps at several slow speeds, one after the other, with reversals"

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Make the joint stick where it had no friction."""
        stiffen(spec, self.where)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the static excess, and the free extras."""
        joints(model, self.where)
        return (self.parameter(low=0.0), *self.free_parameters())

    def bind(self, plant: PlantView) -> SubstepRule:
        """Write the friction loss before each substep."""
        return _Stribeck(plant, self)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the motor's torque, each with two speeds."""
        sizes = PARTS * scale.torque_at(self.where)
        return np.array(list(itertools.product(sizes, (0.25, 0.8))))

    def batch(self) -> str:
        """Return the group of rules that are stepped from Python."""
        return RULES

    @classmethod
    def draw_extras(cls, units: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw a speed."""
        return {"speed": float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))}


class _LoadDependent(_FrictionRule):
    """See `LoadDependentFriction`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect.where, effect)
        self.motor, self.bias = plant.batch.bind("qfrc_actuator"), plant.batch.bind("qfrc_bias")
        self.external = np.ones((plant.num_rows, 1))
        model = plant.model
        self.driven = np.array([i for i in range(model.nactuator) if joint_driven(model, i)], int)
        dofs = model.jnt_dofadr[model.actuator_trnid[self.driven, 0]]
        turns = model.actuator_gear[self.driven, :1] ** 2
        self.turns = (dofs[:, None] == self.dofs) * turns  # (actuators, k)
        self.damping = plant.field("actuator_damping")
        self.running = np.zeros(
            (plant.num_rows, 1), dtype=bool
        )  # whether a substep has computed the motor's torque

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.external[ids, 0] = self.effect.scalar("external", values)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.running[ids] = False

    def before_substep(self, ids: np.ndarray | slice) -> None:
        bias = self.bias[ids][:, self.dofs]  # (n, k)
        drag = self.damping[ids][:, self.driven] @ self.turns * self.qvel[ids][:, self.dofs]
        motor = np.where(self.running[ids], self.motor[ids][:, self.dofs] - drag, bias)
        self.add(ids, self.value[ids] * np.abs(motor + self.external[ids] * bias))
        self.running[ids] = True


class LoadDependentFriction(Effect):
    """Friction in proportion to what the gear carries: value |tau_motor - external tau_external|.

    The external torque is that of gravity and inertia, minus the engine's bias force; contacts are
    left out of it. At a hold the motor's and the external torque are opposite, so that the friction
    is value times twice the gravity torque where `external` is 1. Gears differ in how much a load
    that drives them back rubs: with 0 only the motor's own torque does. Of that, what the
    actuator's damping takes, the back-EMF, never gets to the gear. The torques are those of the
    substep before.
    """

    name = "load_dependent_friction"
    place = "joint"
    unit = ""
    extras = (
        Extra(
            "external",
            "",
            1.0,
            0.0,
            1.0,
            "the part of the external torque that rubs",
            fit=(0.0, 1.0),
        ),
    )
    typical = (0.0, 0.35)
    no_mjcf = "MJCF has no friction that depends on the load"
    sizes = Sizes("add", "one", 5e-3, 0.6)
    symptom = (
        "friction that grows with the load: wide hysteresis where gravity pulls, little"
        " where it does not"
    )
    source = (
        "Rhoban's BAM (arXiv 2410.08650) M3: Kl |tau_m - tau_e| added to the Coulomb friction;"
        " M5: a coefficient for each of the two torques"
    )
    experiment = (
        "slow reversals with two payloads, or through poses with and without gravity torque"
    )

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Make the joint stick where it had no friction."""
        stiffen(spec, self.where)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the coefficient, and the free extras."""
        joints(model, self.where)
        return (self.parameter(low=0.0, high=1.0), *self.free_parameters())

    def bind(self, plant: PlantView) -> SubstepRule:
        """Write the friction loss before each substep."""
        return _LoadDependent(plant, self)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return coefficients, with and without the external torque."""
        return np.array(list(itertools.product((0.03, 0.12, 0.4), (0.0, 1.0))))

    def batch(self) -> str:
        """Return the group of rules that are stepped from Python."""
        return RULES


class _OneWay(_FrictionRule):
    """See `AsymmetricFriction`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect.where, effect)
        self.applied = plant.applied

    def before_substep(self, ids: np.ndarray | slice) -> None:
        half = self.value[ids] / 2
        self.add(ids, np.broadcast_to(np.abs(half), (len(half), len(self.dofs))))
        rows = np.arange(len(self.value))[ids][:, None]
        self.applied[rows, self.dofs] -= half


class AsymmetricFriction(Effect):
    """Dry friction in one direction of motion only: against positive speeds where it is positive.

    Friction K + value one way and K the other is friction K + value / 2 both ways and a constant
    torque -value / 2, at rest as in motion; so it is applied, and so a preloaded spring or a cable
    that pulls looks the same.
    """

    name = "asymmetric_friction"
    place = "joint"
    unit = "N·m"
    typical = (-0.1, 0.1)
    words = "asymmetric Coulomb friction"
    no_mjcf = "MJCF has no friction that depends on the direction"
    symptom = "one direction of motion lags or stops short more than the other, in every pose"
    source = "tau = -(K + v) for w > 0, K for w < 0; Armstrong-Hélouvry 1991; Kelly et al. 2000"
    experiment = "the same slow ramp there and back in poses without gravity torque"

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Make the joint stick where it had no friction."""
        stiffen(spec, self.where)

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the difference between the directions."""
        joints(model, self.where)
        return (self.parameter(),)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the motor's torque, for either direction."""
        sizes = PARTS[1:] * scale.torque_at(self.where)
        return np.concatenate([sizes, -sizes])

    def batch(self) -> str:
        """Return the group of rules that are stepped from Python."""
        return RULES

    def bind(self, plant: PlantView) -> SubstepRule:
        """Apply both parts before each substep."""
        return _OneWay(plant, self)
