"""The motion of a servo's goal: at once, or with limited speed and acceleration.

    profile velocity 0               at once, whatever the acceleration
    profile acceleration 0           a rectangle of speed
    both                             a trapezoid; a triangle where the way is too short for it

A time-based profile's registers are the time of the whole motion and of its acceleration.
Source: the chapter on profiles in the makers' manuals.
"""

import math

import numpy as np

from hardware.emulator.memory import ControlTable

TIMED = 4  # bit of the drive mode
MILLISECOND = 1e-3  # s, one step of a time-based profile's registers
STEP, RECTANGLE, TRIANGLE, TRAPEZOID = 0x00, 0x10, 0x20, 0x30  # as in the moving status


def limits(memory: ControlTable, way: float) -> tuple[float, float]:
    """Return a servo's limits [counts/s], [counts/s^2] on a move of `way` counts."""
    velocity, acceleration = memory["profile_velocity"], memory["profile_acceleration"]
    units = memory.kind.units
    timed = memory["drive_mode"] & TIMED
    if velocity == 0 or (timed and way == 0):
        return math.inf, math.inf
    if timed:
        span = velocity * MILLISECOND
        ramp = min(acceleration * MILLISECOND, span / 2)
        fastest = way / (span - ramp)
        return fastest, fastest / ramp if ramp else math.inf
    fastest = velocity * units.velocity / units.angle
    return fastest, acceleration * units.acceleration / units.angle or math.inf


def shape(memory: ControlTable, way: float) -> int:
    """Return the kind of profile that leads a servo over a way [counts]."""
    fastest, sharpest = limits(memory, way)
    if math.isinf(fastest):
        return STEP
    if math.isinf(sharpest):
        return RECTANGLE
    return TRIANGLE if fastest**2 / sharpest >= way else TRAPEZOID


class Profile:
    """Goals of n servos on their way [counts]: trapezoids of speed, restarted by each command.

    Args:
        start: where the goals are, (n,).
    """

    def __init__(self, start: np.ndarray) -> None:
        self.position = start.copy()  # counts
        self.speed = np.zeros(len(start))  # counts/s
        self.fastest = np.full(len(start), np.inf)  # counts/s
        self.sharpest = np.full(len(start), np.inf)  # counts/s^2
        self.shaped = False

    def limit(self, servo: int, fastest: float, sharpest: float) -> None:
        """Set a servo's limits [counts/s], [counts/s^2]; inf for none."""
        self.fastest[servo], self.sharpest[servo] = fastest, sharpest
        self.shaped = bool(np.isfinite(self.fastest).any() or np.isfinite(self.sharpest).any())

    def jump(self, servo: int, position: float) -> None:
        """Put a servo's goal somewhere, at rest."""
        self.position[servo], self.speed[servo] = position, 0.0

    def advance(self, goal: np.ndarray, dt: float) -> np.ndarray:
        """Move towards the goals, (n,), for dt [s], and return the positions, (n,)."""
        if not self.shaped:
            self.position[:] = goal
            return self.position
        way = goal - self.position
        step = np.where(np.isfinite(self.sharpest), self.sharpest, 1e12) * dt  # counts/s
        brake = np.sqrt(2 * step / dt * np.abs(way) + (step / 2) ** 2) - step / 2
        wanted = np.sign(way) * np.minimum(np.minimum(self.fastest, brake), np.abs(way) / dt)
        speed = self.speed + np.clip(wanted - self.speed, -step, step)
        arrives = (np.abs(way) <= np.abs(speed) * dt + 1e-9) & (np.abs(speed) <= 1.5 * step)
        self.position = np.where(arrives, goal, self.position + speed * dt)
        self.speed = np.where(arrives, 0.0, speed)
        return self.position
