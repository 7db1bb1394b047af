"""The IMU of a robot's file, read over its serial port.

    imu = SerialImu(robot.imu, RealClock())
    imu.open()                              # SerialPortError: what came instead of frames
    imu.measure(now)["orientation"]         # of the site, w x y z; "acceleration" [m/s^2]

Every read takes what has come since the last, and the newest frame counts: it is up to 10 ms old,
and 1.7 ms more for its way over the wire. Damaged frames and gaps in their numbers are counted. A
frame that is older than `STALE` is refused, which stops the robot. The heading is counted
from where an episode starts, for the part counts it from its own start.
"""

import math
from collections.abc import Mapping

import mujoco
import numpy as np
import serial

from hardware.clock import Clock, RealClock
from hardware.config import Robot
from hardware.errors import SerialPortError
from hardware.imu import bno055, rvc
from hardware.parts import Imu
from hardware.port_lock import PortLock
from hardware.serial_ports import explain_failure

STALE = 0.1  # s, ten frames: older ones are refused
PAUSED = 0.5  # s without a read after which the system may have thrown frames away
FIRST = 1.0  # s that the first frames are waited for
LATE = 0.05  # s after which a question is asked again
ENOUGH = 3  # good frames in a row that show the part and its mode


class SerialImu:
    """An IMU at a serial port; see `hardware.body.BodySensors`.

    Args:
        imu: the part, its place and its port.
        clock: source of the time.
    """

    names: tuple[str, ...] = ("orientation", "acceleration")
    usual = f"sends {rvc.RATE:.0f} a second"  # of its frames

    def __init__(self, imu: Imu, clock: Clock) -> None:
        self.imu, self._clock = imu, clock
        self._parser = rvc.Parser()
        self._lock = PortLock(str(imu.port))
        self._port: serial.Serial | None = None
        self._frame: rvc.Frame | None = None
        self._came = self._read = -math.inf  # s: the last frame, the last read
        self._heading: float | None = None  # rad, of the part where the episode started
        self.missing = 0  # frames whose numbers were left out

    def open(self) -> None:
        """Open the port and wait for good frames.

        Raises:
            SerialPortError: the port cannot be used, or sends no frames of this part.
        """
        if self._port is not None:
            return
        try:
            self._lock.take()
            self._port = serial.Serial(self.imu.port, rvc.BAUD, timeout=0)
            self._port.reset_input_buffer()
            self._prepare()
            self._wait_for(ENOUGH, FIRST)
        except (OSError, serial.SerialException) as error:
            self.close()
            raise SerialPortError(f"IMU: {explain_failure(str(self.imu.port), error)}") from None
        except SerialPortError:
            self.close()
            raise

    def _prepare(self) -> None:
        """Set the part up; one in this mode sends by itself."""

    @property
    def _place(self) -> str:
        return f"IMU at {self.imu.port}"

    def _wait_for(self, wanted: int, seconds: float) -> None:
        """Read until a number of good frames came."""
        clock, end, got, count = self._clock, self._clock.now() + seconds, 0, 0
        damaged = self._parser.damaged
        while got < wanted:
            if clock.now() > end:
                bad = self._parser.damaged - damaged
                raise SerialPortError(
                    f"{self._place}: {count} bytes, {got} good frames and {bad} damaged ones came "
                    f"in {seconds:g} s; a {self.imu.model} {self.usual} at "
                    f"{rvc.BAUD} bits/s: check its supply, cable and mode pins"
                )
            data = self._bytes()
            count += len(data)
            got += self._take(data)
            clock.sleep_until(clock.now() + 0.002)

    def _bytes(self) -> bytes:
        assert self._port is not None
        self._read = self._clock.now()
        return self._port.read(4096)

    def _take(self, data: bytes) -> int:
        """Keep the newest frame of these bytes, and return how many good ones there were."""
        frames = self._parser.feed(data)
        for frame in frames:
            if self._frame is not None:
                self.missing += (frame.number - self._frame.number - 1) % 256
            self._frame = frame
        if frames:
            self._came = self._clock.now()
        return len(frames)

    def measure(self, now: float) -> Mapping[str, np.ndarray]:
        """Return the newest values: `orientation` (4,), `acceleration` (3,), and counts.

        Raises:
            SerialPortError: no good frame came for `STALE`, or the cable is out.
        """
        if self._port is None:
            raise SerialPortError(f"{self._place} is not open")
        try:
            if self._clock.now() - self._read > PAUSED:
                self._begin_again()
            self._take(self._bytes())
        except (OSError, serial.SerialException) as error:
            raise SerialPortError(
                f"{self._place}: the port is gone ({error}); is the cable in?"
            ) from None
        age = self._clock.now() - self._came
        values = self._newest()
        if values is None or age > STALE:
            raise SerialPortError(
                f"{self._place}: no good frame for {age * 1e3:.0f} ms ({self.missing} missing, "
                f"{self._parser.damaged} damaged so far); check its cable"
            )
        return values

    def _forget(self) -> None:
        """Hold no value any more."""
        self._frame = None

    def _newest(self) -> dict[str, np.ndarray] | None:
        return None if self._frame is None else self._values(self._frame)

    def _begin_again(self) -> None:
        """After a pause what waits is old, and what came last may be lost."""
        assert self._port is not None
        self._port.reset_input_buffer()
        self._parser.clear()
        self._forget()
        self._wait_for(1, STALE)

    def _values(self, frame: rvc.Frame) -> dict[str, np.ndarray]:
        """Return a frame's values in the axes of the site."""
        self._heading = frame.yaw if self._heading is None else self._heading
        level = frame._replace(yaw=frame.yaw - self._heading).orientation
        lost = self.missing + self._parser.damaged
        return {
            "orientation": undo_mounting(level, self.imu.mount),
            "acceleration": rotated(frame.acceleration, self.imu.mount),
            "imu_lost": np.array([float(lost)]),
        }

    def return_to_start(self, now: float) -> None:
        """Begin an episode: set the present heading to 0."""
        self._heading = None

    def close(self) -> None:
        """Close the port; does nothing the second time."""
        port, self._port = self._port, None
        if port is not None:
            port.close()
        self._lock.release()


