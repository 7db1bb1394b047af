"""The IMU over a pseudo terminal: values, mounting, and what becomes of bad and missing frames."""

import contextlib
import fcntl
import os
import sys
import termios
import time
import tty
from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.config import Robot, load_robot, make_robot
from hardware.emulator.imu import EmulatedImu
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, SerialPortError
from hardware.imu import rvc
from hardware.imu.reader import FIRST, STALE, SerialImu
from hardware.parts import Imu
from tests.hardware.test_multi_bus import data_of

UPRIGHT = (0.5, 0.5, -0.5, 0.5)  # its x axis points down
HELD = 4000  # bytes that a terminal surely holds for who reads it


class Part:
    """The near end of a pseudo terminal that sends frames as the clock goes on."""

    def __init__(self, imu: Imu) -> None:
        self.master, self._slave = os.openpty()
        for end in (self.master, self._slave):
            tty.setraw(end)
        os.set_blocking(self.master, False)
        self.number, self.turned, self.sends, self.damage = 0, (0.0, 0.1, -0.2), True, False
        self.clock = VirtualClock()
        self.imu = SerialImu(replace(imu, port=os.ttyname(self._slave)), self.clock)
        self._sleep = self.clock.sleep_until
        self.clock.sleep_until = self.sleep_until

    def sleep_until(self, moment: float) -> None:
        """Let the clock go on, frame by frame."""
        while (due := (self.number + 1) / rvc.RATE) <= moment:
            self._sleep(due)
            self.number += 1
            frame = bytearray(rvc.encode(self.number, self.turned, np.array([0, 0, 9.80665])))
            frame[9] ^= self.damage
            if self.sends:
                self._send(bytes(frame))
        self._sleep(moment)

    def _send(self, frame: bytes) -> None:
        """Write a frame and wait until it can be read: the system hands it over when it likes."""
        due = self._waiting() + len(frame)
        with contextlib.suppress(BlockingIOError):  # nobody reads, and it is full
            os.write(self.master, frame)
        end = time.monotonic() + 5.0
        while self._waiting() < due < HELD and time.monotonic() < end:
            time.sleep(1e-4)

    def _waiting(self) -> int:
        """Return how many bytes can be read now."""
        return int.from_bytes(fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4)), sys.byteorder)

    def wait(self, seconds: float) -> None:
        """Let the clock go on."""
        self.sleep_until(self.clock.now() + seconds)

    def close(self) -> None:
        """Give the pseudo terminal back."""
        self.imu.close()
        os.close(self.master)
        os.close(self._slave)


@pytest.fixture
def part() -> Iterator[Part]:
    """A part that lies as its site does."""
    made = Part(Imu("bno085-rvc", "imu"))
    yield made
    made.close()


def test_values_and_the_heading(part):
    """Orientation and acceleration are the frame's; the heading is counted from the start."""
    part.turned = 1.0, 0.1, -0.2
    part.imu.open()
    first = part.imu.measure(part.clock.now())
    assert rvc.angles(first["orientation"]) == pytest.approx((0, 0.1, -0.2), abs=rvc.STEP)
    assert first["acceleration"] == pytest.approx([0, 0, 9.80665])
    part.turned = 1.3, 0.0, 0.0
    part.wait(0.02)
    second = part.imu.measure(part.clock.now())
    assert rvc.angles(second["orientation"]) == pytest.approx((0.3, 0, 0), abs=2 * rvc.STEP)
    part.imu.return_to_start(part.clock.now())
    again = part.imu.measure(part.clock.now())
    assert rvc.angles(again["orientation"])[0] == pytest.approx(0, abs=1e-9)
    assert first["imu_lost"] == 0


def test_a_stopped_or_damaged_stream_is_refused(part):
    """Values are held for a tenth of a second, damaged frames are never taken, then it raises."""
    part.imu.open()
    part.imu.measure(part.clock.now())
    part.damage, part.turned = True, (0.0, 1.0, 0.0)
    part.wait(STALE / 2)
    held = part.imu.measure(part.clock.now())
    assert rvc.angles(held["orientation"])[1] == pytest.approx(0.1, abs=rvc.STEP)
    assert held["imu_lost"] == 5
    part.damage = False
    part.wait(0.02)
    seen = part.imu.measure(part.clock.now())
    assert rvc.angles(seen["orientation"])[1] == pytest.approx(1.0, abs=rvc.STEP)
    assert part.imu.missing == 5
    part.sends = False
    part.wait(STALE * 1.2)
    with pytest.raises(SerialPortError, match=r"no good frame for 1\d\d ms \(5 missing, 5 damaged"):
        part.imu.measure(part.clock.now())


def test_after_a_pause_what_waited_is_thrown_away(part):
    """A port that nobody read for long is full of old frames: the next new one counts."""
    part.imu.open()
    part.wait(60.0)
    part.turned = 0.0, 0.7, 0.0
    seen = part.imu.measure(part.clock.now())
    assert rvc.angles(seen["orientation"])[1] == pytest.approx(0.7, abs=rvc.STEP)
    assert seen["imu_lost"] == 0


