"""The emulated bus: bytes in, bytes out, at the times a real bus would take.

    bus = Bus(EmulatedRobot(load_robot("bench1")))
    for arrival, data in bus.feed(ping_bytes, now=0.0, baud=1_000_000):
        ...                                   # the host has `data` at time `arrival` [s]

Half duplex, 10 bits a byte. A servo answers after its return delay and a turn-round of 50 µs (an
assumption), the next one of a chain after it; each is sampled when its answer starts, so later ones
are seen later. The adapter hands bytes over at most `latency` after the last of them. A chain of
answers ends at a servo that is missing. Two servos of one ID answer one after the other.

A robot may have several buses: `run_in_time_order` carries out the steps of all in the order of
time.
"""

import heapq
import struct
from collections.abc import Generator, Iterator, Sequence

from hardware import protocol
from hardware.config import Robot
from hardware.emulator.servo import Servo
from hardware.emulator.world import EmulatedRobot
from hardware.protocol import BROADCAST, Packet, Parser

TURN_ROUND = 5e-5  # s
BYTE_GAP = 0.02  # s of silence after which an unfinished packet is forgotten
LARGEST_ID = 252
TOLERANCE = 0.03  # of a speed, that host and servo may differ by (from the manual)
Arrival = tuple[float, bytes]
Steps = Generator[float, None, list[Arrival]]  # yields when the robot must have got to [s]


class Bus:
    """The wire between a host and the servos of a world.

    Args:
        world: the servos, and the physics that goes on while bytes travel. Its robot's file says
            how long the adapter holds bytes back at most.
        part: of the world's robot, the servos of this bus; None for all of them.
    """

    def __init__(self, world: EmulatedRobot, part: Robot | None = None) -> None:
        self._world, self._rng = world, world.wire_rng
        self.part = part or world.robot
        self._servos = [world.servos[world.robot.names.index(n)] for n in self.part.names]
        self._latency = self.part.bus.latency  # s
        self._parser = Parser()
        self._free = 0.0  # s
        self._flushed = 0.0  # s, when the adapter last handed bytes over
        self._byte = 1e-5  # s a byte takes
        self._baud = 0
        self._loss = world.hidden.robot["packet_loss"]

    @property
    def free(self) -> float:
        """When the wire is idle again [s]."""
        return self._free

    def feed(self, data: bytes, now: float, baud: int) -> list[Arrival]:
        """Take bytes that the host writes, and return what comes back and when.

        Args:
            data: the bytes.
            now: when the host writes them [s].
            baud: the host's bits a second; servos set otherwise do not understand.

        Returns:
            (time [s], bytes) in order of time.
        """
        return run_in_time_order(self._world, [self.begin(data, now, baud)])[0]

    def begin(self, data: bytes, now: float, baud: int) -> Steps:
        """Do what `feed` does step by step: yield each time that the robot must have got to [s]."""
        self._byte, self._baud = 10 / baud, baud
        if now - self._free > BYTE_GAP:
            self._parser.clear()
        start = max(now, self._free)
        self._free = start + len(data) * self._byte
        arrivals: list[Arrival] = []
        for packet in self._parser.feed(self._world.faults.incoming(data, start)):
            yield self._free
            arrivals += yield from self._handle(packet)
        return sorted(arrivals, key=lambda arrival: arrival[0])

    def _handle(self, packet: Packet) -> Steps:
        """Let the servos carry out a packet, and return their answers."""
        if not packet.ok:
            return self._send([self._status(s, protocol.BAD_CRC, b"") for s in self._at(packet.id)])
        if packet.instruction in _READS:
            return (yield from _READS[packet.instruction](self, packet.params))
        return self._obey(packet)

    def _obey(self, packet: Packet) -> list[Arrival]:
        """Let servos carry out what takes no time."""
        if packet.instruction in _WRITES:
            return _WRITES[packet.instruction](self, packet.params)
        if packet.instruction == protocol.STATUS:
            return []
        if packet.id == BROADCAST:
            return self._broadcast(packet)
        answers = []
        for servo in self._at(packet.id):
            if self._lost():
                continue
            replies = servo.answers(packet.instruction)
            error, params = servo.execute(packet.instruction, packet.params, self._free)
            if replies:  # by the ID that it was called, even if that was just changed
                answer = protocol.status_packet(packet.id, servo.flagged(error), params)
                answers.append((servo, answer))
        for servo in self._group(packet.id):
            if not self._lost():
                servo.obey(packet.instruction, packet.params, self._free)
        return self._send(answers)

    def _broadcast(self, packet: Packet) -> list[Arrival]:
        listening = [s for s in self._servos if self._hears(s)]
        ordered = sorted(listening, key=lambda s: s.id)
        answers = []
        for servo in ordered:
            if packet.instruction == protocol.FACTORY_RESET and packet.params == b"\xff":
                continue  # forbidden for all at once: every servo would get the same ID
            error, params = servo.execute(packet.instruction, packet.params, self._free)
            if packet.instruction == protocol.PING:
                answers.append(self._status(servo, error, params))
        return self._send(answers)

    def _sync_read(self, params: bytes) -> Steps:
        return self._chain(protocol.SYNC_READ, _alike(params))

    def _bulk_read(self, params: bytes) -> Steps:
        return self._chain(protocol.BULK_READ, list(struct.iter_unpack("<BHH", _whole(params, 5))))

    def _fast_sync_read(self, params: bytes) -> Steps:
        return self._fast_chain(_alike(params))

    def _fast_bulk_read(self, params: bytes) -> Steps:
        return self._fast_chain(list(struct.iter_unpack("<BHH", _whole(params, 5))))

    def _sync_write(self, params: bytes) -> list[Arrival]:
        if len(params) < 4:
            return []
        address, size = struct.unpack_from("<HH", params)
        body = _whole(params[4:], size + 1)
        for i in range(0, len(body), size + 1):
            self._silent_write(body[i], address, body[i + 1 : i + 1 + size])
        return []

    def _bulk_write(self, params: bytes) -> list[Arrival]:
        while len(params) >= 5:
            number, address, size = struct.unpack_from("<BHH", params)
            self._silent_write(number, address, params[5 : 5 + size])
            params = params[5 + size :]
        return []

    def _silent_write(self, number: int, address: int, data: bytes) -> None:
        for servo in self._at(number):
            if not self._lost():
                servo.heard = self._free
                servo.write(address, data, self._free)

    def _chain(self, instruction: int, wanted: list[tuple[int, int, int]]) -> Steps:
        """Answers of several servos, one after the other, each sampled as it starts."""
        answers: list[tuple[Servo, bytes]] = []
        when = self._free
        for number, address, size in wanted:
            servos = [s for s in self._at(number) if s.answers(instruction)]
            if not servos or self._lost():
                break
            for servo in servos:
                when += servo.return_delay + TURN_ROUND
                yield when
                servo.heard = self._free
                error, data = servo.read(address, size)
                answer = self._status(servo, error, data)
                answers.append(answer)
                when += len(answer[1]) * self._byte
        return self._send(answers)

    def _fast_chain(self, wanted: list[tuple[int, int, int]]) -> Steps:
        """One answer to which every servo adds its part; it ends at a servo that is missing."""
        parts = []
        when = self._free + TURN_ROUND
        first: Servo | None = None
        for number, address, size in wanted:
            servo = next((s for s in self._at(number) if s.fast), None)
            if servo is None or not servo.answers(protocol.FAST_SYNC_READ) or self._lost():
                break
            if first is None:
                first = servo
                when += servo.return_delay
            yield when
            servo.heard = self._free
            error, data = servo.read(address, size)
            parts.append((servo.flagged(error), servo.id, data.ljust(size, b"\0")))
            when += (size + 4) * self._byte
        if first is None:
            return []
        total = protocol.fast_length([size for _, _, size in wanted])
        return self._send([(first, protocol.fast_status_packet(parts, total))])

    def _status(self, servo: Servo, error: int, params: bytes) -> tuple[Servo, bytes]:
        return servo, protocol.status_packet(servo.id, servo.flagged(error), params)

    def _send(self, answers: list[tuple[Servo, bytes]]) -> list[Arrival]:
        """Put answers on the wire one after the other; faults may drop, change or delay them."""
        arrivals: list[Arrival] = []
        for servo, data in answers:
            if self._lost():
                continue
            self._free += servo.return_delay + TURN_ROUND + len(data) * self._byte
            for late, piece in self._world.faults.outgoing(data, servo.id, self._free):
                arrivals.append((self._free + late, piece))
        if not arrivals:
            return []
        flush = self._free + float(self._rng.uniform(0, self._latency))
        flush = self._flushed = max(flush, self._flushed)  # bytes do not overtake each other
        return [(max(time, flush), data) for time, data in arrivals]

    def _at(self, number: int) -> Iterator[Servo]:
        return (s for s in self._servos if s.id == number and self._hears(s))

    def _group(self, number: int) -> list[Servo]:
        """Servos that obey this ID as their group's, and have another ID themselves."""
        if number > LARGEST_ID:
            return []
        servos = self._servos
        return [s for s in servos if s.second_id == number != s.id and self._hears(s)]

    def _hears(self, servo: Servo) -> bool:
        same = abs(servo.baud - self._baud) <= TOLERANCE * servo.baud
        return same and not self._world.is_silent(servo, self._free)

    def _lost(self) -> bool:
        return self._loss > 0 and self._rng.random() < self._loss


