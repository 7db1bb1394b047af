r"""Feetech's protocol on the wire, which is Dynamixel's first one: packets as bytes, and back.

    data = packet(1, READ, bytes([56, 2]))              # ff ff 01 04 02 38 02 be
    [answer] = Parser().feed(status(1, 0, b"\x00\x08"))
    answer.id, answer.alert, answer.params[1:]

A packet is FF FF, ID, length (what follows), instruction or status, parameters, and the inverted
sum of all from the ID on. Eight bits of sum let one in 256 of damaged answers pass, so that the
driver also looks whether a value can be true. The status bits of an answer are hardware errors,
none of them about the instruction. The framing is written here, and tested against the maker's SDK
(feetech-servo-sdk), whose own receiver waits by a clock that can be set.
Source: Feetech, "Magnetic encoder series servo memory table and protocol manual".
"""

from hardware import protocol
from hardware.protocol import ALERT, BROADCAST, STATUS, Packet

PING, READ, WRITE, REG_WRITE, ACTION, RESET, REBOOT, CALIBRATE = 1, 2, 3, 4, 5, 6, 8, 0x0B
SYNC_READ, SYNC_WRITE = 0x82, 0x83
HEADER = b"\xff\xff"
SHORTEST, LONGEST = 2, 250  # of the length field


def packet(number: int, instruction: int, params: bytes = b"") -> bytes:
    """Return the bytes of an instruction to the servo of this number."""
    body = bytes([number, len(params) + 2, instruction]) + params
    return HEADER + body + bytes([checksum(body)])


def status(number: int, errors: int, data: bytes = b"") -> bytes:
    """Return the bytes of a servo's answer with its hardware errors, as bits."""
    return packet(number, errors, data)


def checksum(body: bytes) -> int:
    """Return the inverted low byte of the sum."""
    return ~sum(body) & 0xFF


class Parser(protocol.Parser):
    """Cuts a stream of bytes into packets, as the other protocol's does.

    Answers are given as those of the other protocol are: their first parameter is the error byte,
    which here can only say that the servo reports a hardware error.
    """

    def __init__(self, answers: bool = True) -> None:
        super().__init__()
        self._answers = answers

    def _next(self) -> Packet | None:
        buffer = self._buffer
        while True:
            start = buffer.find(HEADER)
            if start < 0:
                del buffer[: len(buffer) - buffer.endswith(HEADER[:1])]
                return None
            del buffer[:start]
            if len(buffer) < 4:
                return None
            length = buffer[3]
            if buffer[2] == 0xFF or not SHORTEST <= length <= LONGEST:
                del buffer[:1]
                continue
            if len(buffer) < 4 + length:
                return None
            raw = bytes(buffer[: 4 + length])
            ok = checksum(raw[2:-1]) == raw[-1]
            del buffer[: 4 + length if ok else 2]  # a false header may hide a true one
            return self._packet(raw, ok)

    def _packet(self, raw: bytes, ok: bool) -> Packet:
        if not self._answers:
            return Packet(raw[2], raw[4], raw[5:-1], raw, ok)
        error = ALERT if raw[4] else 0
        return Packet(raw[2], STATUS, bytes([error]) + raw[5:-1], raw, ok)


__all__ = ["BROADCAST", "Parser", "checksum", "packet", "status"]
