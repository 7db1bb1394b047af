"""From a robot's file to a driver: over its serial port, or the emulated bus if it has none."""

from __future__ import annotations

from dynamixel_sdk import PortHandler

from hardware.clock import RealClock, VirtualClock
from hardware.config import Robot
from hardware.driver import Driver
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import World
from hardware.feetech.driver import FeetechDriver

DRIVERS = {"dynamixel": Driver, "feetech": FeetechDriver}


def make_driver(
    robot: Robot, world: World | None = None, clock: VirtualClock | None = None
) -> Driver:
    """Return a driver for the robot; nothing is opened yet.

    Args:
        robot: with `port` set the servos at that port, else an emulated robot in virtual time.
        world: the emulated robot; None makes one that is as the file says.
        clock: the emulated robot's time; None makes one.
    """
    kind = DRIVERS[robot.servos[0].type.maker]
    if robot.port is not None:
        return kind(robot, PortHandler(robot.port), RealClock())
    clock = clock or VirtualClock()
    return kind(robot, LoopbackPort(world or World(robot), clock), clock)