class AskedImu(SerialImu):
    """A BNO055 at a serial port: it is asked, and what it answered last counts.

    Each `measure` takes the answer to the question of the one before, and asks again, without
    waiting. So a value is as old as a control step, and 10 ms more that the part takes to make one.
    """

    names = ("orientation", "gyro", "acceleration")
    usual = "answers each question"

    def __init__(self, imu: Imu, clock: Clock) -> None:
        super().__init__(imu, clock)
        self._answers = self._parser = bno055.Parser()  # type: ignore[assignment]
        self._asked = -math.inf  # s, when the open question was asked
        self._sample: bno055.Sample | None = None

    def _prepare(self) -> None:
        """Choose units and the mode that fuses gyro and accelerometer."""
        for register, value in (
            (bno055.MODE, bno055.CONFIG),
            (bno055.PAGE, 0),
            (bno055.UNITS, bno055.RADIANS),
            (bno055.MODE, bno055.IMU),
        ):
            self._write(register, value)

    def _write(self, register: int, value: int) -> None:
        """Write a register and wait for its answer; a busy part gets it again."""
        assert self._port is not None
        clock, end = self._clock, self._clock.now() + FIRST
        while clock.now() < end:
            self._answers.clear()
            self._answers.status = None
            self._port.write(bno055.command(register, bytes([value])))
            due = clock.now() + 2 * bno055.SWITCH
            while self._answers.status is None and clock.now() < due:
                clock.sleep_until(clock.now() + 0.002)
                self._answers.feed(self._port.read(4096))
            if self._answers.status == bno055.OK:
                clock.sleep_until(clock.now() + bno055.SWITCH)
                return
        raise SerialPortError(
            f"{self._place}: no answer to a write of register {register:#x}; check supply, cable "
            f"and mode pins (PS1 high, PS0 low: {bno055.BAUD} bits/s)"
        )

    def _bytes(self) -> bytes:
        data = super()._bytes()
        if not data and self._clock.now() - self._asked > LATE:
            self.missing += self._asked > -math.inf
            self._answers.clear()
            self._ask()
        return data

    def _ask(self) -> None:
        assert self._port is not None
        self._port.write(bno055.request(bno055.DATA, bno055.DATA_SIZE))
        self._asked = self._clock.now()

    def _take(self, data: bytes) -> int:
        """Keep the newest answer of these bytes, ask again, and return how many good there were."""
        before, good = self._answers.damaged, 0
        for each in self._answers.feed(data):
            seen = bno055.sample(each) if len(each) == bno055.DATA_SIZE else None
            self._answers.damaged += seen is None
            good += seen is not None
            self._sample = seen or self._sample
        if good:
            self._came = self._clock.now()
        if good or self._answers.damaged > before:
            self._ask()
        return good

    def _forget(self) -> None:
        self._sample, self._asked = None, -math.inf

    def _newest(self) -> dict[str, np.ndarray] | None:
        return None if self._sample is None else self._turned(self._sample)

    def _turned(self, seen: bno055.Sample) -> dict[str, np.ndarray]:
        """Return a sample in the axes of the site, its heading counted from the start."""
        yaw = rvc.angles(seen.orientation)[0]
        self._heading = yaw if self._heading is None else self._heading
        level, back = np.zeros(4), np.array([0.0, 0.0, 1.0])
        mujoco.mju_axisAngle2Quat(level, back, -self._heading)
        orientation = np.zeros(4)
        mujoco.mju_mulQuat(orientation, level, seen.orientation)
        return {
            "orientation": undo_mounting(orientation, self.imu.mount),
            "gyro": rotated(seen.gyro, self.imu.mount),
            "acceleration": rotated(seen.acceleration, self.imu.mount),
            "imu_lost": np.array([float(self.missing + self._answers.damaged)]),
        }


READERS = {"bno085-rvc": SerialImu, "bno055": AskedImu}


def make_imu(robot: Robot) -> SerialImu | None:
    """Return the IMU at the port that a robot's file names; None if it names none."""
    if robot.imu is None or robot.imu.port is None:
        return None
    return READERS[robot.imu.model](robot.imu, RealClock())


def undo_mounting(orientation: np.ndarray, mount: tuple[float, ...]) -> np.ndarray:
    """Return the site's orientation, given the part's (4,) and how it is mounted there."""
    back, result = np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(back, np.asarray(mount))
    mujoco.mju_mulQuat(result, orientation, back)
    return result


def rotated(vector: np.ndarray, turn: tuple[float, ...]) -> np.ndarray:
    """Return a vector (3,) rotated by a unit quaternion w x y z."""
    result = np.zeros(3)
    mujoco.mju_rotVecQuat(result, np.asarray(vector, float), np.asarray(turn))
    return result
