"""The servos of one robot in SI units: find, set up, read and command them.

    driver = Driver(robot, port, clock)
    driver.connect()                        # identity, settings, speed; torque stays off
    driver.configure()
    reading = driver.read()                 # Reading(position, velocity, current, fresh, ...)
    driver.command(angles)
    driver.torque_off()                     # verified servo by servo; see `hardware/torque.py`

The driver moves nothing by itself and checks no limits; `hardware/safety.py` does.

One read takes registers 120 to 135 of all servos: the servo's own millisecond counter, PWM,
current, velocity and position. The counter shows whether the answer is new: an old or doubled
answer does not match the elapsed time. A servo without a new answer keeps its last values and is
not `fresh`.
"""

from __future__ import annotations

import itertools
import logging
import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hardware import handshake, rehearsal
from hardware.bus_client import BusClient, Reply
from hardware.clock import Clock
from hardware.config import Robot, Servo
from hardware.counters import Counters
from hardware.errors import HardwareError, SerialPortError, ServoError
from hardware.freshness import Freshness
from hardware.link import LinkScore
from hardware.readings import Health, Reading, errors_of
from hardware.registers import RETRIES, read_register, write_register
from hardware.robot_checks import check_registers
from hardware.stop_limits import StopLimits
from hardware.timing import BLOCK, BLOCK_SIZE, cycle_time, sample_times
from hardware.torque import FIRST_PAUSE, Torque

if TYPE_CHECKING:
    from dynamixel_sdk import PortHandler

_logger = logging.getLogger(__name__)

HEALTH, HEALTH_SIZE = 64, 83  # torque enable to present temperature
TORQUE, ERROR_STATUS, WATCHDOG, GOAL = 64, 70, 98, 116
TURN = 4096
LOAD_STEP = 0.001  # of the full load, a step of the register that takes the current's place
Values = tuple[float, float, float, float]
Replies = dict[int, Reply]
LONGEST_PAUSE = 1.0  # s between attempts to reconnect


