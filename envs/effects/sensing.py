"""Effects on what the robot's encoders say. The robot itself moves as before.

A sensor says what was true on its side of a play when it sampled (`observation_delay`), plus its
offset, plus noise, rounded to its counts; its speed is filtered.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect, Extra, Sizes
from envs.effects.bound import CommandRule, Measurement
from envs.effects.command import stream
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.effects.servo import is_joint_servo
from envs.errors import EffectError
from envs.noise import normal
from envs.physics.arrays import Array

READ = "it changes what is read, not how the robot moves"


class _JointSensor(Measurement):
    """Acts on the measured position or speed of k joints with one value a row."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        found, self.arrays = joints(plant.model, effect.where), plant.arrays
        addresses = np.array([plant.layout.address(int(j)) for j in found])
        self.q, self.v = (self.arrays.own(addresses[:, i]) for i in (0, 1))
        self.value = self.arrays.zeros((plant.num_rows, 1))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[self.arrays.rows(ids)] = self.arrays.own(values[:, :1])


class _SensorEffect(Effect):
    """A measurement of joints with one scalar."""

    place = "joint"
    visible_in_replay = False
    no_mjcf = READ
    limits = (0.0, np.inf)


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
        self.columns, self.gear = model.actuator_ctrladr[servos], model.actuator_gear[servos, 0]
        self.sent = self.arrays.own(self.columns), self.arrays.own(self.gear)
        self.own = np.zeros((plant.num_rows, 1))  # the value, on the host
        self.range = plant.field("actuator_ctrlrange") if servos else None  # (N, nu, 2)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.own[ids] = values[:, :1]
        if self.range is not None:
            self.range[ids[:, None], self.columns] -= (values[:, :1] * self.gear)[..., None]

    def on_episode_start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        ctrl[:, self.columns] -= self.own[ids] * self.gear

    def command(self, ids: Any, ctrl: Array) -> None:
        columns, gear = self.sent
        ctrl[:, columns] -= self.value[ids] * gear

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        qpos[:, self.q] += self.value[ids]

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        qpos[:, :, self.q] += self.value[:, None]

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        qpos[:, self.arrays.host(self.q)] -= self.own[ids]


class EncoderOffset(_SensorEffect):
    """A wrong zero: measured = true + value.

    The servo controls the same wrong reading, so it settles at goal - value while its readings look
    right. With `servo=0` only the log is shifted; the diagnosis calls that a mistake in the log.
    """

    name = "encoder_offset"
    group = PLAIN
    engines = BOTH
    unit = "rad"
    extras = (
        Extra(
            "servo",
            "",
            1.0,
            0.0,
            1.0,
            "1: the servo's loop has the wrong zero, too; 0: only the log has it",
        ),
    )
    typical = (-0.1, 0.1)
    visible_in_replay = True
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
    limits = (-np.inf, np.inf)
    first_values = (-0.05, -0.012, 0.012, 0.05)
    law = _Offset

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if self.free or self.extra["servo"] not in (0.0, 1.0):
            raise EffectError(
                f"{self.label()}: servo is 0 or 1 and cannot be a parameter; try both"
            )

    @property
    def variant(self) -> str:
        """What distinguishes an offset of the log from one of the servo."""
        return "" if self.extra["servo"] else "log only"

    def mjcf_limitation(self) -> str | None:
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
        self.count = self.arrays.zeros(plant.num_rows, np.int64)
        self.seeds = self.arrays.zeros(plant.num_rows, np.uint64)
        self.stream = stream(effect.label())

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        rows = self.arrays.rows(ids)
        self.count[rows], self.seeds[rows] = 0, self.arrays.own(np.asarray(seeds, np.uint64))

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        streams = self.stream + self.count[ids]
        draws = normal(self.seeds[ids], streams, len(self.q), self.arrays.xp)
        qpos[:, self.q] += self.value[ids] * draws
        self.count[ids] += 1


class SensorNoise(_SensorEffect):
    """White Gaussian noise of each position reading; the value is its standard deviation."""

    name = "sensor_noise"
    engines = BOTH
    unit = "rad"
    typical = (0.0, 0.005)
    symptom = "readings that scatter while the joint rests"
    source = "q + N(0, value²); 3 of 4096 counts per turn reported for Dynamixel"
    experiment = "log a joint at rest"
    law = _Noise


class _Rounding(_JointSensor):
    order = 50

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        xp, step = self.arrays.xp, self.value[ids]
        counts = xp.round(qpos[:, self.q] / xp.where(step > 0, step, 1.0))
        qpos[:, self.q] = xp.where(step > 0, counts * step, qpos[:, self.q])


class Quantization(_SensorEffect):
    """Resolution of the encoder: the smallest step between two position readings."""

    name = "quantization"
    engines = BOTH
    unit = "rad"
    typical = (0.0, 0.006)
    symptom = "readings in steps of one size"
    source = "round(q / step) step; 2π/4096 = 1.53 mrad for Dynamixel X"
    experiment = "log a very slow ramp"
    law = _Rounding


class _Filter(_JointSensor):
    order = 60

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect)
        self.now, shape = plant.time, (plant.num_rows, len(self.v))
        self.last = self.arrays.own(np.full(plant.num_rows, -1.0))
        self.input, self.output = self.arrays.zeros(shape), self.arrays.zeros(shape)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        # the first reading is the filter's resting state
        self.last[self.arrays.rows(ids)] = -1.0

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        xp, speed, tau = self.arrays.xp, qvel[:, self.v], self.value[ids]
        first = self.last[ids][:, None] < 0
        dt = xp.clip(self.now[ids] - self.last[ids], 0.0, None)[:, None]
        safe = xp.where(tau > 0, tau, 1.0)
        kept = xp.exp(-dt / safe)
        slope = (speed - self.input[ids]) / xp.where(dt > 0, dt, 1.0)
        lagging = speed - slope * safe  # where the filter of a ramp ends up, (n, k)
        filtered = lagging + (self.output[ids] - (self.input[ids] - slope * safe)) * kept
        out = xp.where(first | (tau <= 0), speed, filtered)
        qvel[:, self.v] = out
        self.last[ids], self.input[ids], self.output[ids] = self.now[ids], speed, out


class VelocityFilter(_SensorEffect):
    """A first-order low-pass of the speed that a servo reports; the value is its time constant."""

    name = "velocity_filter"
    engines = BOTH
    unit = "s"
    typical = (0.0, 0.05)
    symptom = "the reported speed lags behind the slope of the positions and is smoother"
    source = "tau dy/dt = w - y; STS registers lag by about 20 ms"
    experiment = "compare the speed with the slope of the positions; no model is needed"
    law = _Filter
