"""Friction that depends on something: speed, load, direction.

It is written into the engine's own friction loss before each substep, so that a joint sticks
exactly instead of chattering about zero speed.
"""

import itertools
from collections.abc import Mapping

import mujoco
import numpy as np

from envs.effects.base import BOTH, RULES, Effect, Extra, Sizes
from envs.effects.bound import SubstepRule
from envs.effects.bristles import EXTRAS as BRISTLES
from envs.effects.bristles import Bristles
from envs.effects.friction import PARTS, NoCreepFriction, stiffen
from envs.effects.places import block, joint_driven, joints
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.physics.arrays import Array

BENT = np.array([0.012, 0.02, 0.034, 0.058, 0.1, 0.17])  # of a motor's torque: steep friction


class _FrictionRule(SubstepRule):
    """Adds a friction torque of each of k joints to the engine's friction loss."""

    order = 50

    def __init__(self, plant: PlantView, where: str | None, effect: Effect) -> None:
        self.plant, self.effect, self.arrays, self.xp = plant, effect, plant.arrays, plant.arrays.xp
        self.joints = joints(plant.model, where)
        self.dofs = plant.model.jnt_dofadr[self.joints]  # (k,)
        plant.live("dof_frictionloss")
        self.value = np.zeros((plant.num_rows, 1))
        self.qvel = plant.layout.raw_qvel
        self.grip = NoCreepFriction(plant, where)
        self.bristles = Bristles.of(plant, effect, self.dofs)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Keep the coefficient of each row."""
        self.value[ids] = values[:, :1]
        self.bristles.take(self.effect, ids, values)
        self.grip.hold(ids[values[:, 0] != 0])

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep where the joints are in the rows ids of a field, and the rows' coefficients."""
        self.loss = self.plant.now("dof_frictionloss")  # (N, nv)
        self.at = self.arrays.index(block(ids, self.dofs))
        self.own = self.arrays.own(self.value[ids])

    def add(self, torque: Array) -> None:
        """Add friction torques (n, k) [N·m] for the coming substep."""
        self.loss[self.at] += torque


class _RuledFriction(Effect):
    """Friction of a joint by a rule."""

    place = "joint"
    engines = BOTH
    group = RULES

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Make the joint stick where it had no friction."""
        stiffen(spec, self.where)


class _Stribeck(_FrictionRule):
    """See `StribeckFriction`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect.where, effect)
        self.speed, self.shape = np.ones((plant.num_rows, 1)), np.ones((plant.num_rows, 1))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.speed[ids, 0] = self.effect.scalar("speed", values)
        self.shape[ids, 0] = self.effect.scalar("shape", values)

    def prepare(self, ids: np.ndarray | slice) -> None:
        super().prepare(ids)
        self.fall, self.power = (self.arrays.own(x[ids]) for x in (self.speed, self.shape))
        self.bends = bool((self.bristles.bend[ids] > 0).any())

    def before_substep(self, ids: np.ndarray | slice) -> None:
        slowness = self.xp.abs(self.qvel[self.at]) / self.fall
        excess = self.own * self.xp.exp(-(slowness**self.power))
        self.add(excess)
        if self.bends:
            self.bristles.faded[ids] = self.own - excess


class StribeckFriction(_RuledFriction):
    """Additional dry friction near standstill: value exp(-|w / speed|^shape).

    With `bristle` the joint yields elastically before it breaks away (LuGre model); all dry
    friction of the joint then acts through the bristles.
    """

    name = "stribeck_friction"
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
        BRISTLES[0]._replace(
            typical=(0.0, 0.01), later=False
        ),  # it sticks and slips from the start
        *BRISTLES[1:],
    )
    typical = (0.0, 0.15)
    display_name = "Stribeck friction"
    no_mjcf = "MJCF has no friction that depends on the speed"
    sizes = Sizes("add", "stall", 2e-3, 0.3)
    shared = True
    symptom = "slow motions are jerky (stick-slip), but fast motions are smooth"
    source = (
        "Armstrong-Hélouvry 1991; Kcs exp(-|w/ws|^a), as in Rhoban's BAM (arXiv 2410.08650) M2;"
        " bristles: Canudas de Wit, Olsson, Åström, Lischinsky 1995, in linearly implicit steps"
    )
    experiment = "ramps at several slow speeds, one after the other, with reversals"
    limits = (0.0, np.inf)
    law = _Stribeck

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the motor's torque, each with two speeds, and closer ones on bristles.

        What falls fast sticks and slips: a fit finds it only from nearby.
        """
        torque = scale.torque_at(self.where)
        rigid = [(part, speed, 0.0) for part in PARTS for speed in (0.25, 0.8)]
        bent = [(part, 0.13, 0.004) for part in BENT]
        return np.array([*rigid, *bent]) * [torque, 1.0, 1.0]

    @classmethod
    def draw_extras(cls, units: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw a speed."""
        return {"speed": float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))}


