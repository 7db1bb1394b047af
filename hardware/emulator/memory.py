"""The control table of one emulated servo: bytes, and the rules for reading and writing them."""

from __future__ import annotations

from hardware.protocol import BAD_RANGE, NO_ACCESS
from hardware.tables import FIRST_RAM, Register, ServoType

PRESENT, PRESENT_END = 120, 147


class Memory:
    """The registers of one servo.

    Writing checks what a servo checks: read-only registers, EEPROM under torque, and ranges.
    Indirect data registers read and write where their indirect addresses point.

    Args:
        kind: the servo's type.
        values: registers that differ from the factory's.
    """

    def __init__(self, kind: ServoType, values: dict[str, int]) -> None:
        self.kind = kind
        size = max(r.address + r.size for r in kind.registers.values())
        self.data = bytearray(size)
        self._by_address = {r.address: r for r in kind.registers.values()}
        self._writable = bytearray(size)
        for register in kind.registers.values():
            end = register.address + register.size
            self._writable[register.address : end] = bytes([register.writable]) * register.size
        self._indirect = _indirect_map(kind)
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
        """Forget the RAM as a power cycle does; the EEPROM stays."""
        self.data[FIRST_RAM:] = bytes(len(self.data) - FIRST_RAM)
        self["model_number"] = self.kind.number
        self["firmware_version"] = self.kind.firmware
        for name, value in self.kind.defaults.items():
            if not self.kind.registers[name].eeprom:
                self[name] = value
        if "goal_current" in self.kind.registers:
            self["goal_current"] = self["current_limit"]
        self["goal_pwm"] = self["pwm_limit"]
        for i in range(1, self.kind.indirect + 1):
            address = self.kind.registers[f"indirect_data_{i}"].address
            self[f"indirect_address_{i}"] = address

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

    def read(self, address: int, size: int) -> bytes | None:
        """Return bytes from the address on, or None beyond the table's end."""
        if size < 1 or address + size > len(self.data):
            return None
        if not self._indirect or address + size <= FIRST_RAM * 2:
            return bytes(self.data[address : address + size])
        return bytes(self.data[self._target(a)] for a in range(address, address + size))

    def refusal(self, address: int, data: bytes, torque: bool) -> int:
        """Return 0 if these bytes may be written here now, else the error number of the answer."""
        end = address + len(data)
        if not data or end > len(self.data):
            return NO_ACCESS
        if torque and address < FIRST_RAM:
            return NO_ACCESS
        targets = [self._target(a) for a in range(address, end)] if end > 2 * FIRST_RAM else None
        if targets is None:
            if not all(self._writable[address:end]):
                return NO_ACCESS
        elif not all(self._writable[t] for t in targets) or (torque and min(targets) < FIRST_RAM):
            return NO_ACCESS
        for register, part in self._whole_registers(address, data, targets):
            if not self._in_range(register, register.decode(part)):
                return BAD_RANGE
        return 0

    def write(self, address: int, data: bytes) -> set[int]:
        """Write bytes that `refusal` let pass, and return the addresses that changed hands."""
        end = address + len(data)
        if end <= 2 * FIRST_RAM:
            self.data[address:end] = data
            return set(range(address, end))
        targets = [self._target(a) for a in range(address, end)]
        for target, byte in zip(targets, data, strict=True):
            self.data[target] = byte
        return set(targets)

    def _target(self, address: int) -> int:
        """Where an indirect data byte points; other addresses are themselves."""
        source = self._indirect.get(address)
        if source is None:
            return address
        target = int.from_bytes(self.data[source : source + 2], "little")
        return target if target < len(self.data) and target not in self._indirect else address

    def _whole_registers(
        self, address: int, data: bytes, targets: list[int] | None
    ) -> list[tuple[Register, bytes]]:
        found, i = [], 0
        while i < len(data):
            place = targets[i] if targets else address + i
            register = self._by_address.get(place)
            size = register.size if register else 1
            if register and i + size <= len(data):
                found.append((register, data[i : i + size]))
            i += size
        return found

    def _in_range(self, register: Register, value: int) -> bool:
        if register.name == "goal_position":
            if self["operating_mode"] != 3:
                return True
            return self["min_position_limit"] <= value <= self["max_position_limit"]
        if register.name == "operating_mode":
            return value in self.kind.modes
        low, high = self._bound(register.low), self._bound(register.high)
        return (low is None or value >= low) and (high is None or value <= high)

    def _bound(self, bound: int | str | None) -> int | None:
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
