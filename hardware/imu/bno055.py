r"""The BNO055 over its serial port: registers read and written, and what they mean.

    request(DATA, DATA_SIZE)                        # aa 01 08 20
    [payload] = Parser().feed(b"\xbb\x20" + bytes(32))
    sample(payload).gyro                            # rad/s, (3,)

The host asks, the part answers: AA 01 register length is answered by BB length bytes, a write AA 00
register length bytes by EE 01; EE and another number is an error, such as 07 while the part was
busy, and the host asks again. Numbers are signed, of 16 bits, least byte first. In its mode IMU the
part fuses gyro and accelerometer 100 times a second; its heading is counted from its start. There
is no checksum: an answer counts only if its quaternion has the length 1.

Source: Bosch, "BNO055 Data sheet" (BST-BNO055-DS000), 3.3 operation modes, 3.6.1 units, 4.2
register map, 4.7 UART protocol.
"""

import math
import struct
from typing import NamedTuple

import numpy as np

BAUD = 115200
READ, WRITE = b"\xaa\x01", b"\xaa\x00"
ANSWER, STATUS = 0xBB, 0xEE
OK, BUSY = 0x01, 0x07
CHIP_ID, PAGE, UNITS, MODE = 0x00, 0x07, 0x3B, 0x3D  # registers
THE_CHIP = 0xA0
CONFIG, IMU = 0x00, 0x08  # modes
RADIANS = 0x02  # of the units: gyro in rad/s, acceleration in m/s^2
DATA, DATA_SIZE = 0x08, 32  # acceleration, field, gyro, angles, quaternion
ACCELERATION_STEP, GYRO_STEP, QUATERNION_STEP = 1 / 100, 1 / 900, 1 / (1 << 14)
LENGTH_ERROR = 0.01  # of the quaternion, that rounding and fusion explain
SWITCH = 0.03  # s that a change of mode takes at most


class Sample(NamedTuple):
    """The part's readings along its own axes."""

    orientation: np.ndarray  # how it is turned in the world, a unit quaternion w x y z, (4,)
    acceleration: np.ndarray  # gravity in it [m/s^2], (3,)
    gyro: np.ndarray  # angular velocity [rad/s], (3,)


def request(register: int, size: int) -> bytes:
    """Return the bytes that ask for registers."""
    return READ + bytes([register, size])


def command(register: int, data: bytes) -> bytes:
    """Return the bytes that write registers."""
    return WRITE + bytes([register, len(data)]) + data


def sample(payload: bytes) -> Sample | None:
    """Return the readings in the registers from DATA on; None if they are impossible."""
    values = struct.unpack("<16h", payload)
    quaternion = np.array(values[12:16]) * QUATERNION_STEP
    length = math.sqrt(float(quaternion @ quaternion))
    if abs(length - 1) > LENGTH_ERROR:
        return None
    acceleration = np.array(values[0:3]) * ACCELERATION_STEP
    return Sample(quaternion / length, acceleration, np.array(values[6:9]) * GYRO_STEP)


def payload(seen: Sample) -> bytes:
    """Return the registers from DATA on that say this; the magnetic field and angles are 0."""
    parts = (seen.acceleration / ACCELERATION_STEP, np.zeros(3), seen.gyro / GYRO_STEP, np.zeros(3))
    steps = np.rint(np.concatenate([*parts, seen.orientation / QUATERNION_STEP]))
    return struct.pack("<16h", *np.clip(steps, -32768, 32767).astype(int).tolist())


class Parser:
    """Cuts a stream of bytes into answers; what is not an answer is counted."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.damaged = 0
        self.status: int | None = None  # the newest answer to a write, or error

    def clear(self) -> None:
        """Forget an unfinished answer."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the payloads of the answers that they complete."""
        buffer, found = self._buffer, []
        buffer += data
        while len(buffer) > 1:
            head, number = buffer[0], buffer[1]
            if head == STATUS:
                self.status = number
                self.damaged += number != OK
                del buffer[:2]
            elif head != ANSWER:
                self.damaged += 1
                del buffer[:1]
            elif len(buffer) < 2 + number:
                break
            else:
                found.append(bytes(buffer[2 : 2 + number]))
                del buffer[: 2 + number]
        return found
