"""The IMU of an emulated robot: the frames that the real part would send, of its model's physics.

    imu = EmulatedImu(world)
    for arrival, data in imu.until(0.5):        # the robot goes on to the time of each frame
        ...

The part's own filters are not published and not modelled: orientation and acceleration are those of
`inertial.py`, to the resolution of a frame.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from hardware.emulator.world import EmulatedRobot
from hardware.imu import rvc


class EmulatedImu:
    """A BNO085 in its mode UART-RVC at the site that the robot's file names.

    Args:
        world: a robot with an IMU.
    """

    def __init__(self, world: EmulatedRobot) -> None:
        assert world.robot.imu is not None
        assert world.inertial is not None
        self._world, self._inertial = world, world.inertial
        self._mount = np.array(world.robot.imu.mount)
        self._number = 0
        # rad: the part's heading is 0 where it starts
        self._start = self._turned(self._inertial.measure()["orientation"])[0]

    def until(self, time: float) -> Iterator[tuple[float, bytes]]:
        """Yield (arrival [s], bytes) of each frame that is measured up to a time [s]."""
        while (due := self._number / rvc.RATE) <= time:
            self._world.advance(due)
            yield due + rvc.SIZE * 10 / rvc.BAUD, self._frame()
            self._number += 1

    def _turned(self, site: np.ndarray) -> tuple[float, float, float]:
        """Return the part's yaw, pitch and roll in the world [rad], of its site's orientation."""
        part = np.zeros(4)
        mujoco.mju_mulQuat(part, site, self._mount)
        return rvc.angles(part)

    def _frame(self) -> bytes:
        seen = self._inertial.measure()
        yaw, pitch, roll = self._turned(seen["orientation"])
        back, along = np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(back, self._mount)
        mujoco.mju_rotVecQuat(along, seen["acceleration"], back)
        return rvc.encode(self._number, (yaw - self._start, pitch, roll), along)
