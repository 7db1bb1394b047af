"""Effects on what resists a joint: friction, damping, cogging, the rotor's inertia.

Friction that depends on something is written into the engine's own friction loss before each
substep, so that a joint sticks exactly instead of chattering about zero speed.
"""

from __future__ import annotations

from typing import ClassVar

import mujoco
import numpy as np

from envs.effects.base import (
    Bound,
    Effect,
    Extra,
    FieldBound,
    FieldEffect,
    SubstepRule,
    joint_driven,
    joints,
)
from envs.effects.plant_view import PlantView
from envs.params import How, Parameter

# The engine's default friction creeps: 1.4 degrees in 10 s under three quarters of its torque.
STIFF_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
STICKS = 0.999  # impedance from which a model's own friction is left as it is


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
    looks_like = (
        "the joint stops short of its goal, from both sides, and flattens at every reversal"
    )
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


class ViscousFriction(FieldEffect):
    """A torque against the motion in proportion to its speed."""

    name = "viscous_friction"
    place = "joint"
    unit = "N·m·s/rad"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_damping"
    typical = (0.0, 0.1)
    looks_like = "lag in proportion to speed, and swings that die out exponentially"
    source = "tau = -K w; MuJoCo XML reference, joint/damping"
    experiment = "a swing with the motor switched off, which has no back-EMF"


class Armature(FieldEffect):
    """The rotor's inertia, seen through the gear."""

    name = "armature"
    place = "joint"
    unit = "kg·m²"
    hows: ClassVar[tuple[How, ...]] = ("add", "scale", "set")
    field = "dof_armature"
    constants = True
    typical = (0.0, 0.03)
    looks_like = "slow starts and overshoot that do not depend on the pose"
    source = "rotor inertia times the gear ratio squared; MuJoCo XML reference, joint/armature"
    experiment = "steps from rest with two amplitudes, and a chirp"


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
            "speed", "rad/s", 0.5, 1e-3, np.inf, "the speed at which the excess has fallen to 37 %"
        ),
        Extra("shape", "", 2.0, 0.1, 10.0, "the exponent of its decay: 1 exponential, 2 Gaussian"),
    )
    typical = (0.0, 0.15)
    looks_like = "stick-slip: slow motions go in jumps, fast ones are smooth"
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
    extras = (Extra("external", "", 1.0, 0.0, 1.0, "the part of the external torque that rubs"),)
    typical = (0.0, 0.35)
    looks_like = (
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


class _Cogging(SubstepRule):
    """See `Cogging`."""

    order = 60

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self.effect, self.qpos, self.applied = effect, plant.layout.raw_qpos, plant.applied
        found = joints(plant.model, effect.where)
        self.q, self.v = plant.model.jnt_qposadr[found], plant.model.jnt_dofadr[found]
        self.value, self.count, self.phase = (np.zeros((plant.num_rows, 1)) for _ in range(3))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[ids] = values[:, :1]
        self.count[ids, 0] = self.effect.scalar("count", values)
        self.phase[ids, 0] = self.effect.scalar("phase", values)

    def before_substep(self, ids: np.ndarray | slice) -> None:
        torque = self.value[ids] * np.sin(
            self.count[ids] * self.qpos[ids][:, self.q] + self.phase[ids]
        )
        if isinstance(ids, slice):
            self.applied[:, self.v] += torque
        else:
            self.applied[ids[:, None], self.v] += torque


class Cogging(Effect):
    """A torque ripple with the motor's angle: value sin(count q + phase)."""

    name = "cogging"
    place = "joint"
    unit = "N·m"
    extras = (
        Extra("count", "1/turn", 12.0, 0.0, 1e4, "ripples in a turn of the joint"),
        Extra("phase", "rad", 0.0, -2 * np.pi, 2 * np.pi, "of the ripple at q = 0"),
    )
    typical = (0.0, 0.05)
    looks_like = "an error that repeats with the position, whatever the speed and direction"
    source = "tau = A sin(N q + phase); MuJoCo XML reference, dcmotor/cogging"
    experiment = "a slow ramp over the whole range, there and back"

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the amplitude, and the free extras."""
        joints(model, self.where)
        return (self.parameter(low=0.0), *self.free_parameters())

    def bind(self, plant: PlantView) -> SubstepRule:
        """Apply the torque before each substep."""
        return _Cogging(plant, self)
