r"""The registers, operating modes and instructions of an emulated Feetech servo.

    shell = FeetechServo(servo, core, firmware, baud=1_000_000)
    shell.write(42, b"\x00\x09", now=0.0)     # goal position 2304

Behind it is one of the emulator's own servos with the motor, gains and units of a Feetech one. The
shell keeps Feetech's registers, signs and limits, and the EEPROM that is stored while `lock` is 0.

    position 0  goals within the limits; a goal time, or else speed and acceleration, shape the way
    wheel 1     the speed of register 46                PWM 2   the duty of register 44
    step 3      goals count from the last goal, within the limits unless both are 0

Sources: Feetech's memory table of the STS series and its protocol manual. Measured on an STS3215 by
the authors of servolab 1.0.0: the homing offset is taken off in position mode only, a positive duty
turns towards smaller positions, a reset keeps the ID.

Assumed, as the maker does not publish it: the derivative and integral gains of the position loop do
nothing at their factory values, torque that is switched on holds where it is, a new operating mode
acts at once on the goals that its registers hold, a shutdown is latched until torque is switched
off.
"""

import math

from hardware.emulator.control import EXTENDED, VELOCITY
from hardware.emulator.control import PWM as DUTY
from hardware.emulator.feetech_inner import FASTEST, LARGEST_PWM, InnerServo
from hardware.emulator.firmware import Firmware
from hardware.emulator.servo import Servo as Core
from hardware.tables import servo_type

POSITION, WHEEL, PWM, STEP = range(4)
INNER_MODE = {POSITION: EXTENDED, WHEEL: VELOCITY, PWM: DUTY, STEP: EXTENDED}
DAMPING, CALIBRATE = 2, 128  # values of torque_enable, in addition to 0 and 1
TURN, MIDDLE, MOST_OFFSET = 4096, 2048, 2047  # counts
REBOOT_TIME = 0.8  # s, from the maker's protocol manual

