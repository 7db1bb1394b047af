"""A spring between motor and link that loses energy: what harmonic drives and rubber do."""

from typing import Any

import numpy as np

from envs.effects.base import BOTH, Extra
from envs.effects.friction import STIFF_SOLIMP
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.effects.structure import SeriesEffect, Spring


class _Hysteresis(Spring):
    """See `HystereticCompliance`."""

    def __init__(self, plant: PlantView, effect: SeriesEffect, motor: int) -> None:
        super().__init__(plant, effect, motor)
        self.loss = plant.field("dof_frictionloss")

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        friction = self.effect.scalar("friction", values)
        self.loss[ids, self.v] = np.where(values[:, 0] > 0, friction, 0.0)


class HystereticCompliance(SeriesEffect):
    """A spring between motor and link with dry friction parallel to it.

    Loading and unloading differ: a cycle dissipates 4 * `friction` * amplitude at any speed.
    `side` is the location of the servo's encoder. `encoder` is the location of the logged encoder,
    if they differ.
    """

    name = "hysteretic_compliance"
    engines = BOTH
    unit = "rad/(N·m)"
    extras = (
        Extra(
            "friction",
            "N·m",
            0.02,
            0.0,
            1e3,
            "friction of the spring: half the torque between its two branches",
            fit=(0.0, 1e3),
            typical=(0.0, 0.2),
        ),
        Extra(
            "damping",
            "N·m·s/rad",
            0.0,
            0.0,
            1e3,
            "the spring's damping, in addition to its friction",
            fit=(0.0, 1e3),
            typical=(0.0, 0.2),
        ),
    )
    typical = (0.0, 0.5)
    bound = _Hysteresis
    symptom = "a sag that differs between loading and unloading, at any speed, and little ringing"
    source = (
        "tau = k d + F sgn(dd/dt); Iwan 1966, J. Applied Mechanics 33 (4); harmonic drives:"
        " Dhaouadi, Ghorbel, Gandhi 2003"
    )
    experiment = "a slow rise and fall of the load with the motor locked, to two amplitudes"

    def shape(self, joint: Any, timestep: float) -> None:
        """Let its friction stick."""
        joint.solimp_friction, joint.solref_friction = STIFF_SOLIMP, [2 * timestep, 1.0]

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return springs that a torque bends little and much, and two frictions.

        With a tenth of critical damping besides: friction takes the rest.
        """
        torque, inertia = scale.torque_at(self.where), scale.inertia(self.where)
        return np.array(
            [
                (s / torque, part * torque, 0.2 * np.sqrt(inertia * torque / s))
                for s in (0.02, 0.1, 0.4)
                for part in (0.03, 0.12)
            ]
        )
