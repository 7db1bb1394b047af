"""The control table of one emulated servo: bytes, and the rules for reading and writing them."""

from collections.abc import Sequence

from hardware.protocol import BAD_LENGTH, BAD_LIMIT, BAD_RANGE, NO_ACCESS
from hardware.tables import FIRST_RAM, Register, ServoType

PRESENT, PRESENT_END = 120, 147
FIRST_POINTED = 128  # no table points elsewhere below
SINGLE_TURN, SOFT = 3, 5  # operating modes: position, current-based position
GAINS = (
    *("velocity_i_gain", "velocity_p_gain", "position_d_gain", "position_i_gain"),
    *("position_p_gain", "feedforward_2nd_gain", "feedforward_1st_gain"),
)
PROFILE = ("profile_acceleration", "profile_velocity")
DRIVE_MODES = 0b1101  # bits that a servo without a second one at its joint has
STARTS_POWERED, RESTORES_RAM = 1, 2  # bits of the startup configuration


class ControlTable:
    """The registers of one servo.

    Writing checks what a servo checks: read-only registers, EEPROM under torque, whole registers,
    ranges, and limits that other registers set. Indirect data registers read and write where their
    indirect addresses point.

    Args:
        kind: the servo's type.
        values: registers that differ from the factory's.
    """

    def __init__(self, kind: ServoType, values: dict[str, int]) -> None:
        self.kind = kind
        self.data = bytearray(max(r.address + r.size for r in kind.registers.values()))
        self._by_address = {r.address: r for r in kind.registers.values()}
        self._indirect = _indirect_map(kind)
        self._backup: bytes | None = None
        self.factory(keep=())
        for name, value in values.items():
            self[name] = value
        self.restart()
        for name, value in values.items():
            self[name] = value

    def factory(self, keep: tuple[str, ...]) -> None:
        """Put every register back to the factory's value, but those of these names."""
        kept = {name: self[name] for name in keep}
        self.data[:] = bytes(len(self.data))
        for name, value in {**self.kind.defaults, **kept}.items():
            self[name] = value
        self.restart()

    def restart(self) -> None:
        """Start as with a new supply: the EEPROM stays, the RAM is as its startup register says."""
        self.data[FIRST_RAM:] = bytes(len(self.data) - FIRST_RAM)
        self["model_number"] = self.kind.number
        self["firmware_version"] = self.kind.firmware
        for name, value in self.kind.defaults.items():
            if not self.kind.registers[name].eeprom:
                self[name] = value
        self._free_goals()
        for i in range(1, self.kind.indirect + 1):
            address = self.kind.registers[f"indirect_data_{i}"].address
            self[f"indirect_address_{i}"] = address
        if "startup_configuration" in self.kind.registers:
            self["backup_ready"] = int(self._backup is not None)
            self["torque_enable"] = self["startup_configuration"] & STARTS_POWERED
            if self["startup_configuration"] & RESTORES_RAM:
                self._restore(GAINS + PROFILE + tuple(self._pointers()))

    def _pointers(self) -> list[str]:
        return [f"indirect_address_{i}" for i in range(1, self.kind.indirect + 1)]

    def _free_goals(self) -> None:
        """Let goal current and PWM be as large as their limits."""
        if "goal_current" in self.kind.registers:
            self["goal_current"] = self["current_limit"]
        self["goal_pwm"] = self["pwm_limit"]

    def switch_mode(self) -> None:
        """Reset what a new operating mode resets: gains, profile, goal current and goal PWM."""
        for name in GAINS:
            self[name] = self.kind.defaults.get(name, 0)
        for name in PROFILE:
            self[name] = 0
        if self["operating_mode"] == SOFT:
            self["pwm_limit"] = self.kind.defaults["pwm_limit"]
        self._free_goals()

    def back_up(self) -> None:
        """Keep a copy of the control table, which outlives reboots and factory resets."""
        self["backup_ready"] = 1
        self._backup = bytes(self.data)

    def restore_eeprom(self) -> bool:
        """Take the EEPROM back from the copy, and say whether there was one."""
        names = [r.name for r in self.kind.registers.values() if r.eeprom]
        return self._restore(names)

    def _restore(self, names: Sequence[str]) -> bool:
        if self._backup is None:
            return False
        for register in map(self.kind.registers.__getitem__, names):
            place = slice(register.address, register.address + register.size)
            self.data[place] = self._backup[place]
        return True

    def __getitem__(self, name: str) -> int:
        register = self.kind.registers[name]
        start = register.address
        return int.from_bytes(
            self.data[start : start + register.size], "little", signed=register.signed
        )

    def __setitem__(self, name: str, value: int) -> None:
        register = self.kind.registers[name]
        end = register.address + register.size
        self.data[register.address : end] = register.encode(value)

    def places(self, address: int, size: int) -> Sequence[int]:
        """Return where the bytes from this address on are: indirect data is elsewhere."""
        span = range(address, address + size)
        if not self._indirect or span.stop <= FIRST_POINTED:
            return span
        return [self._target(a) for a in span]

    def read(self, address: int, size: int) -> bytes | None:
        """Return bytes from the address on, or None beyond the table's end."""
        if size < 1 or address + size > len(self.data):
            return None
        if not self._indirect or address + size <= FIRST_POINTED:
            return bytes(self.data[address : address + size])
        return bytes(self.data[place] for place in self.places(address, size))

    def refusal(self, places: Sequence[int], data: bytes, torque: bool) -> int:
        """Return 0 if these bytes may be written there now, else the error number of the answer."""
        i = 0
        while i < len(data):
            register = self._by_address.get(places[i])
            if register is None or not register.writable or (torque and register.eeprom):
                return NO_ACCESS
            last = i + register.size - 1
            if last >= len(data) or places[last] != places[i] + register.size - 1:
                return BAD_LENGTH
            error = self._excess(register, register.decode(data[i : last + 1]))
            if error:
                return error
            i = last + 1
        return 0 if data else NO_ACCESS

    def write(self, places: Sequence[int], data: bytes) -> None:
        """Write bytes that `refusal` let pass."""
        if isinstance(places, range):
            self.data[places.start : places.stop] = data
        else:
            for place, byte in zip(places, data, strict=True):
                self.data[place] = byte

    def _target(self, address: int) -> int:
        """Where an indirect data byte points; other addresses are themselves."""
        source = self._indirect.get(address)
        if source is None:
            return address
        target = int.from_bytes(self.data[source : source + 2], "little")
        return target if target < len(self.data) and target not in self._indirect else address

    def _excess(self, register: Register, value: int) -> int:
        """Return the error of a value beyond its fixed range, or beyond a limit in a register."""
        if register.name == "operating_mode":
            return 0 if value in self.kind.modes else BAD_RANGE
        low, high = register.low, register.high
        if register.name.startswith("indirect_address"):
            low, high = FIRST_RAM, len(self.data) - 1
        if register.name == "bus_watchdog" and self["bus_watchdog"] < 0:
            high = 0  # one that tripped is cleared before it watches again
        if register.name == "drive_mode" and value & ~DRIVE_MODES:
            return BAD_RANGE
        if register.name == "goal_position" and self["operating_mode"] == SINGLE_TURN:
            low, high = "min_position_limit", "max_position_limit"
        if low is not None and value < self._bound(low):
            return BAD_LIMIT if isinstance(low, str) else BAD_RANGE
        if high is not None and value > self._bound(high):
            return BAD_LIMIT if isinstance(high, str) else BAD_RANGE
        return 0

    def _bound(self, bound: int | str) -> int:
        if not isinstance(bound, str):
            return bound
        return -self[bound[1:]] if bound.startswith("-") else self[bound]


def _indirect_map(kind: ServoType) -> dict[int, int]:
    """Return {address of an indirect data byte: address of its indirect address}."""
    return {
        kind.registers[f"indirect_data_{i}"].address: kind.registers[
            f"indirect_address_{i}"
        ].address
        for i in range(1, kind.indirect + 1)
    }
