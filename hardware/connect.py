"""From a robot's file to a driver: over its serial ports, or the emulated buses if it has none."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from dynamixel_sdk import PortHandler

from hardware.clock import RealClock, VirtualClock
from hardware.config import Robot
from hardware.driver import Driver
from hardware.emulator.loopback import loopback_ports
from hardware.emulator.world import EmulatedRobot
from hardware.feetech.driver import FeetechDriver
from hardware.multi_bus import MultiBusDriver

DRIVERS = {"dynamixel": Driver, "feetech": FeetechDriver}


def make_driver(
    robot: Robot, world: EmulatedRobot | None = None, clock: VirtualClock | None = None
) -> Driver:
    """Return a driver for the robot; nothing is opened yet.

    Args:
        robot: the robot; with `port` the servos at its ports, else emulated in virtual time.
        world: the emulated robot; None makes one that is as the file says.
        clock: the emulated robot's time; None makes one.
    """
    parts = robot.parts()
    if robot.port is not None:
        time, ports = RealClock(), [PortHandler(part.port) for part in parts]
    else:
        time = clock or VirtualClock()
        ports = loopback_ports(world or EmulatedRobot(robot), time)
    drivers = [
        DRIVERS[part.maker](part, port, time) for part, port in zip(parts, ports, strict=True)
    ]
    return drivers[0] if len(drivers) == 1 else MultiBusDriver(robot, drivers)


@contextmanager
def patient(driver: Driver) -> Iterator[None]:
    """Wait longer for answers in this block on every bus: nothing moves, and a machine is busy."""
    with ExitStack() as stack:
        for part in driver.parts:
            stack.enter_context(part.bus_client.more_patient())
        yield
