"""Dry, viscous and load-dependent friction of one joint, with bristles that bend before they slip.

    rub = Bristles(Friction(coulomb=0.1, viscous=0.02), inertia=0.01, step=0.0005)
    torque = rub(speed=0.3, angle=0.0, load=0.0)    # N·m, against the motion

The law is LuGre's (Canudas de Wit et al., IEEE TAC 40 (3), 1995), with the deflection as a share
of what breaks away: z' = (v - |v| z) / BEND, torque = g(v) z + micro-damping + viscous v, where g
is the Stribeck curve. The deflection moves by its exact solution over a step, so that no speed
makes it unstable.
"""

import math
from dataclasses import dataclass

BEND = 1e-3  # rad that bristles bend before they slip: 1 mrad, as geared servos show
RATIO = 0.7  # damping ratio of a joint that sticks on its bristles


@dataclass(frozen=True)
class Friction:
    """The friction of a joint; all values 0 mean none."""

    coulomb: float = 0.0  # dry friction at any speed [N·m]
    viscous: float = 0.0  # torque per speed [N·m·s/rad]
    excess: float = 0.0  # more dry friction at rest [N·m]
    speed: float = 0.5  # at which the excess has fallen to 1/e [rad/s]
    load: float = 0.0  # dry friction per transmitted torque
    # added to the dry friction in positive, taken off in negative direction [N·m]
    skew: float = 0.0
    worn: float = 0.0  # more dry friction about one angle [N·m]
    worn_at: float = 0.0  # that angle [rad]
    worn_width: float = 0.1  # how wide about it (standard deviation) [rad]
    grease: float = 0.0  # more viscous friction while it is cold [N·m·s/rad]
    warm_up: float = 5.0  # time in which that falls to 1/e [s]

    def dry(self, speed: float, angle: float, load: float) -> float:
        """Return the dry friction of steady sliding [N·m], never below 0."""
        level = self.coulomb + self.load * abs(load) + math.copysign(self.skew, self.skew * speed)
        if self.excess:
            level += self.excess * math.exp(-((speed / self.speed) ** 2))
        if self.worn:
            level += self.worn * math.exp(-0.5 * ((angle - self.worn_at) / self.worn_width) ** 2)
        return max(level, 0.0)


class Bristles:
    """The friction of one joint as it moves on."""

    def __init__(self, law: Friction, inertia: float, step: float) -> None:
        self._law, self._inertia, self._step = law, inertia, step
        self._bent, self._time = 0.0, 0.0

    def __call__(self, speed: float, angle: float, load: float) -> float:
        """Return the torque against the motion [N·m] and move the bristles on by one step.

        Args:
            speed: of the joint [rad/s].
            angle: of the joint [rad].
            load: torque that the joint transmits [N·m].
        """
        law, before = self._law, self._bent
        level = law.dry(speed, angle, load)
        goal = math.copysign(1.0, speed)
        self._bent = goal + (before - goal) * math.exp(-abs(speed) * self._step / BEND)
        damping = 2 * RATIO * math.sqrt(level * self._inertia * BEND)
        viscous = law.viscous
        if law.grease:
            viscous += law.grease * math.exp(-self._time / law.warm_up)
        self._time += self._step
        return level * self._bent + damping * (self._bent - before) / self._step + viscous * speed
