"""Legs of two equal links: swing and bend for hip and knee, and the rhythm that they share.

A leg's hip and knee turn about the same axis; at 0 the leg hangs straight. Its foot is at the
distance 2 l cos(bend) from the hip, turned forward by the swing:

    hip = bend - swing        knee = -2 bend

`extension` lengthens the leg: bend = bend at home - extension. These are the coordinates of the
Minitaur's legs (Tan et al. 2018, "Sim-to-Real: Learning Agile Locomotion for Quadruped Robots").
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Gait(NamedTuple):
    """A rhythm of legs: swing s sin(phase), extension -e cos(phase), short on the way forward."""

    frequency: float  # steps of each leg a second [1/s]
    swing: float  # s [rad]
    extension: float  # e [rad]

    def pattern(self, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return swings and extensions [rad] at phases [rad], each of their shape."""
        return self.swing * np.sin(phase), -self.extension * np.cos(phase)


def joints(swing: np.ndarray, extension: np.ndarray, home: float) -> np.ndarray:
    """Return hip and knee angles of l legs [rad], (n, 2 l): hip, knee, hip, knee, ...

    Args:
        swing: the swing of each leg, forward [rad], (n, l).
        extension: the extension of each leg [rad], (n, l).
        home: bend of a leg at extension 0 [rad].
    """
    bend = home - extension
    return np.stack([bend - swing, -2.0 * bend], axis=-1).reshape(len(swing), -1)


def spread(abduction: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return abduction, hip and knee of l legs [rad], (n, 3 l), of (n, l) and joints (n, 2 l)."""
    legs = angles.reshape(*abduction.shape, 2)
    return np.concatenate([abduction[..., None], legs], axis=-1).reshape(len(angles), -1)


def reach(angles: np.ndarray, link: float) -> np.ndarray:
    """Return how far below its hip each foot is [m], (n, l), of joints (n, 2 l), links [m]."""
    hip, knee = angles[:, 0::2], angles[:, 1::2]
    return link * (np.cos(hip) + np.cos(hip + knee))


def roll_pitch(quaternion: np.ndarray) -> np.ndarray:
    """Return roll about x and pitch about y [rad], (n, 2), of unit quaternions w x y z, (n, 4)."""
    w, x, y, z = quaternion.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch], axis=1)
