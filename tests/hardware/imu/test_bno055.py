"""The BNO055: bytes against its data sheet, and the emulated part through the reader."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.emulator.imu import EmulatedBno055
from hardware.emulator.world import EmulatedRobot
from hardware.errors import SerialPortError
from hardware.imu import bno055, reader, rvc
from hardware.imu.reader import STALE, AskedImu
from tests.hardware.imu.test_reader import UPRIGHT, imu_robot


def test_instructions_are_the_data_sheet_s():
    """Reading and writing registers: AA, 01 or 00, register, length, and what is written."""
    assert bno055.request(0x08, 32).hex() == "aa010820"
    assert bno055.command(0x3D, b"\x08").hex() == "aa003d0108"


def test_values_are_the_data_sheet_s():
    """1 m/s^2 is 100 steps, 1 rad/s 900, and a quaternion's 1 is 2^14."""
    body = bytes.fromhex("0000 0000 d503" + "000000000000" + "8403 0000 7cfc" + "000000000000")
    payload = body + bytes.fromhex("412d 412d 0000 0000")
    [same] = bno055.Parser().feed(b"\xbb\x20" + payload)
    seen = bno055.sample(same)
    assert seen is not None
    assert seen.acceleration == pytest.approx([0, 0, 9.81])
    assert seen.gyro == pytest.approx([1, 0, -1])
    assert seen.orientation == pytest.approx([math.sqrt(0.5), math.sqrt(0.5), 0, 0], abs=1e-4)
    assert bno055.sample(bno055.payload(seen)) is not None
    assert bno055.payload(seen)[:18] == payload[:18]


def test_what_is_no_answer_is_never_a_value():
    """Errors, noise and answers cut in two are told apart; a false quaternion is no sample."""
    parser = bno055.Parser()
    whole = b"\xbb\x02\x12\x34"
    assert parser.feed(b"\xee\x07\x55" + whole[:3]) == []
    assert parser.feed(whole[3:]) == [b"\x12\x34"]
    assert (parser.status, parser.damaged) == (bno055.BUSY, 2)
    assert bno055.sample(bytes(32)) is None


class Wire:
    """A serial port with an emulated BNO055 at its other end, in virtual time."""

    def __init__(self, part: EmulatedBno055, clock: VirtualClock) -> None:
        self.part, self._clock, self.mute, self.busy = part, clock, False, 0
        self._coming: list[tuple[float, bytes]] = []

    def write(self, data: bytes) -> None:
        """Send bytes to the part; a busy one answers with its error."""
        if self.busy:
            self.busy -= 1
            self._coming.append((self._clock.now(), bytes([bno055.STATUS, bno055.BUSY])))
        elif not self.mute:
            self.part.take(data, self._clock.now(), bno055.BAUD)
            self._coming += self.part.until(self._clock.now())

    def read(self, size: int) -> bytes:
        """Return what has come."""
        due = [data for when, data in self._coming if when <= self._clock.now()]
        self._coming = [pair for pair in self._coming if pair[0] > self._clock.now()]
        return b"".join(due)

    def reset_input_buffer(self) -> None:
        """Forget what has come."""
        self.read(0)

    def close(self) -> None:
        """Do nothing."""


@pytest.fixture(params=[(1.0, 0.0, 0.0, 0.0), UPRIGHT])
def imu(request, monkeypatch):
    """A quad8 that turns and falls, with an open BNO055 mounted in two ways: (reader, wire)."""
    robot = imu_robot(request.param)
    assert robot.imu is not None
    robot = replace(robot, imu=replace(robot.imu, model="bno055", port="wire"))
    world, clock = EmulatedRobot(robot, seed=0), VirtualClock()
    world.mechanics.data.qvel[3:6] = 1.0, 0.5, -2.0
    mujoco.mj_forward(world.mechanics.model, world.mechanics.data)
    wire = Wire(EmulatedBno055(world), clock)
    monkeypatch.setattr(reader.serial, "Serial", lambda *_, **__: wire)
    assert robot.imu is not None
    made = AskedImu(robot.imu, clock)
    made.open()
    return made, wire, world, clock


def test_the_reader_tells_what_the_model_senses(imu):
    """Orientation, gyro and acceleration in the site's axes, of the step before, never waited for.

    The truth is kept at each question; the heading is counted from the first value.
    """
    part, _, world, clock = imu
    truth, model = [], world.mechanics.data
    model.qpos[2], model.qvel[3:6] = 5.0, (1.0, 0.5, -2.0)  # it falls and turns
    for step in range(30):
        clock.sleep_until(clock.now() + 0.02)
        begin = clock.now()
        seen = part.measure(begin)
        assert clock.now() == begin
        site = np.zeros(4)
        mujoco.mju_mat2Quat(site, model.site("imu").xmat)
        sensors = model.sensor("imu gyro").data, model.sensor("imu acceleration").data
        truth.append((site, *(each.copy() for each in sensors)))
        if step == 0:
            continue
        then, gyro, felt = truth[-2]
        assert seen["gyro"] == pytest.approx(gyro, abs=0.01)
        assert seen["acceleration"] == pytest.approx(felt, abs=0.02)
        pitch_roll = rvc.angles(seen["orientation"])[1:]
        assert pitch_roll == pytest.approx(rvc.angles(then)[1:], abs=1e-3)
    assert np.abs(gyro).max() > 0.5
    assert seen["imu_lost"] == 0


def test_a_busy_or_silent_part(imu):
    """An error is asked again and counted; silence is refused after a tenth of a second."""
    part, wire, _, clock = imu
    clock.sleep_until(clock.now() + 0.02)
    part.measure(clock.now())
    wire.busy = 1
    for _ in range(3):
        clock.sleep_until(clock.now() + 0.02)
        seen = part.measure(clock.now())
    assert seen["imu_lost"] == 1
    wire.mute = True
    clock.sleep_until(clock.now() + 0.02)
    part.measure(clock.now())
    with pytest.raises(SerialPortError, match=r"IMU at wire: no good frame for 1\d\d ms"):
        for _ in range(10):
            clock.sleep_until(clock.now() + STALE / 5)
            part.measure(clock.now())


def test_no_part_at_all(imu):
    """A write that nobody answers names the register and the pins."""
    part, wire, _, _ = imu
    part.close()
    wire.mute = True
    with pytest.raises(SerialPortError, match="no answer to a write of register 0x3d; check supp"):
        part.open()
