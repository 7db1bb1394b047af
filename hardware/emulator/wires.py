"""The wire before an emulated robot, by the maker of its servos."""

from __future__ import annotations

from hardware.emulator.bus import Bus
from hardware.emulator.feetech import FeetechBus
from hardware.emulator.feetech_inner import InnerServo
from hardware.emulator.world import World


def bus_of(world: World) -> Bus:
    """Return the wire before a world, by the maker of its servos."""
    feetech = isinstance(world.robot.servos[0], InnerServo)
    return FeetechBus(world) if feetech else Bus(world)
