"""Damage of every kind, in both directions: nothing crashes, nothing hangs, no wrong value passes.

A million packets each way are marked slow; a few thousand run always.
"""

import struct
import sys

import numpy as np
import pytest

from hardware import protocol
from hardware.bus_client import NOBODY, SHIELD, BusClient
from hardware.clock import VirtualClock
from hardware.config import load_robot
from hardware.emulator.bus import Bus
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.protocol import Parser, instruction_packet, status_packet

SMALL, LARGE = 5_000, pytest.param(1_000_000, marks=pytest.mark.slow)
TIMEOUT = 1800


def flipped(rng: np.random.Generator, data: bytes) -> bytes:
    """Flip one or two bits."""
    number = int.from_bytes(data, "big")
    for place in rng.choice(8 * len(data), size=int(rng.integers(1, 3)), replace=False):
        number ^= 1 << int(place)
    return number.to_bytes(len(data), "big")


def burst(rng: np.random.Generator, data: bytes) -> bytes:
    """Flip bits within a stretch of at most 16."""
    width = int(rng.integers(2, 17))
    pattern = 1 | 1 << width - 1 | int(rng.integers(0, 1 << width))
    place = int(rng.integers(0, 8 * len(data) - width + 1))
    return (int.from_bytes(data, "big") ^ pattern % (1 << width) << place).to_bytes(
        len(data), "big"
    )


def scrambled(rng: np.random.Generator, data: bytes) -> bytes:
    """Replace the data and the CRC by random bytes: the worst that a CRC can meet."""
    return data[:9] + rng.bytes(len(data) - 9)


def shuffled(rng: np.random.Generator, data: bytes) -> bytes:
    """Cut, double, lengthen or replace the packet."""
    kind = int(rng.integers(0, 5))
    if kind == 0:
        return data[: int(rng.integers(0, len(data)))]
    if kind == 1:
        return data[: int(rng.integers(0, len(data)))] + data
    if kind == 2:
        return data[:5] + rng.bytes(2) + data[7:]
    if kind == 3:
        return rng.bytes(int(rng.integers(0, 60)))
    return rng.bytes(int(rng.integers(0, 20))) + data


class Damaged(LoopbackPort):
    """A port at which one prepared answer, changed by a function, meets every request."""

    def __init__(self, world: EmulatedRobot, clock: VirtualClock) -> None:
        super().__init__(world, clock)
        self.answer = b""

    def writePort(self, packet) -> int:
        """Take a request and let the prepared answer arrive."""
        self._received += self.answer
        return len(packet)


@pytest.mark.timeout(TIMEOUT)
@pytest.mark.parametrize("count", [SMALL, LARGE])
def test_answers(count):
    """Flipped bits and bursts never pass; random damage passes no more often than 2^-16."""
    port = Damaged(EmulatedRobot(load_robot("bench1")), VirtualClock())
    client = BusClient(port, port.clock, latency=0.001)
    client.open(1_000_000)
    rng = np.random.default_rng(11)
    true = struct.pack("<i", 2048)
    good = status_packet(1, 0, true + bytes(SHIELD))
    wrong = {"flipped": 0, "burst": 0, "scrambled": 0, "shuffled": 0}
    sent = dict.fromkeys(wrong, 0)
    kinds = (flipped, burst, scrambled, shuffled)
    for k in range(count):
        kind = kinds[k % 4]
        port.answer = kind(rng, good)
        sent[kind.__name__] += 1
        reply = client.read(1, 132, 4)
        if reply is not None and (reply.data != true or reply.error):
            wrong[kind.__name__] += 1
    port.answer = good
    reply = client.read(1, 132, 4)
    assert reply is not None and reply.data == true
    sys.stdout.write(f"\nanswers sent {sent}, wrong values taken {wrong}\n")
    assert wrong["flipped"] == wrong["burst"] == wrong["shuffled"] == 0
    expected = sent["scrambled"] / 65536
    assert wrong["scrambled"] <= expected + 4 * np.sqrt(expected) + 1


@pytest.mark.timeout(TIMEOUT)
@pytest.mark.parametrize("count", [SMALL, LARGE])
def test_instructions(count):
    """Servos live through any instruction, and no group write does what a burst made of it."""
    world = EmulatedRobot(load_robot("bench1"))
    memory = world.servos[0].memory
    rng = np.random.default_rng(12)
    entries = struct.pack("<HHBHBH", 84, 2, 1, 500, NOBODY, 0)
    request = instruction_packet(254, protocol.SYNC_WRITE, entries)
    others = [
        instruction_packet(1, protocol.READ, struct.pack("<HH", 132, 4)),
        instruction_packet(254, protocol.FAST_SYNC_READ, struct.pack("<HHB", 132, 4, 1)),
        instruction_packet(254, protocol.FAST_BULK_READ, struct.pack("<BHH", 1, 132, 4)),
        instruction_packet(1, protocol.REG_WRITE, struct.pack("<HH", 84, 500)),
        instruction_packet(1, protocol.CLEAR, bytes([1, 0x44, 0x58, 0x4C, 0x22])),
        instruction_packet(1, 0x20, b"\x01"),
    ]
    answered = 0
    bus, time = Bus(world), 0.0
    for k in range(count):
        if k % 2:
            kind = (flipped, burst)[k // 2 % 2]
            data = kind(rng, request)
        else:
            data = shuffled(rng, others[k // 2 % len(others)])
        answered += len(bus.feed(data, time, 1_000_000))
        time += 3e-5
        assert memory["position_p_gain"] in (400, 500)  # what it was, or what was sent
    arrivals = bus.feed(instruction_packet(1, protocol.PING), bus._free + 1, 1_000_000)
    assert Parser().feed(b"".join(data for _, data in arrivals))[0].ok
    sys.stdout.write(f"\ninstructions sent {count}, answered {answered}\n")
