"""How the base is turned, from its IMU: orientation and angular velocity of every row.

turn, spin = turned(time, imu, settings)    # (T, 4) quaternions, (T, 3) rad/s in the base
"""

from itertools import accumulate
from operator import mul

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from sim2real.diagnosis.ground.base import Imu
from sim2real.diagnosis.settings import TINY, Ground


def turned(time: np.ndarray, imu: Imu, settings: Ground) -> tuple[np.ndarray, np.ndarray]:
    """Return the base's orientation (T, 4), w first, and angular velocity (T, 3) in its own axes.

    Without an orientation the gyro is integrated and brought upright by what the accelerometer
    feels over `upright_s`; without a gyro the speed is the slope of the orientation.
    """
    spin = None if imu.gyro is None else imu.mount.apply(imu.gyro)
    if imu.orientation is not None:
        turn = imu.orientation * imu.mount.inv()
    else:
        assert spin is not None
        turn = _upright(time, _integrated(time, spin), imu, settings)
    if spin is None:
        spin = slopes(time, turn)
    return turn.as_quat(scalar_first=True), spin


def slopes(time: np.ndarray, turn: Rotation) -> np.ndarray:
    """Return the angular velocity of orientations in their own axes, (T, 3) [rad/s]."""
    before = Rotation.concatenate([turn[:1], turn[:-1]])
    after = Rotation.concatenate([turn[1:], turn[-1:]])
    step = (before.inv() * after).as_rotvec()
    half = (before.inv() * turn).as_rotvec()  # into the axes of the middle
    rate = step / (np.append(time[1:], time[-1:]) - np.append(time[:1], time[:-1]))[:, None]
    return Rotation.from_rotvec(-half).apply(rate)


def back(turn: np.ndarray) -> Rotation:
    """Return turns about the vertical that take the heading out of orientations, (4,) or (T, 4)."""
    w, x, y, z = turn.T
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return Rotation.from_rotvec(np.multiply.outer(heading, [0.0, 0.0, -1.0]))


def _integrated(time: np.ndarray, spin: np.ndarray) -> Rotation:
    """Return orientations from the first row's on, (T,)."""
    middle = (spin[1:] + spin[:-1]) / 2 * np.diff(time)[:, None]
    steps = Rotation.from_rotvec(np.concatenate([np.zeros((1, 3)), middle]))
    return Rotation.concatenate([*accumulate(steps, mul)])


def _upright(time: np.ndarray, turn: Rotation, imu: Imu, settings: Ground) -> Rotation:
    """Return orientations whose mean felt acceleration points up."""
    assert imu.acceleration is not None
    felt = turn.apply(imu.mount.apply(imu.acceleration))  # in the frame of the first row
    width = max(round(settings.upright_s / float(np.median(np.diff(time)))), 1)
    up = uniform_filter1d(felt, width, axis=0, mode="nearest")
    return uprighted(up / np.linalg.norm(up, axis=1, keepdims=True)) * turn


def uprighted(up: np.ndarray) -> Rotation:
    """Return the shortest turns that bring unit vectors (T, 3) upright."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    return Rotation.from_rotvec(axis * np.arctan2(sine, up[:, 2:]) / np.maximum(sine, TINY))
