"""What a task asks for in an episode: a parameter like any other, and no property of a robot.

draws = [Draw(Goal(), distribution="ends", low=-1.0, high=1.0)]     # run backward or forward
"""

from __future__ import annotations

import mujoco
import numpy as np

from envs.effects.base import BoundEffect, Effect
from envs.effects.plant_view import PlantView
from envs.params import Parameter


class Goal(Effect):
    """What a task with a goal asks for, in the task's own unit; the policy does not see it."""

    name = "goal"
    place = "robot"
    unit = "1"
    hows = ("set",)
    closes_gaps = False
    no_mjcf = "it is what a task asks for, not how the robot moves"
    typical = (-1.0, 1.0)
    symptom = "nothing in a log: only rewards change"
    source = "goal tasks of meta-learning, Finn et al. 2017"
    experiment = "none: whoever sets the task knows it"

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the goal."""
        return (self.parameter(),)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Keep the goal of each row where the task's reward finds it."""
        return plant.share(self.name, lambda: Goals(plant.num_rows))


class Goals(BoundEffect):
    """The goals of N rows.

    Args:
        num_rows: N.
    """

    def __init__(self, num_rows: int) -> None:
        self.values = np.zeros(num_rows)  # (N,)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put goals (n, 1) into the rows ids."""
        self.values[ids] = values[:, 0]
