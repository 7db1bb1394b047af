"""The host's end of a Feetech bus: the requests of `hardware/bus_client.py` in Feetech's packets.

    client = FeetechClient(port, clock, latency=0.001)
    client.open(1_000_000)
    client.sync_read(56, 15, [1, 2, 3], False)          # {1: Reply(error=0, alert=False, ...), ...}

There are no fast reads, no reboot, and no answer's number: an old answer is distinguished from a
new one by forgetting what had come before a request, and by waiting for late answers after a
failure.
"""

import struct
from collections.abc import Callable, Mapping, Sequence

from hardware.bus_client import BusClient, Reply
from hardware.errors import SerialPortError
from hardware.feetech import protocol
from hardware.protocol import BROADCAST, Packet

FIRMWARE = 0  # register; the model number is in 3
RETRIES = 3
LAST_ID = 253


class FeetechClient(BusClient):
    """Requests and answers over one port; see `BusClient`."""

    overhead = 6
    parser = protocol.Parser

    def _send(self, number: int, instruction: int, body: bytes) -> int:
        data = protocol.packet(number, instruction, body)
        self.port.clearPort()
        sent = self.port.writePort(data)
        if sent != len(data):
            raise SerialPortError(
                f"{self.port.port_name}: {sent} of {len(data)} bytes could be sent"
            )
        return len(data)

    def ping(self, number: int) -> list[Reply]:
        """Return the answers to a ping: one, none, or several from servos that share the ID.

        Their data are as a Dynamixel's: model number (2 bytes) and firmware.
        """
        packets = self._ask(number, protocol.PING, b"", [(number, 0)], to_the_end=True)
        known = self._identity(number) if packets else None
        return [] if known is None else [Reply(0, packet.alert, known) for packet in packets]

    def _identity(self, number: int) -> bytes | None:
        """Return model number (2 bytes) and firmware; None if the servo does not tell them."""
        for _ in range(RETRIES):
            reply = self.read(number, FIRMWARE, 5)
            if reply is not None:
                return reply.data[3:5] + reply.data[:1]
        return None

    def broadcast_ping(self) -> dict[int, tuple[int, int]]:
        """Return {ID: (model number, firmware)} of every servo at this speed."""
        sizes = [(number, 0) for number in range(LAST_ID + 1)]
        packets = self._ask(BROADCAST, protocol.PING, b"", sizes, to_the_end=True)
        known = {packet.id: self._identity(packet.id) for packet in packets}
        return {n: struct.unpack("<HB", data or bytes(3)) for n, data in known.items()}

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
        """Write registers of every servo at once, without acknowledgement."""
        self._ask(BROADCAST, protocol.WRITE, bytes([address]) + data, [])

    def reboot(self, number: int) -> Reply | None:
        """Refuse: these servos reboot only with their supply.

        Raises:
            SerialPortError: always.
        """
        raise SerialPortError(
            f"servo {number} cannot be rebooted over the bus; switch its supply off and on"
        )

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> None:
        """Write the same registers of several servos, without acknowledgement."""
        size = len(next(iter(values.values())))
        entries = b"".join(bytes([number]) + data for number, data in values.items())
        self._ask(BROADCAST, protocol.SYNC_WRITE, bytes([address, size]) + entries, [])

    def begin_sync_read(
        self, address: int, size: int, numbers: Sequence[int], fast: bool = False
    ) -> Callable[[], dict[int, Reply]]:
        """Ask for a group read and return what waits for its answers; there are no fast ones."""
        body = bytes([address, size]) + bytes(numbers)
        wanted = [(number, size) for number in numbers]
        finish = self._begin(BROADCAST, protocol.SYNC_READ, body, wanted)
        return lambda: {packet.id: _reply(packet) for packet in finish()}


def _reply(packet: Packet) -> Reply:
    return Reply(0, packet.alert, packet.params[1:])
