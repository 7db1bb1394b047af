"""An emulated robot: servos and physics under one clock, faults included.

    world = EmulatedRobot(load_robot("bench1"))
    world.advance(0.5)                      # nothing happens on the bus, the robot moves on
    world.mechanics.angle                   # where its joints are [rad], (n,)

What stands between it and a client (`loopback.py`, `pty.py`) puts a `Bus` before it. The same bytes
at the same times give the same answers, bit for bit.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hardware.config import Robot
from hardware.emulator.faults import Fault, Faults
from hardware.emulator.feetech_inner import inner
from hardware.emulator.firmware import Firmware
from hardware.emulator.hidden import IMU_EFFECTS, HiddenEffects, read_hidden
from hardware.emulator.inertial import InertialSensor
from hardware.emulator.mechanics import TICK, Mechanics
from hardware.emulator.memory import ControlTable
from hardware.emulator.servo import REBOOT_SILENCE, Servo
from hardware.errors import RobotError, format_names

WATCH = 5  # ticks between looks at the bus watchdogs


class EmulatedRobot:
    """The emulated robot.

    Args:
        robot: the true robot; a driver's file may differ from it.
        hidden: the hidden effects; None reads the file `robot.hidden`.
        faults: faults of bus and servos, and their times.
        seed: the seed of all its randomness.
        registers: EEPROM and RAM of servos at the start, by actuator, where they differ from what
            the robot's file implies: `{"hinge": {"baud_rate": 1}}`.
    """

    def __init__(
        self,
        robot: Robot,
        hidden: HiddenEffects | None = None,
        faults: Sequence[Fault] = (),
        seed: int = 0,
        registers: Mapping[str, Mapping[str, int]] | None = None,
    ) -> None:
        streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
        for servo in robot.servos:
            servo.type.check_emulated(f"{robot.name}: servos.{servo.name}")
        self.robot = robot = inner(robot)
        self.hidden = hidden or read_hidden(robot.hidden, robot)
        self.mechanics = Mechanics(robot, self.hidden)
        memories = [
            ControlTable(
                servo.type, _as_set_up(robot, i) | dict((registers or {}).get(servo.name, {}))
            )
            for i, servo in enumerate(robot.servos)
        ]
        self.firmware = Firmware(robot, memories, self.mechanics, self.hidden, streams[0])
        self.servos = [Servo(i, memory, self.firmware) for i, memory in enumerate(memories)]
        self.faults = Faults(faults, streams[1])
        self._events = _events(faults)
        self._delays = self.hidden.robot["command_delay"] > 0
        self.wire_rng = streams[2]  # the randomness of the wire before it
        imu = robot.imu
        self.inertial = (
            None
            if imu is None
            else InertialSensor(imu, self.mechanics, streams[3], self.hidden.imu)
        )
        if imu is None and self.hidden.imu != IMU_EFFECTS:
            raise RobotError(
                f"{robot.name}: its file names no IMU; remove {format_names(IMU_EFFECTS)}"
            )
        self._held = np.zeros(len(self.servos), bool)

    @property
    def time(self) -> float:
        """Seconds since the start, as far as the physics went."""
        return self.firmware.time

    def advance(self, time: float) -> None:
        """Let firmware and physics go on until this time [s]; never back.

        A tick of the firmware that starts before or at `time` is run: what it measured is what a
        client reads now, and what a client writes now is for the next tick.
        """
        firmware = self.firmware
        while firmware.time <= time + 1e-9:
            now = firmware.time
            while self._events and self._events[0][0] <= now:
                self._strike(*self._events.pop(0))
            if firmware.ticks % WATCH == 0:
                for servo in self.servos:
                    servo.watch(now)
                if self._held.any():
                    self._let_go()
            if self._delays:
                for servo in self.servos:
                    servo.apply_due(now)
            firmware.tick()
            if self.inertial is not None:
                self.inertial.remember()

    def skip(self, seconds: float) -> None:
        """Let time [s] pass in which nothing moves, while the servos' counters go on."""
        self.firmware.ticks += math.ceil(seconds / TICK)

    def pause_watchdogs(self, seconds: float) -> None:
        """Let this time [s] not count for the bus watchdogs: nothing could be heard in it."""
        for servo in self.servos:
            servo.heard += seconds

    def hold(self) -> None:
        """Put the robot into its keyframe `home` and hold it there, as a hand or a stand does.

        Each joint is held until its servo has torque, all the rest of the robot until every servo
        has. Torque that goes again lets the robot fall.
        """
        self.mechanics.go_home()
        self._held[:] = True
        self._let_go()

    def place(self, joint: int, angle: float) -> None:
        """Hold one joint at an angle [rad], as a hand does; one whose servo has torque resists."""
        if not self.firmware.torque_on[joint]:
            self.mechanics.place(joint, angle)
            self._held[joint] = True
            self._let_go()

    def connect(self, servo: int, connected: bool = True) -> None:
        """Put a servo on the bus, or take it off; its supply stays."""
        self.servos[servo].silent_until = 0.0 if connected else math.inf

    def _let_go(self) -> None:
        """Hold no longer the joints whose servos have torque."""
        self._held &= ~self.firmware.torque_on
        self.mechanics.hold(self._held)

    def is_silent(self, servo: Servo, now: float) -> bool:
        """Return whether a servo neither receives nor answers now: it reboots, or has no supply."""
        return self.firmware.dark or now < servo.silent_until

    def _strike(self, time: float, fault: Fault, starts: bool) -> None:
        firmware = self.firmware
        if fault.kind == "blackout":
            firmware.dark = starts
            for servo in self.servos:
                if starts:
                    servo.reboot(time)
                servo.silent_until = time + REBOOT_SILENCE
        for servo in self.servos:
            if fault.servo not in (None, servo.id):
                continue
            if fault.kind == "supply":
                sharing = firmware.shares[servo.index]
                firmware.battery[sharing] = (
                    fault.value if starts else firmware.full_battery[sharing]
                )
            elif fault.kind == "reboot" and starts:
                servo.reboot(time)
            elif fault.kind == "stuck":
                self.mechanics.lock(servo.index, starts)
            elif fault.kind == "slip" and starts:
                firmware.slip[servo.index] += fault.value
            elif fault.kind == "heat":
                firmware.heating[servo.index] = fault.value if starts else 0.0


def _as_set_up(robot: Robot, i: int) -> dict[str, int]:
    """The EEPROM of a servo that was set up for this robot: ID, baud and return delay."""
    servo = robot.servos[i]
    kind, bus = servo.type, robot.bus_of(servo)
    delay = round(bus.return_delay / kind.units.return_delay)
    values = {"id": servo.id, "baud_rate": kind.bauds.index(bus.baud), "return_delay_time": delay}
    eeprom = {n: v for n, v in robot.registers_of(servo).items() if kind.register(n).eeprom}
    return values | eeprom


def _events(faults: Sequence[Fault]) -> list[tuple[float, Fault, bool]]:
    """(time, fault, whether it starts) of the faults in the servos, in order of time."""
    events = []
    for fault in faults:
        if fault.kind in ("reboot", "stuck", "slip", "heat", "supply", "blackout"):
            events.append((fault.start, fault, True))
            if np.isfinite(fault.stop):
                events.append((fault.stop, fault, False))
    return sorted(events, key=lambda event: event[0])
