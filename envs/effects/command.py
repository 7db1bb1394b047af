"""Effects between a command and the servo's goal: lost packets, delay, motion profile."""

import math
import zlib
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, RULES, Effect, Extra, Sizes
from envs.effects.bound import BoundEffect, CommandRule, SubstepRule
from envs.effects.field import FieldBound
from envs.effects.history import control_range
from envs.effects.places import block, spaced
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.effects.servo import ActuatorEffect, is_joint_servo
from envs.errors import EffectError
from envs.noise import uniform
from envs.params import Parameter
from envs.physics.arrays import Array

NO_LIMIT = 1e6  # rad/s or rad/s²: a profile without this limit (parameters are finite numbers)
LINEAR = 1  # the engine's number for linear interpolation of a delay line


def stream(label: str) -> int:
    """Return the first of an effect's own random streams, far from other effects' and from 0."""
    return (zlib.crc32(label.encode()) | 1) << 24


def delay_commands(spec: mujoco.MjSpec, by: float, longest: float = 0.0) -> None:
    """Give each actuator a delay line, and let its commands arrive later.

    Args:
        spec: the model.
        by: how much later [s].
        longest: what lines have to hold in addition [s].
    """
    for actuator in spec.actuators:
        actuator.delay += by
        samples = math.ceil((actuator.delay + longest) / spec.option.timestep) + 1
        actuator.nsample = max(actuator.nsample, samples)
        actuator.interp = max(actuator.interp, LINEAR)


class CommandDelay(Effect):
    """Time from sending a command to its arrival at the servos, added to the model's own delays.

    Values below one physics step act as one step. `longest` sets the length of the delay line.
    """

    name = "command_delay"
    engines = BOTH
    place = "robot"
    unit = "s"
    composes = True
    extras = (Extra("longest", "s", 0.1, 1e-4, 10.0, "the longest delay that can be set"),)
    typical = (0.0, 0.04)
    no_mjcf = None
    comparable = True
    sizes = Sizes("add", "one", 1e-3, 0.1)
    symptom = "everything happens later by the same delay, at all speeds and amplitudes"
    source = "u(t) = u_cmd(t - d); MuJoCo XML reference, actuator/delay"
    experiment = "steps from rest (dead time), and a chirp: the phase is linear in frequency"
    first_values = (0.003, 0.01, 0.03, 0.07)
    group = PLAIN

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Give each actuator a delay line."""
        delay_commands(spec, 0.0, self.extra["longest"])

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the delay."""
        if not model.nactuator:
            raise EffectError("command_delay needs an actuator; this model has none")
        return (self.parameter(low=0.0, high=self.extra["longest"]),)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the actuators' delays."""
        every = np.arange(plant.model.nactuator)
        return FieldBound(plant.field("actuator_delay"), (every,), self.parameters(plant.model)[0])


class _Loss(CommandRule):
    """See `PacketLoss`."""

    order = 10

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self.arrays, n = plant.arrays, plant.num_rows
        zeros = self.arrays.zeros
        self.value, self.held = zeros((n, 1)), zeros((n, plant.model.nu))
        self.count, self.seeds = zeros(n, np.int64), zeros(n, np.uint64)
        self.stream = stream(effect.label())

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[self.arrays.rows(ids)] = self.arrays.own(values[:, :1])

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        rows = self.arrays.rows(ids)
        self.count[rows], self.seeds[rows] = 0, self.arrays.own(np.asarray(seeds, np.uint64))

    def on_episode_start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        self.held[self.arrays.rows(ids)] = self.arrays.own(ctrl)

    def command(self, ids: Any, ctrl: Array) -> None:
        xp, streams = self.arrays.xp, self.stream + self.count[ids]
        lost = uniform(self.seeds[ids], streams, 1, xp) < self.value[ids]  # (n, 1)
        ctrl[:] = xp.where(lost, self.held[ids], ctrl)
        self.held[ids] = ctrl
        self.count[ids] += 1


class PacketLoss(Effect):
    """Probability that a control step's command is lost; all servos hold the previous one."""

    name = "packet_loss"
    engines = BOTH
    place = "robot"
    unit = ""
    typical = (0.0, 0.1)
    visible_in_replay = False
    no_mjcf = "it is random"
    symptom = "the motion occasionally skips a step of the command"
    source = "held commands with independent losses; bus error counters"
    experiment = "count the failed status packets; no motion is needed"
    limits = (0.0, 1.0)
    law = _Loss


