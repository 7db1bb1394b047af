"""The transmission between motor and link: a spring, play, or both.

    gear = Gear(stiffness=80.0, damping=0.05, play=0.02)
    torque = gear(twist=0.013, rate=0.0)            # N·m on the link, twist = motor - link

Play is a dead band in the spring's twist. Within it nothing is transmitted; at its ends the spring
is as stiff as given, and its damper pushes but never pulls the sides together.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Gear:
    """A spring with play."""

    stiffness: float  # [N·m/rad]
    damping: float  # [N·m·s/rad]
    play: float = 0.0  # the whole dead band [rad]
    rub: float = 0.0  # dry friction parallel to the spring [N·m], which the robot adds as it moves

    def __call__(self, twist: float, rate: float) -> float:
        """Return the torque on the link [N·m].

        Args:
            twist: the motor's angle less the link's [rad].
            rate: of the twist [rad/s].
        """
        half = self.play / 2
        if -half < twist < half:
            return 0.0
        pressed = twist - half if twist > 0 else twist + half
        torque = self.stiffness * pressed + self.damping * rate
        return torque if self.play == 0 or torque * pressed > 0 else 0.0
