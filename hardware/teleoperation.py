"""A robot that follows another one, which a person moves by hand: teleoperation.

    leader = Leader(make_driver(load_robot("so101_leader.yaml")), follower)
    leader.connect()                            # its torque is off
    with guard:
        guard.arm()
        guard.move_to(leader.angles())
        recording.follow(leader.angles, steps=500)

Each has its own zeros, signs and limits: what is handed over are angles by the joints' names. The
follower's guard limits them as any other command. A leader that falls silent stops it.
"""

from collections.abc import Callable, Sequence

import numpy as np

from hardware.config import Robot
from hardware.driver import Driver
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, SerialPortError, ServoError, did_you_mean, format_names

MISSES = 5  # readings in a row without a new answer of a joint, after which the leader is given up


class Leader:
    """Servos without torque whose angles a follower takes.

    Args:
        driver: of the leader's servos.
        follower: the robot that follows.
        scaled: joints whose place in their travel is handed over, not their angle, such as a
            gripper whose handle opens less far.
        person: moves an emulated leader; is called before each reading.

    Raises:
        RobotError: the leader has other joints than the follower, or `scaled` names none of them.
    """

    def __init__(
        self,
        driver: Driver,
        follower: Robot,
        scaled: Sequence[str] = (),
        person: Callable[[], None] = lambda: None,
    ) -> None:
        self._driver, self._follower, self._person = driver, follower, person
        robot = driver.robot
        check_joints(robot, follower)
        for name in scaled:
            if name not in follower.names:
                hint = did_you_mean(name, follower.names)
                raise RobotError(
                    f"leader_scale: {follower.name} has no joint {name!r}{hint}; it has "
                    f"{format_names(follower.names)}"
                )
        self._order = [robot.names.index(name) for name in follower.names]
        self._scaled = np.array([name in scaled for name in follower.names])
        self._from = np.array([robot.servo(name).position for name in follower.names]).T
        self._to = np.array([servo.position for servo in follower.servos]).T
        self._missed = np.zeros(len(robot.servos), int)

    def connect(self) -> None:
        """Open the port, check the servos and switch their torque off.

        Raises:
            SerialPortError, ServoError: see `Driver.connect`.
            ServoError: reading both robots takes longer than a control step of the follower.
        """
        self._driver.connect()
        self._driver.torque_off()
        rate, robot = self._follower.rate, self._driver.robot
        if self._driver.cycle_time() > 1 / rate:
            raise ServoError(
                f"{robot.name}: reading it takes {self._driver.cycle_time() * 1e3:.1f} ms, but "
                f"{self._follower.name} is commanded {rate:g} times a second: lower robot.rate"
            )

    def angles(self) -> np.ndarray:
        """Return the follower's wanted angles [rad], (n,), in the order of its servos.

        Raises:
            SerialPortError: the leader's port is gone, or a joint was silent for MISSES readings.
        """
        self._person()
        reading = self._driver.read()
        self._missed = np.where(reading.fresh, 0, self._missed + 1)
        if (self._missed >= MISSES).any():
            name = self._driver.robot.names[int(self._missed.argmax())]
            raise SerialPortError(
                f"{self._driver.robot.name}: {name} gave no new answer {MISSES} times in a row; "
                "look for a loose plug"
            )
        here = reading.position[self._order]
        part = (here - self._from[0]) / (self._from[1] - self._from[0])
        return np.where(self._scaled, self._to[0] + part * (self._to[1] - self._to[0]), here)

    def close(self) -> None:
        """Close the port."""
        self._driver.close()


def check_joints(leader: Robot, follower: Robot) -> None:
    """Refuse a leader with other joints than its follower.

    Raises:
        RobotError: with the joints that only one of them has.
    """
    alone = [name for name in leader.names if name not in follower.names]
    missing = [name for name in follower.names if name not in leader.names]
    if alone or missing:
        raise RobotError(
            f"the leader {leader.name} has different joints from {follower.name}: "
            f"{format_names(alone)} only the leader, {format_names(missing)} only the follower; "
            "give the servos of both the same names"
        )


class EmulatedPerson:
    """Moves the joints of an emulated leader along angles, as a hand does.

    Args:
        world: the leader.
        angles: where its joints are at each step [rad], (T, n).
        rate: steps a second.
        now: the time [s].
    """

    def __init__(
        self, world: EmulatedRobot, angles: np.ndarray, rate: float, now: Callable[[], float]
    ) -> None:
        self._world, self._angles, self._rate, self._now = world, angles, rate, now
        self._start: float | None = None

    def __call__(self) -> None:
        """Put the joints where they are now; the first call begins the motion."""
        now = self._now()
        self._start = now if self._start is None else self._start
        step = min(int((now - self._start) * self._rate), len(self._angles) - 1)
        for joint, angle in enumerate(self._angles[step].tolist()):
            self._world.place(joint, angle)