def test_what_is_no_imu_is_refused(part):
    """Silence, noise, and a port that is not there or held: what came, and what to check."""
    part.sends = False
    with pytest.raises(
        SerialPortError, match=r"0 bytes, 0 good frames and 0 damaged ones came in 1 s; "
    ):
        part.imu.open()
    assert part.clock.now() == pytest.approx(FIRST, abs=0.1)
    part.sends, part.damage = True, True
    with pytest.raises(SerialPortError, match=r"\d{4} bytes, 0 good frames and \d+ damaged ones"):
        part.imu.open()
    part.damage = False
    part.imu.open()
    with pytest.raises(SerialPortError, match="is held by an open driver of this program"):
        SerialImu(part.imu.imu, part.clock).open()
    with pytest.raises(SerialPortError, match="IMU: /dev/no-such: no such port"):
        SerialImu(replace(part.imu.imu, port="/dev/no-such"), part.clock).open()


def imu_robot(mount: tuple[float, ...]) -> Robot:
    """Return quad8 with its IMU turned in its site."""
    data = data_of("quad8")
    return make_robot(data | {"imu": data["imu"] | {"mount": list(mount)}})


@pytest.mark.parametrize("mount", [(1.0, 0.0, 0.0, 0.0), UPRIGHT, (0.8, 0.0, 0.6, 0.0)])
def test_the_emulated_part_tells_what_the_model_senses(mount):
    """However it is mounted, the reader gives the site's own orientation and acceleration back."""
    world = EmulatedRobot(imu_robot(mount), seed=0)
    turn = np.array([0.96, 0.2, -0.15, 0.12])
    world.mechanics.data.qpos[3:7] = turn / np.linalg.norm(turn)
    world.mechanics.data.qvel[3:6] = 1.0, 0.5, -2.0
    mujoco.mj_forward(world.mechanics.model, world.mechanics.data)
    imu, model = EmulatedImu(world), world.mechanics.data
    for arrival, data in imu.until(0.6):
        number = round(arrival * rvc.RATE - rvc.SIZE * 10 / rvc.BAUD * rvc.RATE)
        [frame] = rvc.Parser().feed(data)
        assert frame.number == number
        assert world.time == pytest.approx(number / rvc.RATE, abs=0.0011)
        assert world.robot.imu is not None
        reader = SerialImu(world.robot.imu, VirtualClock())
        reader._heading = -imu._start
        seen = reader._values(frame)
        truth = np.zeros(4)
        mujoco.mju_mat2Quat(truth, model.site("imu").xmat)
        assert abs(seen["orientation"] @ truth) == pytest.approx(1, abs=1e-6)
        felt = model.sensor("accelerometer").data
        assert seen["acceleration"] == pytest.approx(felt, abs=2 * rvc.MILLI_G)
    assert abs(rvc.angles(truth)[1]) + abs(rvc.angles(truth)[2]) > 0.05  # it fell over


def test_a_held_robot_feels_its_weight():
    """While a stand holds it, the part measures gravity upwards; once it is let go, its fall."""
    world = EmulatedRobot(imu_robot(UPRIGHT))
    world.hold()
    imu = EmulatedImu(world)
    [*_, (_, data)] = imu.until(0.2)
    [frame] = rvc.Parser().feed(data)
    assert np.linalg.norm(frame.acceleration) == pytest.approx(9.81, abs=3 * rvc.MILLI_G)
    assert world.robot.imu is not None
    level = SerialImu(world.robot.imu, VirtualClock())._values(frame)["acceleration"]
    assert level == pytest.approx([0, 0, 9.81], abs=3 * rvc.MILLI_G)
    world.mechanics.data.qpos[2] = 1.0
    world.mechanics.hold(np.zeros(8, bool))
    world._held[:] = False
    [*_, (_, data)] = imu.until(0.3)
    [frame] = rvc.Parser().feed(data)
    assert np.linalg.norm(frame.acceleration) < 1.0


def test_what_an_imu_cannot_be():
    """An unknown part or site, a mount that is no turn, a port without an IMU or of the servos."""
    data = data_of("quad8")

    def made(**changes) -> Robot:
        return make_robot(data | {"imu": data["imu"] | changes})

    with pytest.raises(RobotError, match=r"unknown part 'bno085-rv' \(did you mean 'bno085-rvc'"):
        made(model="bno085-rv")
    with pytest.raises(RobotError, match="is not a unit quaternion"):
        made(mount=[1, 1, 0, 0])
    with pytest.raises(RobotError, match="is not 4 numbers"):
        made(mount=[1, 0, 0])
    with pytest.raises(RobotError, match="no site 'head'; it has 'imu'"):
        EmulatedRobot(made(site="head"))
    with pytest.raises(RobotError, match="its file names no IMU"):
        load_robot("bench1").with_imu_at("/dev/x")
    with pytest.raises(RobotError, match="is the port of its servos"):
        load_robot("quad8").at("/dev/x").with_imu_at("/dev/x")
