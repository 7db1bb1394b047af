"""The IMU of an emulated robot: the frames that the real part would send, of its model's physics.

    imu = EmulatedImu(world)
    for arrival, data in imu.until(0.5):        # the robot goes on to the time of each frame
        ...

The part's own filters are not published and not modelled: orientation and acceleration are those of
`inertial.py`, to the resolution of a frame.
"""

import math
from collections.abc import Iterator

import mujoco
import numpy as np

from hardware.emulator.world import EmulatedRobot
from hardware.imu import bno055, rvc

TURN_ROUND = 0.002  # s until the BNO055 answers, an assumption
WRONG_ADDRESS = 0x04  # its error


class EmulatedImu:
    """A BNO085 in its mode UART-RVC at the site that the robot's file names.

    Args:
        world: a robot with an IMU.
    """

    def __init__(self, world: EmulatedRobot) -> None:
        assert world.robot.imu is not None
        assert world.inertial is not None
        self._world, self._inertial = world, world.inertial
        self._mount = np.array(world.robot.imu.mount)
        self._number = 0
        # rad: the part's heading is 0 where it starts
        self._start = self._turned(self._inertial.measure()["orientation"])[0]

    def until(self, time: float) -> Iterator[tuple[float, bytes]]:
        """Yield (arrival [s], bytes) of each frame that is measured up to a time [s]."""
        while (due := self._number / rvc.RATE) <= time:
            self._world.advance(due)
            yield due + rvc.SIZE * 10 / rvc.BAUD, self._frame()
            self._number += 1

    def take(self, data: bytes, moment: float, speed: int) -> None:
        """Discard what a client wrote: this part ignores its input."""

    def _turned(self, site: np.ndarray) -> tuple[float, float, float]:
        """Return the part's yaw, pitch and roll in the world [rad], of its site's orientation."""
        part = np.zeros(4)
        mujoco.mju_mulQuat(part, site, self._mount)
        return rvc.angles(part)

    def _frame(self) -> bytes:
        seen = self._inertial.measure()
        yaw, pitch, roll = self._turned(seen["orientation"])
        back, along = np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(back, self._mount)
        mujoco.mju_rotVecQuat(along, seen["acceleration"], back)
        return rvc.encode(self._number, (yaw - self._start, pitch, roll), along)


class EmulatedBno055(EmulatedImu):
    """A BNO055 at the site that the robot's file names, over its serial port.

    Assumed, as the maker does not publish it: how long it takes to answer. Registers other than
    the identity, mode, units and data hold what was written.
    """

    def __init__(self, world: EmulatedRobot) -> None:
        super().__init__(world)
        self._registers = bytearray(128)
        self._registers[bno055.CHIP_ID] = bno055.THE_CHIP
        self._typed = bytearray()
        self._answers: list[tuple[float, bytes]] = []
        self._measured = -math.inf  # s

    def until(self, time: float) -> Iterator[tuple[float, bytes]]:
        """Yield (arrival [s], bytes) of the answers to what was taken."""
        answers, self._answers = self._answers, []
        yield from answers

    def take(self, data: bytes, moment: float, speed: int) -> None:
        """Take what a client wrote at this moment [s] and speed [bits/s]."""
        if speed != bno055.BAUD:
            return
        self._world.advance(moment)
        self._typed += data
        while (answer := self._answer()) is not None:
            span = (len(data) + len(answer)) * 10 / bno055.BAUD + TURN_ROUND
            self._answers.append((moment + span, answer))

    def _answer(self) -> bytes | None:
        """Carry out the first whole instruction, and return its answer; None if there is none."""
        typed = self._typed
        while typed and typed[0] != bno055.READ[0]:
            del typed[0]
        if len(typed) < 4:
            return None
        reads, register, size = typed[1] == bno055.READ[1], typed[2], typed[3]
        whole = 4 if reads else 4 + size
        if len(typed) < whole:
            return None
        written = bytes(typed[4:whole])
        del typed[:whole]
        if register + size > len(self._registers) or not size:
            return bytes([bno055.STATUS, WRONG_ADDRESS])
        if reads:
            self._refresh()
            return bytes([bno055.ANSWER, size]) + bytes(self._registers[register : register + size])
        if register != bno055.CHIP_ID:
            self._registers[register : register + size] = written
        return bytes([bno055.STATUS, bno055.OK])

    def _refresh(self) -> None:
        """Take over a new measurement, in the part's mode; otherwise the registers stay."""
        if self._registers[bno055.MODE] & 0xF != bno055.IMU:
            return
        if self._world.time - self._measured < 1 / rvc.RATE:
            return
        self._measured = self._world.time
        seen, back = self._inertial.measure(), np.zeros(4)
        mujoco.mju_negQuat(back, self._mount)
        part, level, turned = np.zeros(4), np.zeros(4), np.zeros(4)
        mujoco.mju_mulQuat(part, seen["orientation"], self._mount)
        mujoco.mju_axisAngle2Quat(level, np.array([0.0, 0.0, 1.0]), -self._start)
        mujoco.mju_mulQuat(turned, level, part)
        along = {name: np.zeros(3) for name in ("acceleration", "gyro")}
        for name, vector in along.items():
            mujoco.mju_rotVecQuat(vector, seen[name], back)
        data = bno055.payload(
            bno055.Sample(turned, along["acceleration"], self._own(along["gyro"]))
        )
        self._registers[bno055.DATA : bno055.DATA + bno055.DATA_SIZE] = data

    def _own(self, gyro: np.ndarray) -> np.ndarray:
        """Return an angular velocity so that it is written in the unit that was chosen."""
        radians = self._registers[bno055.UNITS] & bno055.RADIANS
        return gyro if radians else np.degrees(gyro) * 16 * bno055.GYRO_STEP


EMULATED = {"bno085-rvc": EmulatedImu, "bno055": EmulatedBno055}


def make_emulated_imu(world: EmulatedRobot) -> EmulatedImu:
    """Return the emulated part that a robot's file names."""
    assert world.robot.imu is not None
    return EMULATED[world.robot.imu.model](world)
