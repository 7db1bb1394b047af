"""Dynamixel Protocol 2.0 on the wire: packets as bytes, and bytes as packets.

    data = instruction_packet(1, READ, bytes([132, 0, 4, 0]))       # ff ff fd 00 01 07 00 02 ...
    [packet] = Parser().feed(data)
    packet.id, packet.instruction, packet.params

A packet is FF FF FD 00, ID, length (2 bytes), instruction, parameters, CRC-16 (2 bytes). Inside,
an FD is put after every FF FF FD, so that a header is never seen in the middle. A status packet's
instruction is 0x55 and its first parameter the error byte. A fast status packet is not stuffed, and
every servo's part of it ends with the CRC of all bytes so far.
Source: the protocol's manual, https://emanual.robotis.com/docs/en/dxl/protocol2/.
"""

from dataclasses import dataclass

PING, READ, WRITE, REG_WRITE, ACTION = 0x01, 0x02, 0x03, 0x04, 0x05
FACTORY_RESET, REBOOT, CLEAR, BACKUP, STATUS = 0x06, 0x08, 0x10, 0x20, 0x55
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x82, 0x83, 0x8A
BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x92, 0x93, 0x9A
BROADCAST = 0xFE

FAIL, UNKNOWN_INSTRUCTION, BAD_CRC, BAD_RANGE, BAD_LENGTH, BAD_LIMIT, NO_ACCESS = range(1, 8)
ALERT = 0x80

HEADER = b"\xff\xff\xfd\x00"
LONGEST = 1024


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x8005 if crc & 0x8000 else 0)
        table.append(crc & 0xFFFF)
    return tuple(table)


_TABLE = _crc_table()


def crc16(data: bytes, crc: int = 0) -> int:
    """Return the CRC-16 of the bytes, going on from crc: polynomial 0x8005, not reflected."""
    table = _TABLE
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ table[crc >> 8 ^ byte]
    return crc


def instruction_packet(number: int, instruction: int, params: bytes = b"") -> bytes:
    """Return the bytes of an instruction to the servo of this number."""
    body = bytes([instruction]) + params
    body = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    data = HEADER + bytes([number]) + (len(body) + 2).to_bytes(2, "little") + body
    return data + crc16(data).to_bytes(2, "little")


def status_packet(number: int, error: int, params: bytes = b"") -> bytes:
    """Return the bytes of a servo's answer."""
    return instruction_packet(number, STATUS, bytes([error]) + params)


def fast_status_packet(parts: list[tuple[int, int, bytes]], total: int) -> bytes:
    """Return the one answer to a fast read, up to its last part given.

    Args:
        parts: (error, ID, data) of each servo, in the order asked.
        total: bytes of the whole answer after its length field, as if no servo were missing.
    """
    data = HEADER + bytes([BROADCAST]) + total.to_bytes(2, "little") + bytes([STATUS])
    crc = crc16(data)
    for error, number, values in parts:
        part = bytes([error, number]) + values
        crc = crc16(part, crc)
        tail = crc.to_bytes(2, "little")
        crc = crc16(tail, crc)
        data += part + tail
    return data


def fast_length(sizes: list[int]) -> int:
    """Return the length field of the answer to a fast read of a number of bytes per servo."""
    return 1 + sum(size + 4 for size in sizes)


@dataclass(frozen=True)
class Packet:
    """A packet that was received; `ok` says whether its CRC agrees."""

    id: int
    instruction: int
    params: bytes  # unstuffed, without the CRC
    raw: bytes
    ok: bool

    @property
    def error(self) -> int:
        """The error byte of a status packet, without the alert bit; FAIL if it has none."""
        return self.params[0] & ~ALERT if self.params else FAIL

    @property
    def alert(self) -> bool:
        """Whether the servo reports a hardware error."""
        return bool(self.params and self.params[0] & ALERT)


class Parser:
    """Cuts a stream of bytes into packets; noise between them and damaged ones do no harm."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """The number of bytes that wait for the rest of their packet."""
        return len(self._buffer)

    def clear(self) -> None:
        """Forget an unfinished packet."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[Packet]:
        """Take bytes and return the packets that they complete, damaged ones included."""
        self._buffer += data
        packets = []
        while packet := self._next():
            packets.append(packet)
        return packets

    def _next(self) -> Packet | None:
        buffer = self._buffer
        while True:
            start = buffer.find(HEADER)
            if start < 0:
                keep = next((k for k in (3, 2, 1) if buffer.endswith(HEADER[:k])), 0)
                del buffer[: len(buffer) - keep]
                return None
            del buffer[:start]
            if len(buffer) < 7:
                return None
            length = int.from_bytes(buffer[5:7], "little")
            if not 3 <= length <= LONGEST:
                del buffer[:4]
                continue
            again = buffer.find(HEADER, 4, 7 + length)
            if again >= 0 and not _fast(buffer):
                del buffer[:again]
                continue
            if len(buffer) < 7 + length:
                return None
            raw = bytes(buffer[: 7 + length])
            del buffer[: 7 + length]
            return _packet(raw)


def _fast(buffer: bytearray) -> bool:
    """Whether this may be a fast answer, which is not stuffed: data can look like a header."""
    return buffer[4] == BROADCAST and len(buffer) > 7 and buffer[7] == STATUS


def _packet(raw: bytes) -> Packet:
    body = raw[7:-2]
    if not (raw[4] == BROADCAST and body[0] == STATUS):
        body = body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
    ok = crc16(raw[:-2]) == int.from_bytes(raw[-2:], "little")
    return Packet(raw[4], body[0], body[1:], raw, ok)