class Driver(Torque):
    """The servos of a robot over a port.

    Args:
        robot: the robot's file, with its calibration applied.
        port: a port of dynamixel-sdk, or the emulator's.
        clock: source of the time.
    """

    client_type: ClassVar[type[BusClient]] = BusClient
    block: ClassVar[tuple[int, int]] = (BLOCK, BLOCK_SIZE)  # address and bytes of a reading
    goal: ClassVar[int] = GOAL  # address
    torque: ClassVar[int] = TORQUE  # address

    def __init__(self, robot: Robot, port: PortHandler, clock: Clock) -> None:
        self.robot, self.clock = robot, clock
        self.bus_client = self.client_type(
            port, clock, robot.bus.latency, max(robot.bus.return_delay, 1e-5)
        )
        self.ids = [servo.id for servo in robot.servos]
        n = len(self.ids)
        self._types = [servo.type for servo in robot.servos]
        self._sign = np.array([servo.sign for servo in robot.servos], float)
        self._zero = np.array([servo.zero for servo in robot.servos], float)
        self._step = np.array([kind.units.angle for kind in self._types])
        self._speed = np.array([kind.units.velocity for kind in self._types])
        self._amps = np.array([kind.current or 0.0 for kind in self._types])
        self._effort = np.array([kind.current or LOAD_STEP for kind in self._types])
        self._full = np.array([float(kind.units.full_pwm) for kind in self._types])
        self._turns = np.zeros(n)  # whole turns between the register and the joint
        self._values = np.zeros((4, n))  # PWM, current, velocity, position registers
        self._ages = [Freshness() for _ in self.ids]
        self._health_ages = [Freshness() for _ in self.ids]
        self._stamp = np.zeros(n)
        self._alert = np.zeros(n, bool)
        self.fast = True
        self.score: LinkScore | None = None  # of the link, as measured since it was opened
        self._powered = set()

    def __len__(self) -> int:
        return len(self.robot.servos)

    @property
    def parts(self) -> Sequence[Driver]:
        """Drivers of the robot's buses; only this one if there is one bus."""
        return [self]

    @property
    def counters(self) -> dict[str, Counters]:
        """Link counters of each servo by name."""
        return {servo.name: self.bus_client.counters[servo.id] for servo in self.robot.servos}

    def connect(self) -> None:
        """Open the port and check every servo, without writing or moving.

        Raises:
            SerialPortError: the port cannot be used.
            ServoError: a servo is missing, of another type, shares its ID, answers too slowly, or
                would move by itself with its settings; the message contains the remedy.
        """
        handshake.check_rate(self.robot)
        handshake.check_latency_timer(self.robot, self.bus_client)
        self.bus_client.open(self.robot.bus.baud)
        handshake.check_servos(self.robot, self.bus_client)
        self.score = None
        self._ages, self._health_ages = ([Freshness() for _ in self.ids] for _ in range(2))
        with self.bus_client.more_patient():
            self._adopt()
            self._values[3] = self._zero
            self.fast = self._answers_fast()
            self._read_first()
            self.find_powered()
        self._find_turns()

    def _read_first(self) -> None:
        """Read until every servo has given a new answer."""
        for _ in range(RETRIES):
            reading = self.read()
            if reading.fresh.all():
                return
        name = self.robot.names[int(np.argmin(reading.fresh))]
        raise ServoError(f"{name}: it answers pings, but not reads; check cable and supply")

    def reconnect(self, patience: float) -> None:
        """Reopen a lost port, at growing intervals, until the servos answer; leave torque off.

        Args:
            patience: how long to try [s].

        Raises:
            SerialPortError: the port did not come back in that time.
            ServoError: the port came back, but the servos have changed.
        """
        end, pause = self.clock.now() + patience, FIRST_PAUSE
        while True:
            self.close()
            try:
                self.connect()
                return self.configure()
            except SerialPortError as error:
                if self.clock.now() + pause > end:
                    raise SerialPortError(f"{error}; given up after {patience:g} s") from error
            self.clock.sleep_until(self.clock.now() + pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def measure_link(self, limits: StopLimits) -> LinkScore | None:
        """Measure steps and answers after connecting, and set the time-outs accordingly.

        A link that was good enough is not measured again, nor is the emulated bus of this process,
        which has its own clock.

        Args:
            limits: thresholds for a link that may drive the robot.

        Returns:
            The score, whose `go` is true if the link is good enough; None for the emulated bus.
        """
        if self.robot.port is None or (self.score is not None and self.score.go):
            return self.score
        turns = itertools.cycle(range(len(self)))

        def step() -> None:
            self.read()
            self.health(next(turns))

        times, self.score = rehearsal.score_link(
            step, self.clock, self.robot, self.counters, limits
        )
        longest = min(times.reply, 1 / self.robot.rate)
        for part in self.parts if self.score.go else ():
            part.bus_client.patience = max(self.clock.jitter, longest)
        return self.score

    def configure(self) -> None:
        """Switch torque off, then write the robot's registers and verify each; leave torque off.

        Raises:
            RobotError: a register that would power a servo, or make it unsafe; nothing is written.
            ServoError: a register does not keep its value; torque is off.
        """
        self.torque_off()
        for servo in self.robot.servos:
            check_registers(self.robot, servo, f"{self.robot.name}: servos.{servo.name}")
        try:
            with self.bus_client.more_patient():
                for servo in self.robot.servos:
                    for name, value in self.robot.registers_of(servo).items():
                        self.write_register(servo, name, value)
        except HardwareError:
            self.torque_off()
            raise
        self.read()
        self._find_turns()  # another operating mode may count turns differently

    def read(self) -> Reading:
        """Read all servos, and repeat for those that did not answer."""
        return self.begin_read()()

    def begin_read(self) -> Callable[[], Reading]:
        """Request the readings of all servos and return a function that awaits them; see `read`."""
        asked = self.clock.now()
        finish = self.bus_client.begin_sync_read(*self.block, self.ids, self.fast)
        return lambda: self._read(asked, finish())

    def _read(self, asked: float, replies: Replies) -> Reading:
        """Make a reading of the answers, after a retry of the servos that gave none."""
        stamps = asked + sample_times(self.robot, self.fast)
        fresh = self._take(replies, self.ids, asked)
        left = [number for number, new in zip(self.ids, fresh, strict=True) if not new]
        if left:
            again = self.clock.now()
            late = self._take(self.bus_client.sync_read(*self.block, left, False), left, again)
            stamps = np.where(late, again, stamps)
            fresh |= late
        self._stamp = np.where(fresh, stamps, self._stamp)
        pwm, current, velocity, count = self._values
        return Reading(
            time=asked,
            position=self._sign * (count + TURN * self._turns - self._zero) * self._step,
            velocity=self._sign * velocity * self._speed,
            current=self._sign * current * self._amps,
            effort=self._sign * current * self._effort,
            duty=self._sign * pwm / self._full,
            stamp=self._stamp.copy(),
            count=count.astype(np.int64),
            fresh=fresh,
            alert=self._alert.copy(),
        )

    def counts(self, angles: np.ndarray) -> np.ndarray:
        """Return the goal registers of angles [rad], (n,) int64."""
        exact = self._zero - TURN * self._turns + self._sign * np.asarray(angles) / self._step
        return np.rint(exact).astype(np.int64)

    def angles(self, counts: np.ndarray) -> np.ndarray:
        """Return the angles [rad] of goal registers, (n,)."""
        return self._sign * (counts + TURN * self._turns - self._zero) * self._step

    def command(self, angles: np.ndarray) -> np.ndarray:
        """Send goal angles [rad], (n,), and return them rounded to the servos' resolution."""
        counts = self.counts(angles)
        register = self._types[0].registers["goal_position"]
        goals = zip(self.ids, counts.tolist(), strict=True)
        self.bus_client.sync_write(self.goal, {n: register.encode(count) for n, count in goals})
        return self.angles(counts)

    def health(self, i: int) -> Health | None:
        """Read the state of one servo; None without a new answer."""
        asked = self.clock.now()
        reply = self.bus_client.read(self.ids[i], HEALTH, HEALTH_SIZE)
        if reply is None or len(reply.data) != HEALTH_SIZE:
            return None
        data = reply.data
        tick = struct.unpack_from("<H", data, BLOCK - HEALTH)[0]
        if not self._health_ages[i].accept(tick, asked, self.clock.now()):
            self.bus_client.counters[self.ids[i]].stale += 1
            return None
        units = self._types[i].units
        return Health(
            torque=bool(data[0]),
            errors=errors_of(data[ERROR_STATUS - HEALTH]),
            position_p_gain=struct.unpack_from("<H", data, 84 - HEALTH)[0],
            watchdog=struct.unpack_from("<b", data, WATCHDOG - HEALTH)[0],
            goal=struct.unpack_from("<i", data, GOAL - HEALTH)[0],
            voltage=struct.unpack_from("<H", data, 144 - HEALTH)[0] * units.voltage,
            temperature=float(data[146 - HEALTH]),
        )

    def write_register(self, servo: Servo, name: str, value: int) -> None:
        """Write a register and read it back.

        Raises:
            ServoError: the servo does not answer, refuses, or keeps another value.
        """
        write_register(self.bus_client, servo, name, value)

    def read_register(self, servo: Servo, name: str) -> int:
        """Read a register.

        Raises:
            ServoError: the servo does not answer.
        """
        return read_register(self.bus_client, servo, name)

    def slow_link(self) -> str | None:
        """Report the delay of the newest answers, if it exceeds a machine's jitter."""
        late, allowed = max((p.bus_client.lateness, p.bus_client.patience) for p in self.parts)
        if late <= allowed:
            return None
        return (
            f"the link is slow: answers come {1e3 * late:.0f} ms later than the wire explains; "
            "look at the adapter, the hub, and other programs"
        )

    def cycle_time(self) -> float:
        """Return the bus time for commanding and reading all servos [s]."""
        return cycle_time(self.robot, self.fast)

    def close(self) -> None:
        """Close the port; torque does not change."""
        self.bus_client.close()

    def _take(self, replies: Replies, numbers: list[int], asked: float) -> np.ndarray:
        """Keep the new answers; return which servos gave one, (n,) bool."""
        received = self.clock.now()
        fresh = np.zeros(len(self), bool)
        for number in numbers:
            reply = replies.get(number)
            if reply is None or len(reply.data) != self.block[1] or reply.error:
                continue
            i = self.ids.index(number)
            values = self._decode(i, reply.data, asked, received)
            if values is None:
                continue
            self._values[:, i] = values
            self._alert[i] = reply.alert
            fresh[i] = True
        return fresh

    def _decode(self, i: int, data: bytes, asked: float, received: float) -> Values | None:
        """Return PWM, current, velocity and position registers; None if they cannot be new."""
        tick, _, pwm, current, velocity, count = struct.unpack("<HHhhii", data)
        known, counters = self._ages[i].known, self.bus_client.counters[self.ids[i]]
        if not self._ages[i].accept(tick, asked, received):
            counters.stale += 1
            return None
        turns = round((self._values[3, i] - count) / TURN) if known else 0
        if abs(turns) > 1:
            counters.corrupt += 1
            return None  # no servo turns so far in a step
        self._turns[i] += turns
        return pwm, current, velocity, count

    def _adopt(self) -> None:
        """Take over what the servos are set to, and the robot's file leaves open: nothing here."""

    def set_watchdogs(self, steps: int) -> None:
        """Set the watchdogs: steps of 20 ms without a packet until servos stop; 0: never."""
        for servo in self.robot.servos:
            self.write_register(servo, "bus_watchdog", steps)

    def _answers_fast(self) -> bool:
        """Probe fast reads twice; older firmware leaves them unanswered."""
        for _ in range(2):
            if len(self.bus_client.sync_read(*self.block, self.ids, True)) == len(self):
                return True
        _logger.warning("%s: no fast reads; plain ones are used", self.robot.name)
        return False

    def _find_turns(self) -> None:
        """Choose whole turns so that each joint starts within its limits, if it can."""
        for i, servo in enumerate(self.robot.servos):
            middle = sum(servo.position) / 2
            angle = servo.sign * (self._values[3, i] - self._zero[i]) * self._step[i]
            self._turns[i] = servo.sign * round((middle - angle) / (TURN * self._step[i]))
