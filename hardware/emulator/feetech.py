"""A Feetech bus that is not there: STS servos with the physics and firmware of the emulator.

    world = EmulatedRobot(load_robot("so101"))    # inner servos, see `feetech_inner.py`
    FeetechBus(world).feed(packet(1, PING), now=0.0, baud=1_000_000)

Inside, each servo is one of the emulator's own with the motor, gains and units of a Feetech one;
`FeetechServo` is what a client sees of it: Feetech's registers, signs and limits, a homing offset
that is taken off, goals clamped to the servo's own limits, EEPROM that is kept only while `lock`
is 0.

Assumed, as the maker does not publish it: answers of 50 us after the return delay, the derivative
and integral gains do nothing at their factory values, torque that is switched on holds where it is,
a shutdown is latched until torque is switched off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from hardware.config import Robot
from hardware.emulator.bus import TURN_ROUND, Arrival, Bus, Steps
from hardware.emulator.feetech_inner import LARGEST_PWM, InnerServo
from hardware.emulator.firmware import Firmware
from hardware.emulator.servo import Servo as Core
from hardware.emulator.world import EmulatedRobot
from hardware.feetech import protocol
from hardware.protocol import BROADCAST, Packet
from hardware.tables import servo_type

# Feetech's register -> the inner one, value for value
SAME = {
    "return_delay_time": "return_delay_time",
    "temperature_limit": "temperature_limit",
    "max_voltage_limit": "max_voltage_limit",
    "min_voltage_limit": "min_voltage_limit",
    "shutdown": "shutdown",
    "position_p_gain": "position_p_gain",
    "torque_enable": "torque_enable",
    "profile_velocity": "profile_velocity",
    "profile_acceleration": "profile_acceleration",
}


class FeetechServo:
    """Feetech's side of one inner servo.

    Args:
        servo: the robot's servo.
        core: the inner one.
        firmware: all servos' control loops.
        baud: the bus's speed [bits/s].
    """

    def __init__(self, servo: InnerServo, core: Core, firmware: Firmware, baud: int) -> None:
        self.kind = servo_type(servo.model)
        self.core, self._firmware = core, firmware
        registers = self.kind.registers
        self.data = bytearray(max(r.address + r.size for r in registers.values()))
        self._fixed = bytearray(len(self.data))
        for register in registers.values():
            end = register.address + register.size
            self._fixed[register.address : end] = bytes([not register.writable]) * register.size
        delay = round(core.return_delay / self.kind.units.return_delay)
        as_set_up = {"id": servo.id, "baud_rate": self.kind.bauds.index(baud)}
        as_set_up["return_delay_time"] = delay
        values = {**self.kind.defaults, **as_set_up, **servo.settings}
        for name, value in {"model_number": self.kind.number, **values}.items():
            self[name] = value
        self._kept = bytes(self.data[: self._ram])
        self._born = -1
        self._turn = 0.0  # counts between what is reported and the inner count

    def __getitem__(self, name: str) -> int:
        register = self.kind.registers[name]
        return register.decode(self.data[register.address :])

    def __setitem__(self, name: str, value: int) -> None:
        register = self.kind.registers[name]
        end = register.address + register.size
        self.data[register.address : end] = register.encode(value)

    @property
    def _ram(self) -> int:
        return self.kind.registers["id"].first_ram

    @property
    def baud(self) -> int:
        """The bits a second that it understands."""
        return self.kind.bauds[self["baud_rate"] % len(self.kind.bauds)]

    @property
    def return_delay(self) -> float:
        """How long it waits before it answers [s]."""
        return self["return_delay_time"] * self.kind.units.return_delay

    @property
    def errors(self) -> int:
        """The bits of its hardware errors."""
        return int(self._firmware.errors[self.core.index])

    def wake(self) -> None:
        """Begin anew if the inner servo has: EEPROM as it was kept, RAM as from the factory."""
        born = int(self._firmware.born[self.core.index])
        if born == self._born:
            return
        self._born = born
        self.data[:] = bytes(self._kept).ljust(len(self.data), b"\0")
        for name, value in self.kind.defaults.items():
            if not self.kind.registers[name].eeprom:
                self[name] = value
        self["torque_limit"] = self["max_torque"]
        self._count_turn()
        self["goal_position"] = self._reported()
        for name in SAME:
            self._hand_on(name, 0.0)
        self._limit(0.0)

    def _count_turn(self) -> None:
        """Choose whole turns so that what is reported lies within one."""
        count = self._firmware.present()[0][self.core.index] - self["homing_offset"]
        self._turn = -4096.0 * math.floor(count / 4096)

    def _reported(self) -> int:
        count = self._firmware.present()[0][self.core.index]
        return int(count - self["homing_offset"] + self._turn) % 4096

    def read(self, address: int, size: int) -> bytes:
        """Return registers as they are now; beyond the table there are zeros."""
        self.wake()
        i, firmware, units = self.core.index, self._firmware, self.kind.units
        _, velocity, pwm, current = (values[i] for values in firmware.present())
        assert self.kind.current is not None
        self["present_position"] = self._reported()
        self["present_velocity"] = round(velocity / units.velocity)
        self["present_pwm"] = round(pwm)
        self["present_current"] = round(current / self.kind.current)
        self["present_input_voltage"] = round(firmware.supply[i] / units.voltage)
        self["present_temperature"] = round(firmware.temperature[i])
        self["hardware_error_status"] = self.errors
        self["moving"] = int(abs(velocity) / units.velocity > 1 or firmware.moving(i))
        if not firmware.torque_on[i]:
            self["torque_enable"] = 0
        return bytes(self.data[address : address + size]).ljust(size, b"\0")

    def write(self, address: int, data: bytes, now: float) -> None:
        """Write registers; what can only be read stays, and nothing is ever refused."""
        self.wake()
        end = min(address + len(data), len(self.data))
        for place in range(address, end):
            if not self._fixed[place]:
                self.data[place] = data[place - address]
        touched = [
            name for name, r in self.kind.registers.items() if address < r.address + r.size <= end
        ]
        if self["lock"] == 0:
            self._kept = bytes(self.data[: self._ram])
        if "homing_offset" in touched:
            self._count_turn()
        if "torque_limit" in touched or "max_torque" in touched:
            self._limit(now)
        if "torque_enable" in touched and self["torque_enable"] and not self._powered:
            self._aim(self._reported(), now)
        for name in touched:
            if name in SAME:
                self._hand_on(name, now)
        if "goal_position" in touched:
            self._aim(self["goal_position"], now)

    @property
    def _powered(self) -> bool:
        return bool(self._firmware.torque_on[self.core.index])

    def _hand_on(self, name: str, now: float) -> None:
        """Write a register's value into the inner servo."""
        core, value = self.core, self[name]
        if name == "torque_enable" and not value and self.errors:
            self._firmware.errors[core.index] = 0  # switching off clears what was latched
            core.memory["hardware_error_status"] = 0
        if name == "return_delay_time" or core.memory.kind.registers[SAME[name]].eeprom:
            core.memory[SAME[name]] = value
            self._firmware.load(core.index)
            return
        register = core.memory.kind.registers[SAME[name]]
        core.write(register.address, register.encode(value), now)

    def _limit(self, now: float) -> None:
        """Let the torque limit bound the duty."""
        most = min(self["torque_limit"], self["max_torque"], LARGEST_PWM)
        register = self.core.memory.kind.registers["goal_pwm"]
        self.core.write(register.address, register.encode(most), now)

    def _aim(self, goal: int, now: float) -> None:
        """Hand a goal on, clamped to the servo's own limits, in the inner servo's counts."""
        goal = min(max(goal, self["min_position_limit"]), self["max_position_limit"])
        self["goal_position"] = goal
        register = self.core.memory.kind.registers["goal_position"]
        count = round(goal + self["homing_offset"] - self._turn)
        self.core.write(register.address, register.encode(count), now)


