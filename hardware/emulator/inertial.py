"""Readings of the emulated IMU at its site: the simulated motion, late, noisy and biased.

    inertial = InertialSensor(robot.imu, mechanics, rng)
    inertial.remember()                     # after each tick of the robot
    inertial.measure()["acceleration"]      # m/s^2 along the site's axes; at rest 9.81 upwards

Errors are those of the robot's file (`imu.emulated`), and what the robot hides (`Hidden.imu`): a
part that is askew, later still, or whose gyro is off; without them readings are exact. Noise is
white: each reading draws its own, so that a value that is read twice differs.
"""

from collections import deque
from collections.abc import Mapping

import mujoco
import numpy as np

from hardware.emulator.hidden import IMU_EFFECTS
from hardware.emulator.mechanics import TICK, Mechanics
from hardware.emulator.model import IMU_SENSORS
from hardware.parts import Imu


class InertialSensor:
    """An IMU at the site that the robot's file names.

    Args:
        imu: the part and its errors.
        mechanics: the robot.
        rng: the random generator of its noise.
        hidden: values of each of `IMU_EFFECTS`.
    """

    def __init__(
        self,
        imu: Imu,
        mechanics: Mechanics,
        rng: np.random.Generator,
        hidden: Mapping[str, tuple[float, ...]] = IMU_EFFECTS,
    ) -> None:
        self.errors, self._mechanics, self._rng = imu.emulated, mechanics, rng
        self._site = mechanics.model.site(imu.site).id
        (delay,), (self._scale,) = hidden["imu_delay"], hidden["gyro_scale"]
        self._bias, askew = np.array(hidden["gyro_bias"]), np.array(hidden["imu_mounting"])
        self._askew = askew if askew.any() else None
        ticks = round((self.errors.latency + delay) / TICK)
        self._past: deque[dict[str, np.ndarray]] | None = deque(maxlen=ticks + 1) if ticks else None

    def remember(self) -> None:
        """Keep the truth of now for a reading that is late; called once a tick."""
        if self._past is not None:
            self._past.append(self._truth())

    def measure(self) -> dict[str, np.ndarray]:
        """Return the part's current readings along the axes of the site.

        Returns:
            orientation: a unit quaternion w x y z, (4,).
            gyro: angular velocity [rad/s], (3,).
            acceleration: gravity in it [m/s^2], (3,).
        """
        truth, errors = self._past[0] if self._past else self._truth(), self.errors
        truth = truth if self._askew is None else _askew(truth, self._askew)
        gyro = self._scale * truth["gyro"] + self._bias
        return {
            "orientation": self._turned(truth["orientation"]),
            "gyro": self._off(gyro, errors.gyro_bias, errors.gyro_noise),
            "acceleration": self._off(
                truth["acceleration"], errors.acceleration_bias, errors.acceleration_noise
            ),
        }

    def _truth(self) -> dict[str, np.ndarray]:
        """Return the model's sensors at the site.

        What holds a robot is not part of the physics, which lets it fall and puts it back: what is
        held feels its weight.
        """
        mechanics, data = self._mechanics, self._mechanics.data
        truth = {name: data.sensor(own).data.copy() for name, (own, _) in IMU_SENSORS.items()}
        if mechanics.is_held:
            axes = data.site_xmat[self._site].reshape(3, 3)
            truth["acceleration"] = -mechanics.model.opt.gravity @ axes
        return truth

    def _off(self, value: np.ndarray, bias: tuple[float, float, float], noise: float) -> np.ndarray:
        value = value + np.asarray(bias)
        return value + noise * self._rng.normal(size=3) if noise else value

    def _turned(self, orientation: np.ndarray) -> np.ndarray:
        """Return an orientation turned by a small random rotation about the site's axes."""
        if not (noise := self.errors.orientation_noise):
            return orientation
        turned = orientation.copy()
        mujoco.mju_quatIntegrate(turned, noise * self._rng.normal(size=3), 1.0)
        return turned


def _askew(truth: Mapping[str, np.ndarray], mount: np.ndarray) -> dict[str, np.ndarray]:
    """Return the readings of a part that is turned by a rotation vector in the site's axes."""
    axes, back = np.zeros(4), np.zeros(4)
    angle = float(np.linalg.norm(mount))
    mujoco.mju_axisAngle2Quat(axes, mount / angle, angle)
    mujoco.mju_negQuat(back, axes)
    found = {"orientation": np.zeros(4)}
    mujoco.mju_mulQuat(found["orientation"], truth["orientation"], axes)
    for name in ("gyro", "acceleration"):
        found[name] = np.zeros(3)
        mujoco.mju_rotVecQuat(found[name], truth[name], back)
    return found
