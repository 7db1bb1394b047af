"""The host's end of the bus: dynamixel-sdk sends, and what comes back is read with care.

    client = BusClient(port, clock, latency=0.001)
    client.open(1_000_000)
    client.read(1, 132, 4)                    # Reply(error=0, alert=False, data=b'...') or None
    client.sync_read(120, 16, [1, 2, 3], fast=True)

The SDK's own receiving code is not used in the loop, because over a bus with faults it (4.1.0)
raises IndexError on a late answer to a fast read and on a short status, hides the alert bit in
group reads, stays busy for ever after an unplugged cable, takes an old answer for a new one, and
returns 0, a plausible position, for a servo that did not answer. Here a reply counts only if its
CRC, its ID, its length and its order are right; everything else is counted by servo and left out.
Bytes from before a request are thrown away, after a failure with a wait for those still to come.

The protocol sends its CRC low byte first, so that the CRC misses one in 65536 of the short bursts
of wrong bits that touch it. Reads therefore ask for two bytes more than wanted, and group writes
end with an entry that no servo has: no entry that counts is within 16 bits of the CRC.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from dynamixel_sdk import PacketHandler

from hardware import protocol
from hardware.clock import Clock
from hardware.counters import Counters
from hardware.errors import SerialPortError
from hardware.port_lock import PortLock
from hardware.protocol import BROADCAST, Packet, Parser, crc16
from hardware.serial_ports import explain_failure

if TYPE_CHECKING:
    from dynamixel_sdk import PortHandler

SHIELD = 2  # bytes read beyond the wanted ones
NOBODY = 252  # an ID that no servo of a robot may have
MORE_PATIENT = 10  # times the usual patience, where a machine may be busy
TURN_ROUND = 1e-4  # s, the most that a servo takes beyond its return delay
LATE = 1e-3  # s beyond what the wire explains: where ros2_control warns of a component's times


@dataclass(frozen=True)
class Reply:
    """A servo's answer: its error number, whether it reports a hardware error, and its data."""

    error: int
    alert: bool
    data: bytes


