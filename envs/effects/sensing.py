"""Effects on what the robot's encoders say. The robot itself moves as before.

A sensor says what was true on its side of a play when it sampled (`observation_delay`), plus its
offset, plus noise, rounded to its counts; its speed is filtered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from envs.effects.base import PLAIN, CommandRule, Effect, Extra, Measurement, Sizes
from envs.effects.command import stream
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.effects.servo import is_joint_servo
from envs.errors import EffectError
from envs.noise import normal
from envs.params import Parameter

READ = "it changes what is read, not how the robot moves"


class _JointSensor(Measurement):
    """Acts on the measured position or speed of k joints with one value a row."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        found = joints(plant.model, effect.where)
        addresses = np.array([plant.layout.address(int(j)) for j in found])
        self.q, self.v = addresses[:, 0], addresses[:, 1]
        self.value = np.zeros((plant.num_rows, 1))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[ids] = values[:, :1]


class _SensorEffect(Effect):
    """A measurement of joints with one scalar."""

    place = "joint"
    closes_gaps = False
    no_mjcf = READ

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the one parameter, from 0 up."""
        joints(model, self.where)
        return (self.parameter(low=0.0),)


class _Offset(_JointSensor, CommandRule):
    """See `EncoderOffset`."""

    order = 30

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect)
        model, found = plant.model, joints(plant.model, effect.where)
        servos = [i for i in range(model.nactuator) if is_joint_servo(model, i)]
        servos = [
            i for i in servos if effect.extra["servo"] and model.actuator_trnid[i, 0] in found
        ]
        self.columns = model.actuator_ctrladr[servos]
        self.gear = model.actuator_gear[servos, 0]
        self.range = plant.field("actuator_ctrlrange") if servos else None  # (N, nu, 2)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        if self.range is not None:
            self.range[ids[:, None], self.columns] -= (values[:, :1] * self.gear)[..., None]

    def start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        self.command(ids, ctrl)

    def command(self, ids: np.ndarray | slice, ctrl: np.ndarray) -> None:
        ctrl[:, self.columns] -= self.value[ids] * self.gear

    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        qpos[:, self.q] += self.value[ids]

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray) -> None:
        qpos[:, self.q] -= self.value[ids]


class EncoderOffset(_SensorEffect):
    """A wrong zero: measured = true + value.

    A servo closes its loop on the same encoder: its goals have the same wrong zero, so that it
    settles at goal - value while its readings look right. `servo=0` leaves the loop alone, as if
    only the log were shifted.
    """

    name = "encoder_offset"
    unit = "rad"
    extras = (
        Extra(
            "servo",
            "",
            1.0,
            0.0,
            1.0,
            "1: the servo's loop has the wrong zero too; 0: only what is logged",
        ),
    )
    typical = (-0.1, 0.1)
    closes_gaps = True
    no_mjcf = None
    own_mjcf = True
    comparable = True
    sizes = Sizes("signed", "one", 3e-3, 0.3)
    symptom = (
        "a constant error in every pose (servo=0), or gravity that acts at the wrong"
        " angle (servo=1)"
    )
    source = "measured = true + value; XL330: 0.014 to 0.022 rad (Rhoban's BAM logs)"
    experiment = "holds over the whole range, without load or with the base turned by 90 degrees"

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if self.free or self.extra["servo"] not in (0.0, 1.0):
            raise EffectError(f"{self.label()}: servo is 0 or 1, and no parameter; try both")

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the offset."""
        joints(model, self.where)
        return (self.parameter(),)

    def bind(self, plant: PlantView) -> Measurement:
        """Shift the measured positions, and the goals of the joint's servos."""
        return _Offset(plant, self)

    @property
    def variant(self) -> str:
        """What tells an offset of the log from one of the servo."""
        return "" if self.extra["servo"] else "log only"

    @classmethod
    def variants(cls, scale: RobotScale) -> list[dict[str, Any]]:
        """Return both kinds of a wrong zero."""
        return [{"servo": 1.0}, {"servo": 0.0}]

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return offsets from under a degree to three degrees, both ways."""
        return np.array([-0.05, -0.012, 0.012, 0.05])

    def batch(self) -> str:
        """Return the group of effects without rules, or that of offsets of the log."""
        return PLAIN if self.extra["servo"] else "log offset"

    def why_not_mjcf(self) -> str | None:
        """Return why an offset that only the log has cannot be said."""
        return None if self.extra["servo"] else READ

    def to_mjcf(self, spec: mujoco.MjSpec, model: mujoco.MjModel, values: Sequence[float]) -> None:
        """Let joints read more than they did: their reference, limits, rest and keyframes."""
        (value,) = (float(v) for v in values)
        names = [self.where] if self.where else sorted({a.target for a in spec.actuators})
        for joint in (spec.joint(name) for name in names):
            joint.ref, joint.springref = joint.ref + value, joint.springref + value
            joint.range = np.array(joint.range) + value
            for key in spec.keys:
                qpos = np.array(key.qpos) if len(key.qpos) else model.qpos0.copy()
                qpos[model.joint(joint.name).qposadr[0]] += value
                key.qpos = qpos


class _Noise(_JointSensor):
    order = 40

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect)
        self.count, self.seeds = (
            np.zeros(plant.num_rows, np.int64),
            np.zeros(plant.num_rows, np.uint64),
        )
        self.stream = stream(effect.label())

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.count[ids], self.seeds[ids] = 0, seeds

    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        draws = normal(self.seeds[ids], self.stream + self.count[ids], len(self.q))
        qpos[:, self.q] += self.value[ids] * draws
        self.count[ids] += 1


class SensorNoise(_SensorEffect):
    """White Gaussian noise on each reading of the position; the value is its standard deviation."""

    name = "sensor_noise"
    unit = "rad"
    typical = (0.0, 0.005)
    symptom = "readings that scatter while the joint rests"
    source = "q + N(0, value²); 3 counts of 4096 reported for Dynamixel"
    experiment = "log a joint at rest"

    def bind(self, plant: PlantView) -> Measurement:
        """Add noise that depends on the episode's seed alone."""
        return _Noise(plant, self)