def _alike(params: bytes) -> list[tuple[int, int, int]]:
    """Return (ID, address, size) of each servo that a sync read asks."""
    if len(params) < 5:
        return []
    address, size = struct.unpack_from("<HH", params)
    return [(number, address, size) for number in params[4:]]


def _whole(data: bytes, size: int) -> bytes:
    """The data without an unfinished entry at its end."""
    return data[: len(data) // size * size]


def run_in_time_order(world: EmulatedRobot, begun: Sequence[Steps]) -> list[list[Arrival]]:
    """Carry out the steps of several buses, each at its time, and return their answers."""
    arrivals: list[list[Arrival]] = [[] for _ in begun]
    waiting: list[tuple[float, int]] = []

    def go_on(i: int) -> None:
        try:
            heapq.heappush(waiting, (next(begun[i]), i))
        except StopIteration as end:
            arrivals[i] = end.value

    for i in range(len(begun)):
        go_on(i)
    while waiting:
        when, i = heapq.heappop(waiting)
        world.advance(when)
        go_on(i)
    return arrivals


_READS = {
    protocol.SYNC_READ: Bus._sync_read,
    protocol.BULK_READ: Bus._bulk_read,
    protocol.FAST_SYNC_READ: Bus._fast_sync_read,
    protocol.FAST_BULK_READ: Bus._fast_bulk_read,
}
_WRITES = {protocol.SYNC_WRITE: Bus._sync_write, protocol.BULK_WRITE: Bus._bulk_write}
