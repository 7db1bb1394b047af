"""Frames of the BNO080, BNO085 and BNO086 in their mode UART-RVC: bytes, and what they say.

    [frame] = Parser().feed(bytes.fromhex("aaaade010092ff25088dfeecffd103000000e7"))
    frame.orientation, frame.acceleration           # quaternion w x y z; m/s^2

The part sends 100 frames a second at 115200 bits/s unasked if its pins PS0 and PS1 are 1 and 0. A
frame is AA AA, a counter of 8 bits, yaw, pitch and roll in steps of 0.01 degree, acceleration along
x, y and z in mg, three reserved bytes, and the low byte of the sum of all after the header; numbers
are signed, of 16 bits, least byte first. Yaw is counted from the part's start. Turning by yaw about
z, then by pitch about the new y, then by roll about the new x leads from the world's axes (z up) to
the part's. The acceleration has gravity in it: at rest it is 9.81 m/s^2 upwards. A frame has no
angular velocity.

Source: CEVA, "BNO08X Data Sheet" (1000-3927), 1.3.5.2 UART-RVC protocol, with the example above.
"""

import math
import struct
from typing import NamedTuple

import numpy as np

BAUD = 115200
RATE = 100.0  # frames a second
SIZE = 19  # bytes
HEADER = b"\xaa\xaa"
STEP = math.radians(0.01)  # rad, of an angle
MILLI_G = 9.80665e-3  # m/s^2
UPRIGHT = 1 - 1e-9  # of the sine of pitch
HALF_TURN = 18000  # steps: the most that yaw and roll can be; pitch half as much


class Frame(NamedTuple):
    """One frame: its number, 0 to 255, angles [rad] and acceleration [m/s^2], (3,)."""

    number: int
    yaw: float
    pitch: float
    roll: float
    acceleration: np.ndarray

    @property
    def orientation(self) -> np.ndarray:
        """The part's orientation in the world, a unit quaternion w x y z, (4,)."""
        (cy, cp, cr), (sy, sp, sr) = (
            [f(a / 2) for a in (self.yaw, self.pitch, self.roll)] for f in (math.cos, math.sin)
        )
        return np.array(
            [
                cy * cp * cr + sy * sp * sr,
                cy * cp * sr - sy * sp * cr,
                cy * sp * cr + sy * cp * sr,
                sy * cp * cr - cy * sp * sr,
            ]
        )


def angles(orientation: np.ndarray) -> tuple[float, float, float]:
    """Return yaw, pitch and roll [rad] of a unit quaternion w x y z, (4,).

    Where x points up or down, yaw and roll turn about the same axis: then roll is 0.
    """
    w, x, y, z = orientation
    if abs(up := 2 * (w * y - z * x)) > UPRIGHT:
        return math.copysign(2.0, -up) * math.atan2(x, w), math.copysign(math.pi / 2, up), 0.0
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    pitch = math.asin(up)
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return yaw, pitch, roll


def encode(number: int, turned: tuple[float, float, float], acceleration: np.ndarray) -> bytes:
    """Return a frame's bytes.

    Args:
        number: of the frame; its low 8 bits are sent.
        turned: yaw, pitch and roll [rad].
        acceleration: along the part's axes [m/s^2], (3,); what 16 bits cannot hold is cut.
    """
    steps = [round(math.remainder(angle, 2 * math.pi) / STEP) for angle in turned]
    milli = np.clip(np.rint(np.asarray(acceleration) / MILLI_G), -32768, 32767).astype(int)
    body = struct.pack("<B6h3x", number % 256, *steps, *milli.tolist())
    return HEADER + body + bytes([sum(body) & 0xFF])


class Parser:
    """Cuts a stream of bytes into frames; what is damaged is counted and never a value."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.damaged = 0

    def clear(self) -> None:
        """Forget an unfinished frame."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes and return the good frames that they complete."""
        buffer, frames = self._buffer, []
        buffer += data
        while True:
            start = buffer.find(HEADER)
            if start < 0:
                del buffer[: len(buffer) - buffer.endswith(HEADER[:1])]
                return frames
            del buffer[:start]
            if len(buffer) < SIZE:
                return frames
            frame = _decode(bytes(buffer[:SIZE]))
            self.damaged += frame is None
            del buffer[: SIZE if frame else 1]  # a false header may hide a true one
            if frame:
                frames.append(frame)


def _decode(raw: bytes) -> Frame | None:
    """Return the frame of these bytes; None if its sum or an angle cannot be."""
    number, *values = struct.unpack_from("<B6h", raw, 2)
    yaw, pitch, roll = values[:3]
    whole = abs(yaw) <= HALF_TURN and abs(roll) <= HALF_TURN and abs(pitch) <= HALF_TURN / 2
    if not whole or sum(raw[2:-1]) & 0xFF != raw[-1]:
        return None
    felt = np.array(values[3:]) * MILLI_G
    return Frame(number, yaw * STEP, pitch * STEP, roll * STEP, felt)