class _Rounding(_JointSensor):
    order = 50

    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        step = self.value[ids]
        counts = np.round(qpos[:, self.q] / np.where(step > 0, step, 1.0))
        qpos[:, self.q] = np.where(step > 0, counts * step, qpos[:, self.q])


class Quantization(_SensorEffect):
    """The step between two readings of the position that the encoder can tell apart."""

    name = "quantization"
    unit = "rad"
    typical = (0.0, 0.006)
    symptom = "readings in steps of one size"
    source = "round(q / step) step; 2π/4096 = 1.53 mrad for Dynamixel X"
    experiment = "log a very slow ramp"

    def bind(self, plant: PlantView) -> Measurement:
        """Round the measured positions."""
        return _Rounding(plant, self)


class _Filter(_JointSensor):
    order = 60

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect)
        self.now = plant.time
        shape = (plant.num_rows, len(self.v))
        self.last, self.input, self.output = (
            np.full(plant.num_rows, -1.0),
            np.zeros(shape),
            np.zeros(shape),
        )

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.last[ids] = -1.0  # the first reading is the filter's resting state

    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        speed, tau = qvel[:, self.v], self.value[ids]
        first = self.last[ids][:, None] < 0
        dt = np.maximum(self.now[ids] - self.last[ids], 0.0)[:, None]
        safe = np.where(tau > 0, tau, 1.0)
        kept = np.exp(-dt / safe)
        slope = (speed - self.input[ids]) / np.where(dt > 0, dt, 1.0)
        lagging = speed - slope * safe  # where the filter of a ramp ends up, (n, k)
        filtered = lagging + (self.output[ids] - (self.input[ids] - slope * safe)) * kept
        out = np.where(first | (tau <= 0), speed, filtered)
        qvel[:, self.v] = out
        self.last[ids], self.input[ids], self.output[ids] = self.now[ids], speed, out


class VelocityFilter(_SensorEffect):
    """A first-order low-pass on the speed that a servo reports; the value is its time constant.

    Exact for speeds that change linearly between control steps.
    """

    name = "velocity_filter"
    unit = "s"
    typical = (0.0, 0.05)
    symptom = "the reported speed is late and rounded against the slope of the positions"
    source = "tau dy/dt = w - y; STS registers lag by about 20 ms"
    experiment = "compare the speed with the slope of the positions; no model is needed"

    def bind(self, plant: PlantView) -> Measurement:
        """Filter the measured speeds."""
        return _Filter(plant, self)


