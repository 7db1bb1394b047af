"""One servo on the emulated bus: what it answers to an instruction.

Assumed, as no maker publishes them: how near counts as in position, how far as not following, and
how long a servo is silent while it reboots.
"""

import struct
from collections import deque
from collections.abc import Sequence

from hardware import protocol
from hardware.emulator.control import POSITION_MODES
from hardware.emulator.firmware import Firmware
from hardware.emulator.memory import PRESENT, PRESENT_END, ControlTable
from hardware.tables import FIRST_RAM

REBOOT_SILENCE = 0.2  # s, an assumption
ARRIVED = 20  # counts between goal and position that are none, as in the makers' examples
ASTRAY = 100  # counts behind its trajectory at which a servo does not follow it
OPERATING_MODE, TORQUE_ENABLE, WATCHDOG = 11, 64, 98
GOALS, GOALS_END = 100, 120
GOAL_VELOCITY = 104
GOAL_POSITION = range(116, 120)
GOAL_VALUES = frozenset((*range(100, 108), *GOAL_POSITION))  # without the profile
FAST_FIRMWARE = 45  # older firmware leaves fast reads unanswered
CLEAR_TURNS = bytes([0x01, 0x44, 0x58, 0x4C, 0x22])
BACK_UP, RESTORE = bytes([0x01, 0x43, 0x54, 0x52, 0x4C]), bytes([0x02, 0x43, 0x54, 0x52, 0x4C])
TOGETHER = (protocol.WRITE, protocol.REG_WRITE, protocol.ACTION, protocol.REBOOT, protocol.CLEAR)
Answer = tuple[int, bytes]  # error, parameters