class Profile(SubstepRule):
    """The firmware's goal generator: the goal speeds up, moves and stops within limits.

    It knows every servo of the plant; the effects `profile_velocity` and `profile_acceleration`
    write its limits.
    """

    order = 10

    def __init__(self, plant: PlantView) -> None:
        model = plant.model
        self.plant, self.arrays, self.dt = plant, plant.arrays, model.opt.timestep
        self.index = np.array([i for i in range(model.nactuator) if is_joint_servo(model, i)])
        self.columns = model.actuator_ctrladr[self.index]  # (k,)
        gear = model.actuator_gear[self.index, 0]
        self.scale = np.abs(gear)  # a goal in the actuator's length is the joint's angle times this
        shape = (plant.num_rows, len(self.index))
        self.velocity, self.acceleration = (
            np.full(shape, np.inf),
            np.full(shape, np.inf),
        )  # inf: no limit
        # who limits: the servos' places among those here, and their limits in each row
        self.parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {
            "velocity": [],
            "acceleration": [],
        }
        # in the engine: where goals are, how fast they move, their targets until the last command
        # and from then on
        self.goal, self.speed, self.before, self.target = (
            self.arrays.zeros(shape) for _ in range(4)
        )
        self.sent = self.arrays.own(self.columns)
        self.moving = np.zeros(plant.num_rows, dtype=bool)  # rows whose goals are kept

    def collect(self, kind: str, ids: np.ndarray) -> None:
        """Bring the limits of a kind up to date in the rows ids."""
        limits: np.ndarray = getattr(self, kind)
        limits[ids] = np.inf
        for columns, own in self.parts[kind]:
            at = (ids[:, None], columns)
            limits[at] = np.minimum(limits[at], own[ids])

    def on_episode_start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        """Begin at rest at the command that was held."""
        self._rest(ids, self.arrays.own(ctrl[:, self.columns]))
        self.moving[ids] = self._limited(ids)

    def _rest(self, ids: np.ndarray, goal: Array) -> None:
        rows, (low, high) = self.arrays.rows(ids), self._range(ids)
        self.goal[rows], self.speed[rows] = self._within(goal, low, high), 0.0

    def _range(self, ids: np.ndarray | slice) -> tuple[Array, Array]:
        """Return the ends of the servos' control ranges in the rows ids, (n, k) each."""
        bounds = control_range(self.plant, ids)[:, self.columns]
        return self.arrays.own(bounds[..., 0]), self.arrays.own(bounds[..., 1])

    def _within(self, x: Array, low: Array, high: Array) -> Array:
        return self.arrays.xp.minimum(self.arrays.xp.maximum(x, low), high)

    def _limited(self, ids: np.ndarray) -> np.ndarray:
        """Return in which of the rows ids (n,) a goal has a limit, (n,)."""
        limits = np.minimum(self.velocity[ids], self.acceleration[ids])
        return np.any(np.isfinite(limits), axis=1)

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep the rows whose goals have limits; the others' commands are left as they are."""
        rows = np.arange(self.plant.num_rows)[ids]
        limited = self._limited(rows)
        fresh = rows[limited & ~self.moving[rows]]  # were free: there already
        self._rest(fresh, self.before[self.arrays.rows(fresh)])
        self.moving[rows] = limited
        own, limits = self.arrays.own, spaced(rows[limited])
        self.rests, self.rows = not limited.any(), self.arrays.index(limits)
        self.at, self.ends = self.arrays.index(block(limits, self.columns)), self._range(limits)
        fastest, hardest, dt = self.velocity[limits], self.acceleration[limits], self.dt
        hard, free = np.isfinite(hardest), np.isinf(fastest) & np.isinf(hardest)
        self.fastest, self.change, soft = (
            own(fastest),
            own(hardest * dt),
            np.where(hard, hardest, 1),
        )
        # rad/s, rad: what a substep's braking changes
        self.soft = own(soft * dt), own(soft * dt * dt)
        self.hard, self.free = None if hard.all() else own(hard), own(free) if free.any() else None

    def receive(self, ids: Any, ctrl: Array) -> None:
        """Take new targets from commands (n, nu)."""
        self.before[ids] = self.target[ids]
        self.target[ids] = ctrl[:, self.sent]

    def before_substep(self, ids: Any) -> None:
        """Move the goals by one substep, and make them the commands."""
        rows, dt, change, xp = self.rows, self.dt, self.change, self.arrays.xp
        if self.rests:
            return
        goal, speed, sent = self.goal[rows], self.speed[rows], self.target[rows]
        target = self._within(sent, *self.ends)
        way = target - goal
        far = xp.abs(way)
        braking = self.soft[0] * (xp.sqrt(0.25 + 2.0 * far / self.soft[1]) - 0.5)
        direct = far / dt
        wanted = xp.minimum(braking, direct)  # stops at the target
        if self.hard is not None:
            wanted = xp.where(self.hard, wanted, direct)
        wanted = xp.sign(way) * xp.minimum(wanted, self.fastest)
        speed = speed + self._within(wanted - speed, -change, change)
        fast = xp.abs(speed)
        there = (far <= fast * dt * (1 + 1e-9)) & (fast <= change)
        if self.free is not None:
            there |= self.free
        goal = xp.where(there, target, goal + speed * dt)
        self.goal[rows], self.speed[rows] = goal, xp.where(there, 0.0, speed)
        self.plant.ctrl[self.at] = goal if self.free is None else xp.where(self.free, sent, goal)