# registers that the inner servo has too, value for value
SAME = (
    *("temperature_limit", "max_voltage_limit", "min_voltage_limit", "shutdown"),
    *("position_p_gain", "velocity_p_gain", "velocity_i_gain"),
)
LOADED = (*SAME, "return_delay_time", "max_torque", "homing_offset", "operating_mode")


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
        self._registered: tuple[int, bytes] | None = None

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

    @property
    def _index(self) -> int:
        return self.core.index

    @property
    def _mode(self) -> int:
        return self["operating_mode"]

    @property
    def _powered(self) -> bool:
        return bool(self._firmware.torque_on[self._index])

    @property
    def _offset(self) -> int:
        return self["homing_offset"] if self._mode == POSITION else 0

    def wake(self) -> None:
        """Restart if the inner servo has: EEPROM as it was kept, RAM as from the factory."""
        born = int(self._firmware.born[self._index])
        if born == self._born:
            return
        self._born, self._registered = born, None
        self.data[:] = bytes(self._kept).ljust(len(self.data), b"\0")
        for name, value in self.kind.defaults.items():
            if not self.kind.registers[name].eeprom:
                self[name] = value
        self["torque_limit"] = self["max_torque"]
        self._load(0.0)
        self["goal_position"] = self._reported()

    def _load(self, now: float) -> None:
        """Let the inner servo have all settings, and the operating mode."""
        core, mode = self.core, INNER_MODE.get(self._mode, EXTENDED)
        if self["torque_enable"] == DAMPING:
            mode = DUTY
        core.memory["return_delay_time"] = self["return_delay_time"]
        if core.memory["operating_mode"] != mode:
            core.memory["operating_mode"] = mode
            self._firmware.switch_mode(self._index)
        for name in SAME:
            core.memory[name] = self[name]
        self._firmware.load(self._index)
        self._count_turn()
        self._drive(now)

    def _count_turn(self) -> None:
        """Choose whole turns so that what is reported lies within one."""
        count = self._firmware.present()[0][self._index] - self._offset
        self._turn = -float(TURN) * math.floor(count / TURN)

    def _reported(self) -> int:
        count = self._firmware.present()[0][self._index]
        return int(count - self._offset + self._turn) % TURN

    def read(self, address: int, size: int) -> bytes:
        """Return registers as they are now; beyond the table there are zeros."""
        self.wake()
        i, firmware, units = self._index, self._firmware, self.kind.units
        _, velocity, pwm, current = (values[i] for values in firmware.present())
        assert self.kind.current is not None
        self["present_position"] = self._reported()
        self["present_velocity"] = round(velocity / units.velocity)
        self["present_pwm"] = round(pwm)
        self["present_current"] = round(current / self.kind.current)
        self["present_input_voltage"] = round(firmware.supply[i] / units.voltage)
        self["present_temperature"] = round(firmware.temperature[i])
        self["registered_instruction"] = int(self._registered is not None)
        self["hardware_error_status"] = self.errors
        self["moving"] = int(abs(velocity) / units.velocity > 1 or firmware.moving(i))
        if not firmware.torque_on[i]:
            self["torque_enable"] = 0
        return bytes(self.data[address : address + size]).ljust(size, b"\0")

    def write(self, address: int, data: bytes, now: float) -> None:
        """Write registers; what can only be read stays, and nothing is ever refused."""
        self.wake()
        torque = self["torque_enable"] if self._powered else 0
        end = min(address + len(data), len(self.data))
        for place in range(address, end):
            if not self._fixed[place]:
                self.data[place] = data[place - address]
        touched = {
            name for name, r in self.kind.registers.items() if address < r.address + r.size <= end
        }
        if "torque_enable" in touched and self["torque_enable"] == CALIBRATE:
            self["torque_enable"] = torque
            touched -= {"torque_enable"}
            self.calibrate(MIDDLE, now)
        if self["lock"] == 0:
            self._kept = bytes(self.data[: self._ram])
        if "torque_enable" in touched:
            self._switch(torque, now)
        if not touched.isdisjoint(LOADED):
            self._load(now)
        self._command(touched, now)

    def _switch(self, before: int, now: float) -> None:
        """Switch torque as its register says; before it said something else."""
        core, on = self.core, self["torque_enable"]
        if not on and self.errors:
            self._firmware.errors[core.index] = 0  # switching off clears what was latched
            core.memory["hardware_error_status"] = 0
        self._load(now)
        if on == 1 != before:
            self._hold(now)
        self._put("torque_enable", int(bool(on)), now)

    def _hold(self, now: float) -> None:
        """Let the goal be where the servo is, if it is a position."""
        if self._mode == POSITION:
            self._aim(self._reported(), now)
        elif self._mode == STEP:
            self._go(int(self._firmware.present()[0][self._index]), now)

    def _command(self, touched: set[str], now: float) -> None:
        """Act on the goals that were written, as the operating mode has it."""
        if touched & {"torque_limit", "goal_pwm"}:
            self._limit(now)
        if self._mode == WHEEL and touched & {"profile_velocity", "profile_acceleration"}:
            self._spin(now)
        if "goal_position" in touched and self._mode == POSITION:
            self._aim(self["goal_position"], now)
        if "goal_position" in touched and self._mode == STEP:
            self._step(self["goal_position"], now)

    def _drive(self, now: float) -> None:
        """Act on the goals that the registers hold, in a new operating mode or after a restart."""
        self._limit(now)
        if self._mode == WHEEL:
            self._spin(now)
        elif self._mode == POSITION and self._powered:
            self._aim(self["goal_position"], now)

    def _put(self, name: str, value: int, now: float) -> None:
        """Write a register of the inner servo."""
        register = self.core.memory.kind.registers[name]
        self.core.write(register.address, register.encode(value), now)

    def _limit(self, now: float) -> None:
        """Let the torque limit bound the duty, which in PWM mode is the goal."""
        most = min(self["torque_limit"], self["max_torque"], LARGEST_PWM)
        if self["torque_enable"] == DAMPING:
            most = 0
        elif self._mode == PWM:
            most = min(max(-self["goal_pwm"], -most), most)
        self._put("goal_pwm", most, now)

    def _spin(self, now: float) -> None:
        """Turn at the speed of the wheel mode."""
        self._put("profile_acceleration", self["profile_acceleration"], now)
        self._put("goal_velocity", self["profile_velocity"], now)

    def _aim(self, goal: int, now: float) -> None:
        """Hand a goal on, clamped to the servo's own limits, in the inner servo's counts."""
        self["goal_position"] = goal = int(self._clamped(goal))
        self._go(round(goal + self._offset - self._turn), now)

    def _step(self, steps: int, now: float) -> None:
        """Move the goal by counts."""
        goal = self.core.memory["goal_position"] + steps + self._turn
        self._go(round(self._clamped(goal) - self._turn), now)

    def _clamped(self, goal: float) -> float:
        """Return a goal within the limits; both are 0 for a servo of many turns."""
        low, high = self["min_position_limit"], self["max_position_limit"]
        return min(max(goal, low), high) if low or high else goal

    def _go(self, count: int, now: float) -> None:
        """Let the inner servo go to a count, in the goal time or by speed and acceleration."""
        speed, sharp = abs(self["profile_velocity"]), self["profile_acceleration"]
        place = self.kind.registers["goal_pwm"].address
        time = int.from_bytes(self.data[place : place + 2], "little")  # ms
        if time:
            way = abs(count - self._firmware.trajectory[0][self._index])
            speed, sharp = max(round(1000 * way / time), 1), 0
        elif sharp and not speed:
            speed = FASTEST
        for name, value in (("profile_acceleration", sharp), ("profile_velocity", speed)):
            if self.core.memory[name] != value:
                self._put(name, value, now)
        self._put("goal_position", count, now)

    def register(self, address: int, data: bytes) -> None:
        """Keep a write for the next action."""
        self._registered = (address, data)

    def act(self, now: float) -> None:
        """Carry out the write that was kept, if there is one."""
        if self._registered is not None:
            kept, self._registered = self._registered, None
            self.write(*kept, now)

    def calibrate(self, value: int, now: float) -> None:
        """Let the present position be a value [counts], by the homing offset, for good."""
        encoder, register = self._firmware.present()[0][self._index], "homing_offset"
        offset = (encoder - value + TURN // 2) % TURN - TURN // 2
        self[register] = int(min(max(offset, -MOST_OFFSET), MOST_OFFSET))
        first = self.kind.registers[register].address
        kept = bytearray(self._kept)
        kept[first : first + 2] = self.data[first : first + 2]
        self._kept = bytes(kept)
        self._count_turn()
        if self._powered:
            self._hold(now)

    def reset(self, now: float) -> None:
        """Take the EEPROM back from the factory, but for the ID, and switch torque off."""
        number = self["id"]
        self["torque_enable"] = 0
        self._switch(1, now)
        for name, register in self.kind.registers.items():
            if register.eeprom:
                self[name] = self.kind.defaults.get(name, 0)
        self["model_number"], self["id"] = self.kind.number, number
        self._kept = bytes(self.data[: self._ram])
        self._load(now)

    def reboot(self, now: float) -> None:
        """Restart, silent for a while."""
        self.core.reboot(now)
        self.core.silent_until = now + REBOOT_TIME