class Servo:
    """A servo's side of the protocol.

    Args:
        index: its place among the firmware's servos.
        memory: its control table.
        firmware: all servos' control loops.
    """

    def __init__(self, index: int, memory: ControlTable, firmware: Firmware) -> None:
        self.index, self.memory, self._firmware = index, memory, firmware
        self.silent_until = 0.0
        self.heard = 0.0  # s, when an instruction last came
        # delayed goals: when due, registers, and which of them were written
        self.pending: deque[tuple[float, bytes, Sequence[int]]] = deque()
        self._reshaped = False  # a profile was written that shapes no goal yet
        self._registered: tuple[int, bytes] | None = None

    @property
    def id(self) -> int:
        """Its number on the bus."""
        return self.memory.data[7]

    @property
    def second_id(self) -> int:
        """The number of its group, which it obeys in silence; above 252 it has none."""
        return self.memory.data[12]

    @property
    def baud(self) -> int:
        """The bits a second that it understands."""
        bauds = self.memory.kind.bauds
        return bauds[self.memory.data[8] % len(bauds)]

    @property
    def return_delay(self) -> float:
        """How long it waits before it answers [s]."""
        return self.memory.data[9] * self.memory.kind.units.return_delay

    @property
    def fast(self) -> bool:
        """Whether it answers fast reads."""
        return self.memory.data[6] >= FAST_FIRMWARE

    def answers(self, instruction: int) -> bool:
        """Say whether its status return level lets it answer this instruction."""
        level = self.memory["status_return_level"]
        if instruction == protocol.PING:
            return True
        reads = (protocol.READ, protocol.SYNC_READ, protocol.BULK_READ)
        fast = (protocol.FAST_SYNC_READ, protocol.FAST_BULK_READ)
        return level >= (1 if instruction in reads + fast else 2)

    def flagged(self, error: int) -> int:
        """Return the error byte: with the alert bit while a hardware error is latched."""
        return error | (protocol.ALERT if self._firmware.errors[self.index] else 0)

    def execute(self, instruction: int, params: bytes, now: float) -> Answer:
        """Carry out an instruction and return what it answers."""
        self.heard = now
        match instruction:
            case protocol.PING:
                data = self.memory.data
                return 0, bytes([data[0], data[1], data[6]])
            case protocol.READ if len(params) == 4:
                return self.read(*struct.unpack("<HH", params))
            case protocol.WRITE if len(params) > 2:
                return self.write(int.from_bytes(params[:2], "little"), params[2:], now), b""
            case protocol.REG_WRITE if len(params) > 2:
                return self._register(int.from_bytes(params[:2], "little"), params[2:]), b""
            case protocol.ACTION:
                return self._act(now), b""
            case protocol.REBOOT:
                self.reboot(now)
                return 0, b""
            case protocol.FACTORY_RESET if len(params) == 1:
                return self._factory(params[0], now), b""
            case protocol.CLEAR if params == CLEAR_TURNS:
                return self._clear(), b""
            case protocol.BACKUP if "backup_ready" in self.memory.kind.registers:
                return self._backup(params, now), b""
            case protocol.READ | protocol.WRITE | protocol.REG_WRITE | protocol.FACTORY_RESET:
                return protocol.BAD_LENGTH, b""
            case protocol.CLEAR:
                return protocol.BAD_RANGE, b""
        return protocol.UNKNOWN_INSTRUCTION, b""

    def read(self, address: int, size: int) -> Answer:
        """Return registers as they are now."""
        if (address < PRESENT_END and address + size > PRESENT) or address + size > PRESENT_END:
            self._refresh()
        data = self.memory.read(address, size)
        return (protocol.NO_ACCESS, b"") if data is None else (0, data)

    def obey(self, instruction: int, params: bytes, now: float) -> None:
        """Carry out an instruction to its group, which cannot change the EEPROM, in silence."""
        writes = instruction in (protocol.WRITE, protocol.REG_WRITE)
        address = int.from_bytes(params[:2], "little")
        if instruction in TOGETHER and not (writes and address < FIRST_RAM):
            self.execute(instruction, params, now)

    def write(self, address: int, data: bytes, now: float) -> int:
        """Write registers if that is allowed, and return the error number."""
        i, memory, firmware = self.index, self.memory, self._firmware
        if address + len(data) > len(memory.data):
            return protocol.NO_ACCESS
        places = memory.places(address, len(data))
        error = memory.refusal(places, data, bool(firmware.torque_on[i]))
        if error:
            return error
        if memory.data[WATCHDOG] > 127 and not GOAL_VALUES.isdisjoint(places):
            return protocol.BAD_RANGE
        if firmware.errors[i] and TORQUE_ENABLE in places:
            return 0  # a servo that shut itself down ignores it
        mode = memory.data[OPERATING_MODE]
        memory.write(places, data)
        if memory.data[OPERATING_MODE] != mode:
            firmware.switch_mode(i)
        if memory.data[10] & 8 and not GOAL_VALUES.isdisjoint(places):
            memory["torque_enable"] = 0 if firmware.errors[i] else 1
            firmware.load(i)
        self._take(places, now)
        return 0

    def _take(self, places: Sequence[int], now: float) -> None:
        """Let the firmware have what was written; a profile waits for the next goal."""
        firmware, goals = self._firmware, [GOALS <= place < GOALS_END for place in places]
        if not GOAL_VALUES.isdisjoint(places):
            delay = firmware.hidden.robot["command_delay"]
            shaped = self._reshaped or self.memory.data[10] & 4
            if delay > 0:
                goal = bytes(self.memory.data[GOALS:GOALS_END])
                self.pending.append((now + delay, goal, places))
            elif places == GOAL_POSITION and not shaped:
                firmware.set_goal(self.index, self.memory["goal_position"])
            else:
                self._load_goals(places)
            self._reshaped = self._reshaped and GOAL_POSITION[0] not in places
        elif any(goals):
            self._reshaped = True
        if not all(goals):
            firmware.load(self.index)

    def _load_goals(self, places: Sequence[int]) -> None:
        """Let the firmware have the goals of these registers, each with the profile to it."""
        position, velocity = GOAL_POSITION[0] in places, GOAL_VELOCITY in places
        self._firmware.load_goals(self.index, position, velocity)

    def apply_due(self, now: float) -> None:
        """Let the firmware have the delayed goals whose time has come."""
        while self.pending and self.pending[0][0] <= now:
            _, goals, places = self.pending.popleft()
            data = self.memory.data
            newest = bytes(data[GOALS:GOALS_END])
            data[GOALS:GOALS_END] = goals
            self._load_goals(places)
            data[GOALS:GOALS_END] = newest

    def _register(self, address: int, data: bytes) -> int:
        if address + len(data) > len(self.memory.data):
            return protocol.NO_ACCESS
        torque = bool(self._firmware.torque_on[self.index])
        error = self.memory.refusal(self.memory.places(address, len(data)), data, torque)
        if not error:
            self._registered = (address, data)
            self.memory["registered_instruction"] = 1
        return error

    def _act(self, now: float) -> int:
        if self._registered is None:
            return protocol.UNKNOWN_INSTRUCTION
        address, data = self._registered
        self._registered = None
        self.memory["registered_instruction"] = 0
        return self.write(address, data, now)

    def reboot(self, now: float) -> None:
        """Reboot: RAM reset, torque off, errors cleared, silent for a while."""
        self.memory.restart()
        self._registered = None
        self.pending.clear()
        self._firmware.boot(self.index)
        self.silent_until = now + REBOOT_SILENCE

    def _factory(self, mode: int, now: float) -> int:
        keep = {0xFF: (), 0x01: ("id",), 0x02: ("id", "baud_rate")}.get(mode)
        if keep is None:
            return protocol.BAD_RANGE
        self.memory.factory(keep)
        self.reboot(now)
        return 0

    def _clear(self) -> int:
        """Bring the present position back into one turn, if the servo stands."""
        velocity = float(self._firmware.present()[1][self.index])
        if self._turns(velocity) or self._firmware.moving(self.index):
            return protocol.FAIL
        self._firmware.forget_turns(self.index)
        return 0

    def _backup(self, params: bytes, now: float) -> int:
        """Keep a copy of the control table, or restore the EEPROM from it and reboot."""
        if params not in (BACK_UP, RESTORE):
            return protocol.BAD_RANGE
        if self._firmware.torque_on[self.index]:
            return protocol.FAIL
        if params == BACK_UP:
            self.memory.back_up()
        elif self.memory.restore_eeprom():
            self.reboot(now)
        else:
            return protocol.FAIL
        return 0

    def watch(self, now: float) -> None:
        """Trip the bus watchdog if nothing was heard for as long as it allows."""
        steps = self.memory.data[WATCHDOG]
        if 0 < steps < 128 and self._firmware.torque_on[self.index]:
            allowed = steps * self.memory.kind.units.watchdog
            if now - self.heard > allowed:
                self.memory["bus_watchdog"] = -1
                self.pending.clear()
                self._firmware.stop(self.index)

    def _turns(self, velocity: float) -> bool:
        """Say whether this velocity [rad/s] is a motion."""
        slow = self.memory["moving_threshold"] * self.memory.kind.units.velocity
        return bool(abs(velocity) > slow)

    def _moving_status(self, count: float, way: float, ongoing: bool) -> int:
        """The bits of moving status, for a position and a trajectory [counts]."""
        i, firmware = self.index, self._firmware
        status = int(firmware.shape[i]) | ongoing << 1
        if firmware.control.mode[i] in POSITION_MODES:
            status |= bool(abs(firmware.goal[i] - count) <= ARRIVED)
            status |= bool(abs(way - count) > ASTRAY and firmware.torque_on[i]) << 3
        return status

    def _refresh(self) -> None:
        """Write what the firmware knows into the present registers."""
        i, firmware = self.index, self._firmware
        kind = self.memory.kind
        units = kind.units
        count, velocity, pwm, current = (values[i] for values in firmware.present())
        way, speed = (values[i] for values in firmware.trajectory)
        load = pwm / units.full_pwm * 1000
        amps = load if kind.current is None else current / kind.current
        ongoing = firmware.moving(i)
        self.memory.data[PRESENT:PRESENT_END] = struct.pack(
            "<HBBhhiiiiHB",
            int(firmware.ticks - firmware.born[i]) % 32768,
            int(ongoing or self._turns(velocity)),
            self._moving_status(count, way, ongoing),
            _fit(pwm, 16),
            _fit(amps, 16),
            _fit(velocity / units.velocity, 32),
            _fit(count, 32),
            _fit(speed * units.angle / units.velocity, 32),
            _fit(way, 32),
            round(firmware.supply[i] / units.voltage),
            min(max(round(firmware.temperature[i]), 0), 255),
        )


def _fit(value: float, bits: int) -> int:
    most = (1 << (bits - 1)) - 1
    return min(max(round(float(value)), -most - 1), most)
