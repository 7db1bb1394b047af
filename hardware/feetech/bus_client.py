"""The host's end of a Feetech bus: the requests of `hardware/bus_client.py` in Feetech's packets.

    client = FeetechClient(port, clock, latency=0.001)
    client.open(1_000_000)
    client.sync_read(56, 15, [1, 2, 3, 4, 5, 6])        # {1: Reply(error=0, alert=False, ...), ...}

There are no fast reads, no reboot, and no answer's number: an old answer is told from a new one by
forgetting what had come before a request, and by waiting for late answers after a failure.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from hardware.bus_client import BusClient, Reply
from hardware.errors import LineError
from hardware.feetech import protocol
from hardware.protocol import BROADCAST, Packet

MODEL, FIRMWARE = 3, 0  # registers
LAST_ID = 253


class FeetechClient(BusClient):
    """Requests and answers over one port; see `BusClient`."""

    overhead = 6

    def _make_parser(self) -> protocol.Parser:
        return protocol.Parser()

    def _send(self, number: int, instruction: int, body: bytes) -> int:
        data = protocol.packet(number, instruction, body)
        self.port.clearPort()
        sent = self.port.writePort(data)
        if sent != len(data):
            raise LineError(f"{self.port.port_name}: {sent} of {len(data)} bytes could be sent")
        return len(data)

    def ping(self, number: int) -> list[Reply]:
        """Return the answers to a ping: one, none, or several from servos that share the ID.

        Their data are as a Dynamixel's: model number (2 bytes) and firmware.
        """
        packets = self._ask(number, protocol.PING, b"", [(number, 0)], to_the_end=True)
        if not packets:
            return []
        known = self._identity(number)
        return [Reply(0, packet.alert, known) for packet in packets]

    def _identity(self, number: int) -> bytes:
        reply = self.read(number, FIRMWARE, 5)
        if reply is None:
            return struct.pack("<HB", 0, 0)
        return reply.data[3:5] + reply.data[:1]

    def broadcast_ping(self) -> dict[int, tuple[int, int]]:
        """Return {ID: (model number, firmware)} of every servo that hears this speed."""
        sizes = [(number, 0) for number in range(LAST_ID + 1)]
        packets = self._ask(BROADCAST, protocol.PING, b"", sizes, to_the_end=True)
        numbers = [packet.id for packet in packets]
        return {n: struct.unpack("<HB", self._identity(n)) for n in numbers}

    def read(self, number: int, address: int, size: int) -> Reply | None:
        """Read registers of one servo; None if no good answer came."""
        packets = self._ask(number, protocol.READ, bytes([address, size]), [(number, size)])
        return _reply(packets[0]) if packets else None

    def write(self, number: int, address: int, data: bytes) -> Reply | None:
        """Write registers of one servo; None if no good answer came."""
        body = bytes([address]) + data
        packets = self._ask(number, protocol.WRITE, body, [(number, 0)])
        return _reply(packets[0]) if packets else None

    def write_all(self, address: int, data: bytes) -> None:
        """Write registers of every servo at once; nobody answers."""
        self._ask(BROADCAST, protocol.WRITE, bytes([address]) + data, [])

    def reboot(self, number: int) -> Reply | None:
        """Refuse: these servos start anew only with their supply.

        Raises:
            LineError: always.
        """
        raise LineError(f"servo {number} cannot be rebooted over the bus; switch its supply")

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> None:
        """Write the same registers of several servos; nobody answers."""
        size = len(next(iter(values.values())))
        entries = b"".join(bytes([number]) + data for number, data in values.items())
        self._ask(BROADCAST, protocol.SYNC_WRITE, bytes([address, size]) + entries, [])

    def sync_read(
        self, address: int, size: int, numbers: Sequence[int], fast: bool = False
    ) -> dict[int, Reply]:
        """Read the same registers of several servos; those without a good answer are left out."""
        body = bytes([address, size]) + bytes(numbers)
        wanted = [(number, size) for number in numbers]
        packets = self._ask(BROADCAST, protocol.SYNC_READ, body, wanted)
        return {packet.id: _reply(packet) for packet in packets}


def _reply(packet: Packet) -> Reply:
    return Reply(0, packet.alert, packet.params[1:])
