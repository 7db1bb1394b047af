"""Quad12: a four-legged robot of twelve servos that is rewarded for walking forward cheaply."""

from collections.abc import Mapping
from typing import Any

from envs.physics.arrays import Array
from envs.tasks.base import State
from envs.tasks.servo.base import Fidelity
from envs.tasks.servo.legs import Gait, spread
from envs.tasks.servo.quadruped import Quadruped


class Quad12(Quadruped):
    """Walking on a robot of 1.7 kg with legs of 0.2 m that abduct; see `Quadruped`.

    Observation (16,): roll, pitch, twelve angles (abduction, hip, knee of each leg), sine and
    cosine of the phase. Action (12,): swings, extensions and abductions of the legs fl, fr, bl, br
    [rad], each within 0.3.

    Args:
        fidelity: "ideal" (stiff position actuators) or "servo" (motor and firmware).
        robot: the robot's file: a name in conf/robot, a path, or what such a file holds.
        seconds: length of an episode [s].
    """

    asset = "quad12.xml"
    gait = Gait(frequency=2.0, swing=0.1, extension=0.15)

    def __init__(
        self,
        fidelity: Fidelity = "servo",
        robot: str | Mapping[str, Any] = "quad12",
        seconds: float = 3.0,
    ) -> None:
        super().__init__(fidelity, robot, seconds)

    def target_angles(self, state: State, action: Array) -> Array:
        """Return the trot with the action's swings, extensions, abductions [rad], (N, 12)."""
        return spread(action[:, 8:], super().target_angles(state, action), self.xp)
