"""Sensors other than the servos: position, orientation and angular velocity of the robot's base.

    names: "orientation"  a unit quaternion w x y z, (4,)
           "gyro"         angular velocity about the base's own axes [rad/s], (3,)
           "position"     of the base, from an external tracker [m], (3,)
           "acceleration" along the axes of the IMU's site, gravity in it [m/s^2], (3,)

A real robot's IMU is the one that its file names (`hardware/imu`), or whatever you plug in: write a
class with these members and hand it to `ServoBackend(sensors=...)`. Other names that it measures
go into the log. The emulated robot has all that its model has.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from hardware.emulator.model import home_pose
from hardware.emulator.world import EmulatedRobot
from hardware.parts import QUANTITIES

SIZES = {"orientation": 4, "gyro": 3, "position": 3}  # what a task may observe or be paid for
OF_THE_IMU = {  # quantity: kind of a log's column, and its parts
    "orientation": ("quat", "wxyz"),
    "gyro": ("gyro", "xyz"),
    "acceleration": ("accelerometer", "xyz"),
}


class BodySensors(Protocol):
    """Measures the robot's base, and brings the robot back to its start.

    One that has to be opened and closed has methods `open` and `close` too; see `SerialImu`.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Return which of the quantities above it measures."""
        ...

    def measure(self, now: float) -> Mapping[str, np.ndarray]:
        """Return the newest values by name; `now` is the clock's time [s].

        Raises:
            SerialPortError: there are none; the robot is then stopped.
        """
        ...

    def return_to_start(self, now: float) -> None:
        """Put the robot where episodes start; by hand, it can only be waited for."""
        ...


def columns(name: str, size: int, site: str | None) -> list[str]:
    """Return a log's columns for a quantity: those of an IMU where its site is known."""
    if site is not None and name in OF_THE_IMU:
        kind, parts = OF_THE_IMU[name]
        return [f"{kind}.{site}.{part}" for part in parts]
    return [f"sensor.{name}_{i}" for i in range(size)]


class EmulatedBody:
    """The IMU of an emulated robot, a tracker of its base, and the hand that puts it back.

    Args:
        world: the robot. Its IMU is that of its file, with its errors; where the file has none, it
            is what its model has of the sensors `orientation` and `gyro`.
    """

    def __init__(self, world: EmulatedRobot) -> None:
        self._world = world
        mechanics = world.mechanics
        own = mechanics.sensors() if world.robot.imu is None else world.robot.imu.emulated.measures
        imu = tuple(name for name in QUANTITIES if name in own)
        self._base = int(mechanics.model.body_rootid[mechanics.model.dof_bodyid[mechanics.dof[0]]])
        turned = set(mechanics.qpos.tolist())
        model = mechanics.model
        self._home: list[tuple[slice, np.ndarray, slice]] = []
        for name, values in home_pose(world.robot).items():
            joint = model.joint(name)
            if int(joint.qposadr[0]) not in turned:
                start, dof = int(joint.qposadr[0]), int(joint.dofadr[0])
                size = 6 if len(values) == 7 else 3 if len(values) == 4 else 1
                place = slice(start, start + len(values)), values, slice(dof, dof + size)
                self._home.append(place)
        self.names: tuple[str, ...] = (*imu, "position") if self._home else imu

    def measure(self, now: float) -> dict[str, np.ndarray]:
        """Return the current readings of the robot's IMU and of the tracker."""
        self._world.advance(now)
        mechanics = self._world.mechanics
        inertial = self._world.inertial
        seen = mechanics.sensors() if inertial is None else inertial.measure()
        values = {name: seen[name] for name in QUANTITIES if name in self.names}
        if "position" in self.names:
            values["position"] = mechanics.data.xpos[self._base].copy()
        return values

    def return_to_start(self, now: float) -> None:
        """Put the base where it is in the keyframe `home`, at rest; the servos stay as they are."""
        self._world.advance(now)
        data = self._world.mechanics.data
        for positions, values, speeds in self._home:
            data.qpos[positions] = values
            data.qvel[speeds] = 0.0
