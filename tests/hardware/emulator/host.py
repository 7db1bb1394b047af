"""A host that speaks to emulated servos in bytes."""

import struct

from hardware import protocol
from hardware.emulator.bus import Bus
from hardware.emulator.world import EmulatedRobot
from hardware.protocol import Packet, Parser, instruction_packet
from hardware.tables import ServoType

BAUD = 1_000_000


class Host:
    """Raw bytes to a world and its answers as packets, one after the other in time."""

    def __init__(self, world: EmulatedRobot) -> None:
        self.world, self.bus, self.time = world, Bus(world), 0.0

    def send(
        self, number: int, instruction: int, params: bytes = b"", wait: float = 0.005
    ) -> list[Packet]:
        """Send an instruction, wait [s], and return the packets that come back."""
        data = instruction_packet(number, instruction, params)
        arrivals = self.bus.feed(data, self.time, BAUD)
        self.time = max([self.time + wait, *(time for time, _ in arrivals)])
        return Parser().feed(b"".join(piece for _, piece in arrivals))

    def kind(self, number: int) -> ServoType:
        """Return the type of the servo of this ID."""
        return next(s.memory.kind for s in self.world.servos if s.id == number)

    def read(self, number: int, name: str) -> int:
        """Read a register by name."""
        register = self.kind(number).registers[name]
        request = struct.pack("<HH", register.address, register.size)
        (packet,) = self.send(number, protocol.READ, request)
        assert packet.error == 0
        return register.decode(packet.params[1:])

    def write(self, number: int, name: str, value: int) -> int:
        """Write a register by name and return the error of the answer."""
        register = self.kind(number).registers[name]
        body = struct.pack("<H", register.address) + register.encode(value)
        (packet,) = self.send(number, protocol.WRITE, body)
        return packet.error

    def set(self, **registers: int) -> None:
        """Write registers of servo 1 in this order; each is taken."""
        for name, value in registers.items():
            assert self.write(1, name, value) == 0, name

    def wait(self, seconds: float) -> None:
        """Say nothing for a while [s]."""
        self.time += seconds
        self.world.advance(self.time)


def put(world: EmulatedRobot, **registers: int) -> None:
    """Write registers of all servos by hand, in the order given."""
    for name, value in registers.items():
        for servo in world.servos:
            register = servo.memory.kind.registers[name]
            assert servo.write(register.address, register.encode(value), world.time) == 0
