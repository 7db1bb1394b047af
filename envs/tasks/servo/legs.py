"""Legs of two equal links: swing and bend for hip and knee, and the rhythm that they share.

A leg's hip and knee turn about the same axis; at 0 the leg hangs straight. Its foot is at the
distance 2 l cos(bend) from the hip, turned forward by the swing:

    hip = bend - swing        knee = -2 bend

`extension` lengthens the leg: bend = bend at home - extension. These are the coordinates of the
Minitaur's legs (Tan et al. 2018, "Sim-to-Real: Learning Agile Locomotion for Quadruped Robots").
"""

from typing import Any, NamedTuple

import numpy as np

from envs.physics.arrays import Array


class Gait(NamedTuple):
    """A rhythm of legs: swing s sin(phase), extension -e cos(phase), short on the way forward."""

    frequency: float  # steps of each leg a second [1/s]
    swing: float  # s [rad]
    extension: float  # e [rad]

    def pattern(self, phase: Array, xp: Any = np) -> tuple[Array, Array]:
        """Return swings and extensions [rad] at phases [rad], each of their shape.

        Args:
            phase: an array of the namespace `xp`.
            xp: the Array API's namespace; `joints`, `spread` and `roll_pitch` take one, too.
        """
        return self.swing * xp.sin(phase), -self.extension * xp.cos(phase)


def joints(swing: Array, extension: Array, home: float, xp: Any = np) -> Array:
    """Return hip and knee angles of l legs [rad], (n, 2 l): hip, knee, hip, knee, ...

    Args:
        swing: the swing of each leg, forward [rad], (n, l).
        extension: the extension of each leg [rad], (n, l).
        home: bend of a leg at extension 0 [rad].
        xp: the arrays' namespace.
    """
    bend = home - extension
    return xp.stack([bend - swing, -2.0 * bend], axis=-1).reshape(len(swing), -1)


def spread(abduction: Array, angles: Array, xp: Any = np) -> Array:
    """Return abduction, hip and knee of l legs [rad], (n, 3 l), of (n, l) and joints (n, 2 l)."""
    legs = angles.reshape(*abduction.shape, 2)
    return xp.concat([abduction[..., None], legs], axis=-1).reshape(len(angles), -1)


def reach(angles: np.ndarray, link: float) -> np.ndarray:
    """Return how far below its hip each foot is [m], (n, l), of joints (n, 2 l), links [m]."""
    hip, knee = angles[:, 0::2], angles[:, 1::2]
    return link * (np.cos(hip) + np.cos(hip + knee))


def roll_pitch(quaternion: Array, xp: Any = np) -> Array:
    """Return roll about x and pitch about y [rad], (n, 2), of unit quaternions w x y z, (n, 4)."""
    w, x, y, z = quaternion.T
    roll = xp.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = xp.asin(xp.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return xp.stack([roll, pitch], axis=1)