class BusClient:
    """Requests and answers over one port.

    Args:
        port: a port of dynamixel-sdk, or the emulator's.
        clock: source of the time.
        latency: how long the USB adapter may hold bytes back [s].
        return_delay: how long a servo waits before it answers [s].
    """

    overhead = 11  # bytes of an answer in addition to its data
    parser: ClassVar[type[Parser]] = Parser  # what cuts bytes into packets

    def __init__(
        self, port: PortHandler, clock: Clock, latency: float, return_delay: float = 0.0005
    ) -> None:
        self.port, self.clock = port, clock
        self.latency, self.return_delay = latency, return_delay
        self.counters: defaultdict[int, Counters] = defaultdict(Counters)
        self.group = Counters()  # of answers that several servos share
        self._lock = PortLock(port.port_name)
        self._handler = PacketHandler(2.0)
        self._parser = self.parser()
        self._doubtful = False  # an answer failed to come; it may still be on its way
        self.patience = clock.jitter  # s that an answer may be late by the machine's fault
        self.lateness = 0.0  # s by which the newest good answer was later than the wire explains

    def open(self, baud: int) -> None:
        """Open the port at this speed.

        Raises:
            SerialPortError: there is no such port, it cannot run at this speed, or another program
                holds it.
        """
        with self._cable():
            self.port.is_using = False
            if self.port.getCFlagBaud(baud) <= 0:
                raise SerialPortError(
                    f"{self.port.port_name}: the port cannot run at {baud} bits/s"
                )
            self._lock.take()
            self.port.setBaudRate(baud)

    def close(self) -> None:
        """Close the port, even if its cable is disconnected."""
        try:
            if self.port.is_open:
                self.port.closePort()
        except Exception:
            self.port.is_open = False
        self.port.is_using = False
        self._lock.release()

    @contextmanager
    def more_patient(self, times: float = MORE_PATIENT) -> Iterator[None]:
        """Multiply the time limits of answers in this block, as a busy machine needs."""
        usual, self.patience = self.patience, times * self.patience
        try:
            yield
        finally:
            self.patience = usual

    def ping(self, number: int) -> list[Reply]:
        """Return the answers to a ping: one, none, or several from servos that share the ID."""
        packets = self._ask(number, protocol.PING, b"", [(number, 3)], to_the_end=True)
        return [_reply(p) for p in packets]

    def broadcast_ping(self) -> dict[int, tuple[int, int]]:
        """Return {ID: (model number, firmware)} of every servo at this speed."""
        sizes = [(number, 3) for number in range(253)]
        found = {}
        for packet in self._ask(BROADCAST, protocol.PING, b"", sizes, to_the_end=True):
            found[packet.id] = struct.unpack("<HB", packet.params[1:4])
        return found

    def read(self, number: int, address: int, size: int) -> Reply | None:
        """Read registers of one servo; None if no good answer came."""
        body = struct.pack("<HH", address, size + SHIELD)
        packets = self._ask(number, protocol.READ, body, [(number, size + SHIELD)])
        return _reply(packets[0], size) if packets else None

    def write(self, number: int, address: int, data: bytes) -> Reply | None:
        """Write registers of one servo; None if no good answer came."""
        body = struct.pack("<H", address) + data
        packets = self._ask(number, protocol.WRITE, body, [(number, 0)])
        return _reply(packets[0]) if packets else None

    def write_all(self, address: int, data: bytes) -> None:
        """Write registers of every servo at once, without acknowledgement."""
        self._ask(BROADCAST, protocol.WRITE, struct.pack("<H", address) + data, [])

    def reboot(self, number: int) -> Reply | None:
        """Reboot a servo; None if no good answer came."""
        packets = self._ask(number, protocol.REBOOT, b"", [(number, 0)])
        return _reply(packets[0]) if packets else None

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> None:
        """Write the same registers of several servos, without acknowledgement.

        A final entry for an absent servo protects the others (see the module).
        """
        size = len(next(iter(values.values())))
        body = struct.pack("<HH", address, size)
        entries = {**values, NOBODY: bytes(size)}
        body += b"".join(bytes([number]) + data for number, data in entries.items())
        self._ask(BROADCAST, protocol.SYNC_WRITE, body, [])

    def sync_read(
        self, address: int, size: int, numbers: Sequence[int], fast: bool
    ) -> dict[int, Reply]:
        """Read the same registers of several servos; those without a good answer are left out."""
        return self.begin_sync_read(address, size, numbers, fast)()

    def begin_sync_read(
        self, address: int, size: int, numbers: Sequence[int], fast: bool
    ) -> Callable[[], dict[int, Reply]]:
        """Ask for a group read and return what waits for its answers.

        In between other buses can be asked; this one cannot.
        """
        body = struct.pack("<HH", address, size + SHIELD) + bytes(numbers)
        wanted = [(number, size + SHIELD) for number in numbers]
        if not fast:
            finish = self._begin(BROADCAST, protocol.SYNC_READ, body, wanted)
            return lambda: {p.id: _reply(p, size) for p in finish()}
        length = 8 + sum(s + 4 for _, s in wanted)
        finish = self._begin(BROADCAST, protocol.FAST_SYNC_READ, body, wanted, fast=length)

        def split() -> dict[int, Reply]:
            packets = finish()
            return self._split(packets[0], wanted, size) if packets else {}

        return split

    def _split(
        self, packet: Packet, wanted: Sequence[tuple[int, int]], kept: int
    ) -> dict[int, Reply]:
        """Cut a fast answer into its servos' parts, each with its own CRC."""
        replies: dict[int, Reply] = {}
        raw, start, crc, done = packet.raw, 8, 0, 0
        for number, size in wanted:
            end = start + 2 + size
            tail = int.from_bytes(raw[end : end + 2], "little")
            crc, done = crc16(raw[done:end], crc), end
            if raw[start + 1] != number or crc != tail:
                self.counters[number].corrupt += 1
                return {}
            error = raw[start]
            replies[number] = self._count(number, error, raw[start + 2 : start + 2 + kept])
            start = end + 2
        return replies

    def _count(self, number: int, error: int, data: bytes) -> Reply:
        reply = Reply(error & ~protocol.ALERT, bool(error & protocol.ALERT), data)
        counters = self.counters[number]
        counters.answered += 1
        counters.alert += reply.alert
        counters.error += reply.error != 0
        return reply

    def _ask(
        self,
        number: int,
        instruction: int,
        body: bytes,
        wanted: Sequence[tuple[int, int]],
        to_the_end: bool = False,
    ) -> list[Packet]:
        """Send an instruction and return the good answers, in order; see `_begin`."""
        return self._begin(number, instruction, body, wanted, to_the_end)()

    def _begin(
        self,
        number: int,
        instruction: int,
        body: bytes,
        wanted: Sequence[tuple[int, int]],
        to_the_end: bool = False,
        fast: int = 0,
    ) -> Callable[[], list[Packet]]:
        """Send an instruction and return what waits for the good answers, in order.

        Args:
            number: to whom.
            instruction: what.
            body: its parameters.
            wanted: (ID, bytes) of each answer.
            to_the_end: listen until the time is over, to hear more than was asked for.
            fast: bytes of the one packet that answers a fast read, else 0.
        """
        with self._cable():
            if self._doubtful:
                self._drain()
            self._parser.clear()
            sent = self._send(number, instruction, body)
            if not wanted:
                return list
            for each, _ in wanted if number == BROADCAST and not to_the_end else wanted[:1]:
                self.counters[each].asked += 1
            answer = fast or sum(self.overhead + size for _, size in wanted)
            waits = 1 if fast else len(wanted)
            span = (sent + answer) * 10 / self.port.getBaudRate()
            span += waits * (self.return_delay + TURN_ROUND) + self.latency + self.patience
            self.port.setPacketTimeoutMillis(span * 1000)
            # the SDK's own deadline is of the wall clock, which can be set
            deadline = self.clock.now() + span
            explained = deadline - self.patience  # what comes later is late

        def finish() -> list[Packet]:
            with self._cable():
                good = self._receive(wanted, deadline, span, to_the_end, fast, explained)
                if good and not to_the_end:
                    self.lateness = max(self.clock.now() - explained, 0.0)
                return good

        return finish

    def _send(self, number: int, instruction: int, body: bytes) -> int:
        """Send an instruction and return how many bytes it has, less what is stuffed."""
        length = len(body) + 3
        packet = [0, 0, 0, 0, number, length & 0xFF, length >> 8, instruction, *body, 0, 0]
        self.port.is_using = False
        result = self._handler.txPacket(self.port, packet)
        self.port.is_using = False
        if result != 0:
            raise SerialPortError(f"{self.port.port_name}: a packet could not be sent ({result})")
        return len(packet)

    def _receive(
        self,
        wanted: Sequence[tuple[int, int]],
        deadline: float,
        span: float,
        to_the_end: bool,
        fast: int,
        explained: float,
    ) -> list[Packet]:
        port, good = self.port, []
        left = [BROADCAST] if fast else [number for number, _ in wanted]
        sizes = {BROADCAST: fast} if fast else {n: self.overhead + size for n, size in wanted}
        last = self.clock.now()  # s, the answer before
        while True:
            data = port.readPort(4096)
            for packet in self._parser.feed(bytes(data)):
                if self._fits(packet, left, sizes, to_the_end, bool(fast)):
                    good.append(packet)
                    servos = [number for number, _ in wanted] if fast else [packet.id]
                    self._time(servos, max(explained, last + self._span(len(packet.raw))))
                    last = self.clock.now()
            if not to_the_end and not left:
                self._doubtful = False
                return good
            if self.clock.now() >= (deadline + span if data else deadline):
                break  # with data: another device floods the bus
            if not data:
                self.clock.wait_for_bytes(port.ser, deadline)
        self._doubtful = not good or not to_the_end
        if not to_the_end:
            for number in (n for n, _ in wanted) if fast else left:
                self.counters[number].timeout += 1
        return good

    def _fits(
        self, packet: Packet, left: list[int], sizes: Mapping[int, int], several: bool, fast: bool
    ) -> bool:
        """Say whether this packet answers the request, and count it if it does not."""
        if packet.instruction != protocol.STATUS:
            return False  # our own bytes, echoed by a half-duplex adapter
        counters = self.group if packet.id == BROADCAST else self.counters[packet.id]
        if not packet.ok:
            counters.corrupt += 1
            return False
        if packet.id not in sizes or (packet.id not in left and not several):
            counters.foreign += 1
            return False
        if not fast and len(packet.params) + self.overhead - 1 != sizes[packet.id]:
            counters.short += 1
            if packet.error and packet.id in left:
                counters.error += 1
                left.remove(packet.id)  # it answered, but with an error and without data
            return False
        if fast and len(packet.raw) != sizes[packet.id]:
            counters.short += 1
            return False
        if packet.id in left:
            left.remove(packet.id)
        if not fast:
            self._count(packet.id, packet.params[0], packet.params[1:])
        return True

    def _span(self, size: int) -> float:
        """Return the time that one answer of a number of bytes adds to the previous one [s]."""
        return size * 10 / self.port.getBaudRate() + self.return_delay + TURN_ROUND + self.latency

    def _time(self, servos: Sequence[int], due: float) -> None:
        """Count the answer of these servos as late if it was due [s] long ago."""
        for number in servos:
            self.counters[number].late += self.clock.now() > due + LATE

    def _drain(self) -> None:
        """Let answers that are late come in, and forget them."""
        self._doubtful = False
        span = self.latency + self.patience
        self.port.setPacketTimeoutMillis(span * 1000)
        deadline = self.clock.now() + span
        while True:
            data = self.port.readPort(4096)
            if self.clock.now() >= (deadline + span if data else deadline):
                return
            if not data:
                self.clock.wait_for_bytes(self.port.ser, deadline)

    @contextmanager
    def _cable(self) -> Iterator[None]:
        """Turn what the operating system says of a lost port into a SerialPortError."""
        try:
            yield
        except SerialPortError:
            raise
        except Exception as error:
            self.port.is_using = False
            if isinstance(error, OSError) or type(error).__module__ == "termios":
                raise SerialPortError(explain_failure(self.port.port_name, error)) from error
            raise


def _reply(packet: Packet, size: int | None = None) -> Reply:
    """The packet's error and data, cut to size bytes."""
    data = packet.params[1:]
    return Reply(packet.error, packet.alert, data if size is None else data[:size])
