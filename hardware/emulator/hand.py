"""A person at an emulated robot, who plugs its servos in and moves its joints by hand.

    hand = Hand(world)
    hand.obey("connect elbow_flex")         # "connected: elbow_flex"
    hand.obey("move elbow_flex 0.5")        # begins to move; `step` says when it is there
    while (done := hand.step()) is None:
        world.advance(world.time + 0.005)

`python -m hardware emulate` takes these lines from its terminal. A joint that was moved is held
there until its servo has torque. Servos as they leave the factory (`as_delivered`) all have ID 1.
"""

from dataclasses import replace
from typing import TypeVar

from hardware.config import Robot, Servo
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, did_you_mean, format_names
from hardware.parts import BusSettings

SPEED = 1.5  # rad/s, of a hand
B = TypeVar("B", bound=BusSettings)
LONGEST_STEP = 0.05  # s of motion at once, on a machine that was busy
PLUGGED = {"connect": "connected", "unplug": "unplugged"}
LINES = "connect JOINT ..., unplug JOINT ..., move JOINT ANGLE (JOINT can be all)"


class Hand:
    """Moves and plugs; see the module.

    Args:
        world: the robot.
    """

    def __init__(self, world: EmulatedRobot) -> None:
        self._world, self._names = world, world.robot.names
        self._goals: dict[int, float] = {}  # rad
        self._time = world.time

    def obey(self, line: str) -> str | None:
        """Do what a line says, and return what was done; None if that takes a while.

        Raises:
            RobotError: no such line or joint; the message says what there is.
        """
        verb, *words = line.split()
        if verb in PLUGGED and words:
            joints = [joint for word in words for joint in self._joints(word)]
            for joint in joints:
                self._world.connect(joint, verb == "connect")
            return f"{PLUGGED[verb]}: {', '.join(self._names[joint] for joint in joints)}"
        if verb == "move" and len(words) == 2:
            self._move(*words)
            return None
        raise RobotError(f"{line.strip()!r}: expected {LINES}")

    def _joints(self, word: str) -> list[int]:
        if word == "all":
            return list(range(len(self._names)))
        if word not in self._names:
            hint = did_you_mean(word, self._names)
            raise RobotError(f"no joint {word!r}{hint}; available: {format_names(self._names)}")
        return [self._names.index(word)]

    def _move(self, name: str, angle: str) -> None:
        try:
            goal = float(angle)
        except ValueError:
            raise RobotError(f"{angle!r} is not an angle in rad") from None
        self._time = self._world.time
        self._goals |= {joint: goal for joint in self._joints(name)}

    def step(self) -> str | None:
        """Move on to the world's time, and return which joint has arrived, if one has."""
        seconds = min(self._world.time - self._time, LONGEST_STEP)
        self._time = self._world.time
        for joint, goal in list(self._goals.items()):
            here = float(self._world.mechanics.angle[joint])
            there = here + min(max(goal - here, -SPEED * seconds), SPEED * seconds)
            self._world.place(joint, there)
            if there == goal or self._world.firmware.torque_on[joint]:
                del self._goals[joint]
                return f"{self._names[joint]} is at {self._world.mechanics.angle[joint]:.3f} rad"
        return None


def as_delivered(robot: Robot) -> Robot:
    """Return a robot whose servos are as from the factory: ID, speed, settings."""
    servos = tuple(
        replace(servo, id=servo.type.defaults["id"], registers={}, torque=None)
        for servo in robot.servos
    )
    firsts = [part.servos[0] for part in robot.parts()]
    buses = tuple(_fresh(bus, first) for bus, first in zip(robot.buses, firsts, strict=False))
    bus = buses[0] if buses else _fresh(robot.bus, firsts[0])
    return replace(robot, servos=servos, registers={}, bus=bus, buses=buses)


def _fresh(bus: B, servo: Servo) -> B:
    """Return the bus at the speed and return delay of a servo from the factory."""
    kind = servo.type
    delay = kind.defaults["return_delay_time"] * kind.units.return_delay
    return replace(bus, baud=kind.bauds[kind.defaults["baud_rate"]], return_delay=delay)
