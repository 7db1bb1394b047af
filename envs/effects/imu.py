"""Effects on what the IMU of a floating base says. The robot itself moves as before.

The IMU reports the orientation and the angular velocity of the base's free joint. It says what was
true when it sampled (`imu_delay`), times the gyro's scale, plus its bias, in axes that are turned
against those that the model gives it (`imu_mounting`).
"""

from collections.abc import Sequence
from typing import Any, ClassVar

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect
from envs.effects.bound import Measurement
from envs.effects.contact import soles
from envs.effects.plant_view import PlantView
from envs.effects.sampling import ObservationDelay, SamplingDelay
from envs.effects.scale import RobotScale
from envs.effects.sensing import READ
from envs.errors import EffectError
from envs.params import Parameter
from envs.physics.arrays import Array

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
AXES = ("x", "y", "z")
HALF = 0.5


def base_of(model: mujoco.MjModel) -> int:
    """Return the free joint that carries the robot; raises EffectError where there is none."""
    found = np.flatnonzero(model.jnt_type == FREE)
    if not found.size:
        raise EffectError("the model has no free joint, so an IMU cannot measure its base")
    return int(found[0])


def _places(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return where the base's turn (4,) is in qpos, and its angular velocity (3,) in qvel."""
    joint = base_of(model)
    turn = int(model.jnt_qposadr[joint]) + 3 + np.arange(4)
    return turn, int(model.jnt_dofadr[joint]) + 3 + np.arange(3)


class _Imu(Measurement):
    """Knows where the base's turn and angular velocity are, and keeps an effect's values."""

    order = 30

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self.arrays, own = plant.arrays, plant.arrays.own
        self.turn, self.spin = (own(place) for place in _places(plant.nominal))
        self.value = self.arrays.zeros((plant.num_rows, max(len(effect.components), 1)))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[self.arrays.rows(ids)] = self.arrays.own(values)

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Leave positions as they are."""


class _Mounting(_Imu):
    """See `ImuMounting`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect)
        self.mount = self.arrays.zeros((plant.num_rows, 4))  # the value as a quaternion
        self._model, self._soles = plant.nominal, soles(plant.nominal)
        self._data = mujoco.MjData(self._model)
        self._up = int(self.turn[0]) - 1  # the base's height

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.mount[self.arrays.rows(ids)] = self.arrays.own(turn_by(values))

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        mount, xp = self.mount[ids], self.arrays.xp
        qpos[:, self.turn] = product(qpos[:, self.turn], mount, xp)
        qvel[:, self.spin] = rotated(inverse(mount, xp), qvel[:, self.spin], xp)

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        mount = turn_by(self.value)[:, None]
        qpos[..., self.turn] = product(qpos[..., self.turn], mount)

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Turn the base back, with its lowest sole as high as before."""
        turn, spin, value = (self.arrays.host(one) for one in (self.turn, self.spin, self.value))
        mount, turned = turn_by(value[ids]), np.flatnonzero(value[ids].any(axis=1))
        low = [self._lowest(qpos[row]) for row in turned]
        qpos[:, turn] = product(qpos[:, turn], inverse(mount))
        qvel[:, spin] = rotated(mount, qvel[:, spin])
        for row, before in zip(turned, low, strict=True):
            qpos[row, self._up] += before - self._lowest(qpos[row])

    def _lowest(self, qpos: np.ndarray) -> float:
        """Return how high the lowest geom is that can touch the ground; 0 without any."""
        if not self._soles.size:
            return 0.0
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        size = self._model.geom_size[self._soles, 0]
        return float((self._data.geom_xpos[self._soles, 2] - size).min())


class _Delay(SamplingDelay):
    """See `ImuDelay`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        super().__init__(plant, effect)
        self.turn, self.spin = (self.arrays.own(place) for place in _places(plant.nominal))

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        late, slow = (self.arrays.xp.asarray(one, copy=True) for one in (qpos, qvel))
        super().measure(ids, late, slow)
        qpos[:, self.turn], qvel[:, self.spin] = late[:, self.turn], slow[:, self.spin]

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        late, slow = qpos.copy(), qvel.copy()
        super().measure_path(dt, late, slow)
        qpos[..., self.turn] = late[..., self.turn]

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Turn the base on, as fast as it turns."""
        turn, spin, value = (self.arrays.host(one) for one in (self.turn, self.spin, self.value))
        ahead = turn_by(qvel[:, spin] * value[ids][:, None])
        qpos[:, turn] = product(qpos[:, turn], ahead)


class _Bias(_Imu):
    """See `GyroBias`."""

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        qvel[:, self.spin] += self.value[ids]

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        qvel[:, self.arrays.host(self.spin)] -= self.arrays.host(self.value)[ids]


class _Scale(_Imu):
    """See `GyroScale`."""

    order = 25

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        qvel[:, self.spin] *= self.value[ids]

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        qvel[:, self.arrays.host(self.spin)] /= self.arrays.host(self.value)[ids]


class _ImuEffect(Effect):
    """An effect on the IMU of a floating base."""

    engines = BOTH
    place = "robot"
    no_mjcf = READ
    group = PLAIN
    components: ClassVar[Sequence[str]] = AXES

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError for a model without a free base."""
        base_of(model)

    @classmethod
    def variants(cls, scale: RobotScale) -> list[dict[str, Any]]:
        """Return one way to try it, where an IMU says how the base turns."""
        return [{}] if scale.feels else []