class _SamplingDelay(Measurement):
    """See `ObservationDelay`. Keeps each row's states at its last K control steps."""

    order = 20

    def __init__(self, plant: PlantView, longest: float) -> None:
        model = plant.nominal
        n, k = plant.num_rows, math.ceil(longest / model.opt.timestep) + 2
        self.now, self.value = plant.time, np.zeros(n)
        self.times = np.zeros((n, k))
        self.qpos, self.qvel = np.zeros((n, k, model.nq)), np.zeros((n, k, model.nv))
        self.newest = np.zeros(n, dtype=np.int64)
        self.fresh = np.ones(n, dtype=bool)
        scalar = [
            j for j in range(model.njnt) if model.jnt_type[j] >= int(mujoco.mjtJoint.mjJNT_SLIDE)
        ]
        self.q, self.v = model.jnt_qposadr[scalar], model.jnt_dofadr[scalar]
        turned = [j for j in range(model.njnt) if j not in scalar]
        ends = {0: 3, 1: 0}  # where the quaternion begins: free, ball
        self.quaternions = [
            int(model.jnt_qposadr[j]) + ends[int(model.jnt_type[j])] for j in turned
        ]

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[ids] = values[:, 0]

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.fresh[ids] = True

    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        rows = np.arange(len(self.now))[ids]
        self._remember(rows, qpos, qvel)
        samples = self.times.shape[1]
        when = self.now[rows] - self.value[rows]
        slots = (
            self.newest[rows][:, None] + 1 + np.arange(samples)
        ) % samples  # oldest first, (n, K)
        times = np.take_along_axis(self.times[rows], slots, 1)
        after = np.clip((times <= when[:, None]).sum(1), 1, samples - 1)
        every = np.arange(len(rows))
        old, new = slots[every, after - 1], slots[every, after]
        t0, t1 = times[every, after - 1], times[every, after]
        dt = np.where(t1 > t0, t1 - t0, 1.0)[:, None]
        s = np.clip((when - t0)[:, None] / dt, 0.0, 1.0)
        q0, q1, v0, v1 = (
            self.qpos[rows, old],
            self.qpos[rows, new],
            self.qvel[rows, old],
            self.qvel[rows, new],
        )
        past = q0 + s * (q1 - q0)
        w = s * (1.0 - s)  # cubic through both states and their speeds
        bend = w * ((1 - s) * v0[:, self.v] - s * v1[:, self.v]) * dt
        past[:, self.q] += bend - w * (1 - 2 * s) * (q1 - q0)[:, self.q]
        for first in self.quaternions:
            quaternion = past[:, first : first + 4]
            past[:, first : first + 4] = quaternion / np.linalg.norm(
                quaternion, axis=1, keepdims=True
            )
        late = self.value[rows] > 0
        qpos[late], qvel[late] = past[late], (v0 + s * (v1 - v0))[late]

    def _remember(self, rows: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        new = self.fresh[rows]
        if new.any():
            started, samples = rows[new], self.times.shape[1]
            self.qpos[started], self.qvel[started] = qpos[new][:, None], qvel[new][:, None]
            self.times[started] = self.now[started][:, None]
            self.newest[started] = samples - 1
            self.fresh[started] = False
        going = rows[~new]
        self.newest[going] = (self.newest[going] + 1) % self.times.shape[1]
        at = (going, self.newest[going])
        self.times[at], self.qpos[at], self.qvel[at] = self.now[going], qpos[~new], qvel[~new]


class ObservationDelay(Effect):
    """How old the measured positions and speeds are.

    Between control steps the positions are interpolated by cubics that fit the speeds too.
    `longest` sizes the memory.
    """

    name = "observation_delay"
    place = "robot"
    unit = "s"
    extras = (Extra("longest", "s", 0.1, 1e-4, 10.0, "the longest delay that can be asked for"),)
    typical = (0.0, 0.04)
    no_mjcf = READ
    comparable = True
    sizes = Sizes("add", "one", 1e-3, 0.1)
    symptom = "the log is late against the commands, and the robot is not slower"
    source = "y(t) = q(t - d): return delay, bus turn-round and the USB timer"
    experiment = (
        "steps from rest next to a second, fast sensor; else the same as command_delay"
        " in an open-loop log"
    )

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the delay."""
        return (self.parameter(low=0.0, high=self.extra["longest"]),)

    def bind(self, plant: PlantView) -> Measurement:
        """Report what was true some time ago."""
        return _SamplingDelay(plant, self.extra["longest"])

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return delays from a bus at its fastest to a slow camera."""
        return np.array([0.003, 0.01, 0.03, 0.07])

    def batch(self) -> str:
        """Return the group of effects without rules of their own."""
        return PLAIN
