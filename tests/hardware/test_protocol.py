"""Packets are the published ones byte for byte, and any bytes are cut into packets without harm."""

import numpy as np
import pytest

from hardware import protocol
from hardware.protocol import Parser, crc16, instruction_packet, status_packet

# Example packets of the protocol's manual (emanual.robotis.com/docs/en/dxl/protocol2/).
INSTRUCTIONS = {
    "FF FF FD 00 01 03 00 01 19 4E": (1, protocol.PING, ""),
    "FF FF FD 00 FE 03 00 01 31 42": (254, protocol.PING, ""),
    "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15": (1, protocol.READ, "84 00 04 00"),
    "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89": (1, protocol.WRITE, "74 00 00 02 00 00"),
    "FF FF FD 00 01 03 00 08 2F 4E": (1, protocol.REBOOT, ""),
    "FF FF FD 00 01 04 00 06 01 A1 E6": (1, protocol.FACTORY_RESET, "01"),
    "FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC": (1, protocol.CLEAR, "01 44 58 4C 22"),
    "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA": (
        *(254, protocol.SYNC_READ, "84 00 04 00 01 02"),
    ),
    "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87": (
        *(254, protocol.SYNC_WRITE, "74 00 04 00 01 96 00 00 00 02 AA 00 00 00"),
    ),
    "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05": (
        *(254, protocol.BULK_READ, "01 90 00 02 00 02 92 00 01 00"),
    ),
    "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68": (
        *(254, protocol.BULK_WRITE, "01 20 00 02 00 A0 00 02 1F 00 01 00 50"),
    ),
}
STATUSES = {
    "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D": (1, "06 04 26"),
    "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0": (1, "A6 00 00 00"),
    "FF FF FD 00 01 04 00 55 00 A1 0C": (1, ""),
}


@pytest.mark.parametrize("text", INSTRUCTIONS)
def test_published_instructions(text):
    """Our instruction packets are the manual's, and are read back as what they say."""
    number, instruction, params = INSTRUCTIONS[text]
    data = instruction_packet(number, instruction, bytes.fromhex(params))
    assert data == bytes.fromhex(text)
    (packet,) = Parser().feed(data)
    assert packet.ok
    assert (packet.id, packet.instruction) == (number, instruction)
    assert packet.params == bytes.fromhex(params)


@pytest.mark.parametrize("text", STATUSES)
def test_published_statuses(text):
    """Our status packets are the manual's."""
    number, params = STATUSES[text]
    assert status_packet(number, 0, bytes.fromhex(params)) == bytes.fromhex(text)


def test_published_fast_sync_read():
    """A fast answer has one header, and a CRC over everything so far after each servo's bytes."""
    parts = [(0, 3, bytes.fromhex("A6 00 00 00")), (0, 7, bytes.fromhex("1F 08 00 00"))]
    data = protocol.fast_status_packet(parts, protocol.fast_length([4, 4]))
    assert data[:10] == bytes.fromhex("FF FF FD 00 FE 11 00 55 00 03")
    first = 8 + 2 + 4
    assert crc16(data[:first]) == int.from_bytes(data[first : first + 2], "little")
    assert crc16(data[:-2]) == int.from_bytes(data[-2:], "little")
    (packet,) = Parser().feed(data)
    assert packet.ok
    assert len(packet.raw) == 8 + 2 * 8


def test_stuffing_keeps_headers_out_of_packets():
    """Any parameters come back, however full of headers, and hold no header on the wire."""
    rng = np.random.default_rng(0)
    for _ in range(2000):
        params = bytes(rng.choice([0xFF, 0xFF, 0xFD, 0x00, 0x55], size=rng.integers(1, 30)))
        data = instruction_packet(5, protocol.WRITE, params)
        assert data.find(protocol.HEADER, 1) < 0
        (packet,) = Parser().feed(data)
        assert packet.ok
        assert packet.params == params


def test_stream_may_be_cut_anywhere():
    """Packets are found whatever the pieces in which the bytes arrive, with noise between."""
    packets = [bytes.fromhex(text) for text in INSTRUCTIONS]
    stream = b"\xff\x00\xff\xff".join(packets) + b"\xff\xff\xfd"
    for size in (1, 2, 3, 5, 7, 11, 1000):
        parser = Parser()
        found = [p for i in range(0, len(stream), size) for p in parser.feed(stream[i : i + size])]
        assert [p.raw for p in found] == packets
        assert all(p.ok for p in found)


def test_a_new_packet_ends_an_unfinished_one():
    """A packet whose end was lost does not swallow the next."""
    whole = instruction_packet(1, protocol.PING)
    long = instruction_packet(2, protocol.WRITE, bytes(40))
    assert [p.raw for p in Parser().feed(long[:20] + whole)] == [whole]


def test_every_two_bit_error_and_burst_is_seen():
    """No packet with 1 or 2 flipped bits, or a burst of up to 16, passes as a whole one."""
    data = bytes.fromhex("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0")
    bits = 8 * len(data)
    number = int.from_bytes(data, "big")
    flips = [1 << i for i in range(bits)]
    flips += [1 << i | 1 << j for i in range(bits) for j in range(i)]
    rng = np.random.default_rng(1)
    for _ in range(3000):
        width = int(rng.integers(2, 17))
        inner = int(rng.integers(0, 1 << (width - 2))) << 1 if width > 2 else 0
        flips.append((1 | inner | 1 << width - 1) << int(rng.integers(0, bits - width + 1)))
    for flip in flips:
        bad = (number ^ flip).to_bytes(len(data), "big")
        assert not any(packet.ok for packet in Parser().feed(bad + bytes(8)))