class ImuMounting(_ImuEffect):
    """Rotation of the IMU relative to the axes in the model, as a rotation vector.

    If a window starts from the IMU's orientation, the base is rotated back and placed on the
    ground.
    """

    name = "imu_mounting"
    unit = "rad"
    display_name = "mounting of the IMU"
    typical = (-0.1, 0.1)
    comparable = True
    symptom = "the measured base is tilted on level ground, and the tilt turns with the robot"
    source = "measured orientation = true orientation times the mounting's rotation"
    experiment = "stand on level ground, turn the robot on the spot, and stand again"
    first_values = np.concatenate([0.05 * np.eye(len(AXES)), -0.05 * np.eye(len(AXES))])
    limits = (-np.pi, np.pi)
    law = _Mounting


class ImuDelay(_ImuEffect):
    """Age of the base's orientation and angular velocity, compared with the encoders.

    `longest` sets the length of the buffer.
    """

    name = "imu_delay"
    unit = "s"
    display_name = "delay of the IMU"
    extras = ObservationDelay.extras
    typical = (0.0, 0.04)
    comparable = True
    symptom = "the base seems to turn after its legs have moved it"
    source = "y(t) = q(t - d): filters and rate of the IMU, and the serial line"
    experiment = "rock the standing robot with its legs at two frequencies"
    first_values = (0.005, 0.015, 0.04)
    components = ()
    law = _Delay

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the delay."""
        self.check(model)
        return (self.parameter(low=0.0, high=self.extra["longest"]),)


class GyroBias(_ImuEffect):
    """Bias of a gyro about the base's axes: measured = true + value."""

    name = "gyro_bias"
    unit = "rad/s"
    display_name = "bias of the gyro"
    typical = (-0.1, 0.1)
    comparable = True
    symptom = "the gyro reports a rotation while the orientation is constant"
    source = "w + b; MEMS gyros: up to 0.05 rad/s before calibration, and more with temperature"
    experiment = "log the robot at rest"
    first_values = np.concatenate([0.1 * np.eye(len(AXES)), -0.1 * np.eye(len(AXES))])
    law = _Bias


class GyroScale(_ImuEffect):
    """Scale error of a gyro: measured = true * value."""

    name = "gyro_scale"
    unit = ""
    display_name = "scale of the gyro"
    hows = ("scale",)
    typical = (0.8, 1.2)
    comparable = True
    symptom = "the gyro reports faster or slower rotations than the orientation"
    source = "s w; a wrong range is a factor of 2 or 4, deg/s instead of rad/s a factor of 57"
    experiment = "turn the robot by hand through a known angle"
    limits, components = (1e-3, np.inf), ()
    law = _Scale


def turn_by(vectors: np.ndarray) -> np.ndarray:
    """Return the quaternions (..., 4) of rotation vectors [rad], (..., 3)."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    axis = HALF * vectors * np.sinc(HALF * angle / np.pi)
    return np.concatenate([np.cos(HALF * angle), axis], axis=-1)


def inverse(turn: Array, xp: Any = np) -> Array:
    """Return the quaternions (..., 4) that undo unit quaternions."""
    return xp.concat([turn[..., :1], -turn[..., 1:]], axis=-1)


def product(first: Array, second: Array, xp: Any = np) -> Array:
    """Return products of quaternions (..., 4): the second turn in the axes of the first."""
    w, v = first[..., :1], first[..., 1:]
    other, axis = second[..., :1], second[..., 1:]
    real = w * other - xp.sum(v * axis, axis=-1, keepdims=True)
    return xp.concat([real, w * axis + other * v + xp.linalg.cross(v, axis)], axis=-1)


def rotated(turn: Array, vectors: Array, xp: Any = np) -> Array:
    """Return vectors (..., 3) turned by unit quaternions (..., 4)."""
    axis = turn[..., 1:]
    side = 2.0 * xp.linalg.cross(axis, vectors)
    return vectors + turn[..., :1] * side + xp.linalg.cross(axis, side)