class FeetechBus(Bus):
    """The wire between a host and the Feetech servos of a world; see `Bus`.

    Args:
        world: a world with inner servos.
        part: the part of the world's robot whose servos are on this bus; None for all of them.
    """

    def __init__(self, world: EmulatedRobot, part: Robot | None = None) -> None:
        super().__init__(world, part)
        self._parser = protocol.Parser(answers=False)
        self.shells = []
        for servo, core in zip(self.part.servos, self._servos, strict=True):
            assert isinstance(servo, InnerServo)
            self.shells.append(FeetechServo(servo, core, world.firmware, self.part.bus.baud))

    def _handle(self, packet: Packet) -> Steps:
        if not packet.ok:
            return []
        if packet.instruction == protocol.SYNC_READ and len(packet.params) > 2:
            return (yield from self._read_in_turn(packet.params))
        return self._obey(packet)

    def _obey(self, packet: Packet) -> list[Arrival]:
        if packet.instruction == protocol.SYNC_WRITE and len(packet.params) > 2:
            return self._write_each(packet.params)
        answers = []
        for shell in sorted(self._listening(packet.id), key=lambda s: s["id"]):
            if self._lost():
                continue
            data = self._execute(shell, packet)
            silent = packet.id == BROADCAST and packet.instruction != protocol.PING
            if data is not None and not silent:
                number = shell["id"] if packet.id == BROADCAST else packet.id
                answers.append((shell, protocol.status(number, shell.errors, data)))
        return self._give(answers)

    def _execute(self, shell: FeetechServo, packet: Packet) -> bytes | None:
        """Let a servo carry out an instruction; return its answer's data, None for no answer."""
        shell.wake()
        match packet.instruction:
            case protocol.PING:
                return b""
            case protocol.READ if len(packet.params) == 2:
                return shell.read(*packet.params)
            case protocol.WRITE if len(packet.params) > 1:
                level = shell["status_return_level"]
                shell.write(packet.params[0], packet.params[1:], self._free)
                return b"" if level else None
        return None

    def _read_in_turn(self, params: bytes) -> Steps:
        """Answers of several servos, one after the other, each sampled as it starts."""
        address, size = params[:2]
        when, answers = self._free, []
        for number in params[2:]:
            shell = next(self._listening(number), None)
            if shell is None or self._lost():
                continue
            when += shell.return_delay + TURN_ROUND
            yield when
            answers.append(
                (shell, protocol.status(number, shell.errors, shell.read(address, size)))
            )
            when += len(answers[-1][1]) * self._byte
        return self._give(answers)

    def _write_each(self, params: bytes) -> list[Arrival]:
        address, size = params[:2]
        body = params[2 : 2 + (len(params) - 2) // (size + 1) * (size + 1)]
        for i in range(0, len(body), size + 1):
            for shell in self._listening(body[i]):
                if not self._lost():
                    shell.write(address, body[i + 1 : i + 1 + size], self._free)
        return []

    def _give(self, answers: list[tuple[FeetechServo, bytes]]) -> list[Arrival]:
        return self._send([(shell.core, data) for shell, data in answers])

    def _listening(self, number: int) -> Iterator[FeetechServo]:
        for shell in self.shells:
            called = number in (BROADCAST, shell["id"]) and shell.baud == self._baud
            if called and not self._world.is_silent(shell.core, self._free):
                yield shell