class _LoadDependent(_FrictionRule):
    """See `LoadDependentFriction`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect.where, effect)
        self.motor, self.bias = plant.physics.bind("qfrc_actuator"), plant.physics.bind("qfrc_bias")
        self.external = np.ones((plant.num_rows, 1))
        model = plant.model
        self.driven = np.array([i for i in range(model.nactuator) if joint_driven(model, i)], int)
        dofs = model.jnt_dofadr[model.actuator_trnid[self.driven, 0]]
        turns = model.actuator_gear[self.driven, :1] ** 2
        self.turns = self.arrays.own((dofs[:, None] == self.dofs) * turns)  # (actuators, k)
        plant.live("actuator_damping")
        # whether a substep has computed the motor's torque
        self.running = self.arrays.zeros((plant.num_rows, 1), bool)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.external[ids, 0] = self.effect.scalar("external", values)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.running[self.arrays.rows(ids)] = False

    def prepare(self, ids: np.ndarray | slice) -> None:
        super().prepare(ids)
        self.damping = self.plant.now("actuator_damping")
        self.motors = self.arrays.index(block(ids, self.driven))
        self.part = self.arrays.own(self.external[ids])

    def before_substep(self, ids: np.ndarray | slice) -> None:
        bias, running = self.bias[self.at], self.running[ids]  # (n, k), (n, 1)
        motor = self.motor[self.at] - self.damping[self.motors] @ self.turns * self.qvel[self.at]
        if not running.all():
            motor = self.xp.where(running, motor, bias)
            self.running[ids] = True
        self.add(self.own * self.xp.abs(motor + self.part * bias))


class LoadDependentFriction(_RuledFriction):
    """Friction in proportion to the load of the gear: value |tau_motor - external tau_external|.

    The external torque is gravity and inertia, without contacts; `external` 0 counts the motor's
    torque only. Back-EMF does not load the gear. Torques are taken from the previous substep.
    """

    name = "load_dependent_friction"
    unit = ""
    extras = (
        Extra(
            "external",
            "",
            1.0,
            0.0,
            1.0,
            "fraction of the external torque that causes friction",
            fit=(0.0, 1.0),
        ),
        *BRISTLES,
    )
    typical = (0.0, 0.35)
    no_mjcf = "MJCF has no friction that depends on the load"
    sizes = Sizes("add", "one", 5e-3, 0.6)
    shared = True
    symptom = (
        "friction that grows with the load, with wide hysteresis where gravity pulls and little"
        " where it does not"
    )
    source = (
        "Rhoban's BAM (arXiv 2410.08650) M3: Kl |tau_m - tau_e| added to the Coulomb friction;"
        " M5: a coefficient for each of the two torques"
    )
    experiment = (
        "slow reversals with two payloads, or through poses with and without gravity torque"
    )
    limits = (0.0, 1.0)
    first_values = tuple(itertools.product((0.03, 0.12, 0.4), (0.0, 1.0)))
    law = _LoadDependent


class _OneWay(_FrictionRule):
    """See `AsymmetricFriction`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect.where, effect)
        self.applied, self.rise = plant.applied, np.full((plant.num_rows, 1), 0.5)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.rise[ids, 0] = self.effect.scalar("rise", values)

    def prepare(self, ids: np.ndarray | slice) -> None:
        super().prepare(ids)
        self.more = self.xp.abs(self.own) * self.arrays.own(self.rise[ids])

    def before_substep(self, ids: np.ndarray | slice) -> None:
        self.add(self.more)
        self.applied[self.at] -= self.own / 2


class AsymmetricFriction(_RuledFriction):
    """Additional dry friction in one direction: for positive speeds if the value is positive.

    It acts as a friction of value / 2 in both directions and a constant torque of -value / 2, so a
    preloaded spring looks the same. `rise` is the fraction of the value by which the mean friction
    rises.
    """

    name = "asymmetric_friction"
    unit = "N·m"
    extras = (
        Extra(
            "rise",
            "",
            0.5,
            0.0,
            0.5,
            "fraction of the value by which the mean of both directions rises",
            fit=(0.0, 0.5),
        ),
        *BRISTLES,
    )
    typical = (-0.1, 0.1)
    display_name = "asymmetric Coulomb friction"
    no_mjcf = "MJCF has no friction that depends on the direction"
    symptom = "one direction of motion lags or stops short more than the other, in every pose"
    source = "tau = -(K + v) for w > 0, K for w < 0; Armstrong-Hélouvry 1991; Kelly et al. 2000"
    experiment = "the same slow ramp there and back in poses without gravity torque"
    law = _OneWay

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the motor's torque, for either direction, with and without a rise."""
        sizes = PARTS[1:] * scale.torque_at(self.where)
        return np.array(list(itertools.product((*sizes, *-sizes), (0.5, 0.0))))
