"""Quad8: a four-legged robot of eight servos that is rewarded for walking forward cheaply."""

from collections.abc import Mapping
from typing import Any

from envs.tasks.servo.base import Fidelity
from envs.tasks.servo.legs import Gait
from envs.tasks.servo.quadruped import Quadruped


class Quad8(Quadruped):
    """Walking on a robot of 1.1 kg with legs of 0.16 m; see `Quadruped`.

    Observation (12,): roll, pitch, eight angles, sine and cosine of the phase. Action (8,): swings
    and extensions of the legs fl, fr, bl, br [rad], each within 0.3.

    Args:
        fidelity: "ideal" (stiff position actuators) or "servo" (motor and firmware).
        robot: the robot's file: a name in conf/robot, a path, or what such a file holds.
        seconds: length of an episode [s].
    """

    asset = "quad8.xml"
    gait = Gait(frequency=2.0, swing=0.1, extension=0.15)

    def __init__(
        self,
        fidelity: Fidelity = "servo",
        robot: str | Mapping[str, Any] = "quad8",
        seconds: float = 3.0,
    ) -> None:
        super().__init__(fidelity, robot, seconds)
