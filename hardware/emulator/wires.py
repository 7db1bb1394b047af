"""The wires before an emulated robot, by the makers of its servos."""

from hardware.emulator.bus import Bus
from hardware.emulator.feetech import FeetechBus
from hardware.emulator.feetech_inner import InnerServo
from hardware.emulator.world import EmulatedRobot


def buses_of(world: EmulatedRobot) -> list[Bus]:
    """Return a wire for each bus of a world's robot, in their order."""
    return [
        (FeetechBus if isinstance(part.servos[0], InnerServo) else Bus)(world, part)
        for part in world.robot.parts()
    ]