class _Targets(CommandRule):
    """Hands the commands of a control step to the profile."""

    order = 90

    def __init__(self, profile: Profile) -> None:
        self._profile = profile

    def command(self, ids: Any, ctrl: Array) -> None:
        self._profile.receive(ids, ctrl)


class _Limit(BoundEffect):
    """Writes one of the profile's limits for k of its servos; the smallest of several holds."""

    def __init__(self, profile: Profile, kind: str, columns: np.ndarray) -> None:
        self._profile, self._kind, self._scale = profile, kind, profile.scale[columns]
        self._own = np.full((profile.plant.num_rows, len(columns)), np.inf)
        profile.parts[kind].append((columns, self._own))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self._own[ids] = np.where(values >= NO_LIMIT, np.inf, values) * self._scale
        self._profile.collect(self._kind, ids)


class _ProfileEffect(ActuatorEffect):
    """A limit on the motion of a servo's goal; 1e6 is no limit."""

    engines = BOTH
    hows = ("set",)
    no_mjcf = "MJCF has no limit on the motion of a goal"
    comparable = True
    limit: ClassVar[Literal["velocity", "acceleration"]]
    limits, neutral = (1e-6, NO_LIMIT), NO_LIMIT
    group = RULES
    can = staticmethod(is_joint_servo)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write into the plant's one profile."""
        profile = plant.shared_mechanism("profile", lambda: Profile(plant))
        plant.shared_mechanism("profile targets", lambda: _Targets(profile))
        columns = np.flatnonzero(np.isin(profile.index, self.actuators(plant.model)))
        return _Limit(profile, self.limit, columns)


class ProfileVelocity(_ProfileEffect):
    """Speed limit of a servo's goal; 1e6 (register value 0) means no limit."""

    name = "profile_velocity"
    unit = "rad/s"
    limit = "velocity"
    typical = (1.0, 20.0)
    sizes = Sizes("limit", "fastest", 1.0, 100.0)
    symptom = "large steps become ramps of one slope; small steps do not change"
    source = "|dgoal/dt| <= v; Dynamixel Profile Velocity (112), Feetech goal speed"
    experiment = "steps of two sizes, which become ramps of the same slope"

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return the speed that the joint reaches, and limits that slow usual motions or steps."""
        usual, most = scale.speeds_at(self.where)
        sizes = [scale.reached_at(self.where), *np.array([0.8, 0.4, 0.2]) * usual]
        return np.array([*sizes, np.sqrt(usual * most)] if most > 2 * usual else sizes)


class ProfileAcceleration(_ProfileEffect):
    """Acceleration limit of a servo's goal; 1e6 (register value 0) means no limit."""

    name = "profile_acceleration"
    unit = "rad/s²"
    limit = "acceleration"
    typical = (10.0, 500.0)
    sizes = Sizes("limit", "sharpest", 1.0, 1000.0)
    symptom = "lag that grows with the amplitude of fast motions, at the same frequency"
    source = (
        "trapezoidal profile of the goal, |d²goal/dt²| <= a; Dynamixel Profile Acceleration (108),"
        " Feetech register 41"
    )
    experiment = (
        "the same chirp at two amplitudes; a limit acts at a fixed amplitude x"
        " frequency², a delay at any amplitude"
    )

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return limits at which the usual speed is reached within 15 to 400 ms."""
        usual, _ = scale.speeds_at(self.where)
        return usual / np.array([0.015, 0.05, 0.15, 0.4])
