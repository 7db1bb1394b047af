"""Frames of the BNO085's mode UART-RVC: the maker's example, damage, angles and their order."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.imu.rvc import MILLI_G, SIZE, STEP, Parser, angles, encode

EXAMPLE = bytes.fromhex("aaaade010092ff25088dfeecffd103000000e7")  # BNO08X data sheet, 1.3.5.2


def test_the_makers_example():
    """Number 222, yaw 0.01, pitch -1.10, roll 20.85 degrees; -371, -20 and 977 mg."""
    [frame] = Parser().feed(EXAMPLE)
    assert frame.number == 222
    turned = np.rad2deg([frame.yaw, frame.pitch, frame.roll])
    assert turned == pytest.approx([0.01, -1.10, 20.85])
    assert frame.acceleration / MILLI_G == pytest.approx([-371, -20, 977])
    assert frame.acceleration[0] == pytest.approx(-3.638, abs=5e-4)
    assert encode(222, (frame.yaw, frame.pitch, frame.roll), frame.acceleration) == EXAMPLE


def test_the_order_of_the_turns():
    """Yaw about z, pitch about the new y, roll about the new x, as the engine turns a body."""
    turned = 0.9, -0.4, 2.2
    [frame] = Parser().feed(encode(0, turned, np.zeros(3)))
    whole, half = np.array([1.0, 0, 0, 0]), np.zeros(4)
    for angle, axis in zip(turned, ([0, 0, 1], [0, 1, 0], [1, 0, 0]), strict=True):
        part = np.zeros(4)
        mujoco.mju_axisAngle2Quat(part, np.array(axis, float), angle)
        mujoco.mju_mulQuat(half, whole, part)
        whole = half.copy()
    assert abs(frame.orientation @ whole) == pytest.approx(1, abs=1e-7)
    assert angles(whole) == pytest.approx(turned)


@given(
    st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)),
    st.lists(st.floats(-300, 300), min_size=3, max_size=3),
    st.integers(0, 255),
)
def test_what_is_sent_comes_back(turned, acceleration, number):
    """Angles to half a step, acceleration to half a mg, quaternions to the same turn."""
    [frame] = Parser().feed(encode(number, turned, np.array(acceleration)))
    assert frame.number == number
    assert (frame.yaw, frame.pitch, frame.roll) == pytest.approx(turned, abs=STEP / 2 + 1e-9)
    assert frame.acceleration == pytest.approx(acceleration, abs=MILLI_G / 2 + 1e-9)
    assert np.linalg.norm(frame.orientation) == pytest.approx(1)
    yaw, pitch, roll = angles(frame.orientation)
    off = [math.remainder(a - b, 2 * math.pi) for a, b in ((yaw, turned[0]), (roll, turned[2]))]
    assert [*off, pitch - turned[1]] == pytest.approx([0, 0, 0], abs=2 * STEP)


@pytest.mark.parametrize("place", range(SIZE))
def test_a_damaged_byte_costs_its_frame_only(place):
    """Whichever byte is flipped, the frames before and after come through, and no wrong one."""
    frames = [encode(k, (0.1 * k, 0.0, 0.2), np.array([0, 0, 9.81])) for k in range(3)]
    broken = bytearray(frames[1])
    broken[place] ^= 0x40
    parser = Parser()
    found = parser.feed(b"\x12\xaa" + frames[0] + bytes(broken) + frames[2])
    assert [frame.number for frame in found] == [0, 2]


def test_angles_that_cannot_be():
    """A frame whose sum is right and whose pitch is beyond 90 degrees is damaged."""
    body = bytearray(EXAMPLE)
    body[5:7] = (9001).to_bytes(2, "little")
    body[-1] = sum(body[2:-1]) & 0xFF
    parser = Parser()
    assert parser.feed(bytes(body)) == []
    assert parser.damaged == 1


def test_a_stream_in_pieces():
    """Frames are found however the system cuts the stream."""
    stream, parser, found = EXAMPLE * 5, Parser(), []
    for k in range(0, len(stream), 7):
        found += parser.feed(stream[k : k + 7])
    assert len(found) == 5
    assert parser.damaged == 0
