"""The goal of a task in an episode: a parameter like any other, but not a property of a robot.

draws = [Draw(Goal(), distribution="ends", low=-1.0, high=1.0)]     # run backward or forward
draws = [Draw(Goal(axes=2), low=-3.0, high=3.0)]    # goal.x and goal.y, each by itself
"""

from typing import Any

import mujoco
import numpy as np

from envs.effects.base import BOTH, Effect
from envs.effects.bound import BoundEffect
from envs.effects.plant_view import PlantView
from envs.errors import EffectError
from envs.params import How, Parameter
from envs.physics.arrays import Arrays


class Goal(Effect):
    """Goal of a task, in the task's unit; the policy does not observe it.

    Args:
        where: must be left out, as for every effect on the whole robot.
        how: `set`.
        axes: numbers of a goal: 1, the parameter `goal`, or 2 for a point of the plane, the
            parameters `goal.x` and `goal.y`.

    Raises:
        EffectError: another number of axes.
    """

    name = "goal"
    engines = BOTH
    place = "robot"
    unit = "1"
    hows = ("set",)
    visible_in_replay = False
    no_mjcf = "it is what a task asks for, not how the robot moves"
    typical = (-1.0, 1.0)
    symptom = "none in a log; only rewards change"
    source = "goal tasks of meta-learning, Finn et al. 2017"
    experiment = "not needed, because the task defines it"

    def __init__(
        self, where: str | None = None, how: How | None = None, axes: int = 1, **arguments: Any
    ) -> None:
        super().__init__(where, how, **arguments)
        if axes not in (1, 2):
            raise EffectError(f"goal: axes={axes!r} must be 1, or 2 for a point of the plane")
        self.axes = axes

    def options(self) -> dict[str, Any]:
        """Return the number of axes, where it is not one."""
        return {"axes": self.axes} if self.axes > 1 else {}

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the goal's numbers."""
        if self.axes == 1:
            return (self.parameter(),)
        return tuple(self.parameter(axis) for axis in "xy")

    def bind(self, plant: PlantView) -> BoundEffect:
        """Keep the goal of each row where the task's reward finds it."""
        return plant.shared_mechanism(
            self.name, lambda: Goals(plant.num_rows, plant.arrays, self.axes)
        )


class Goals(BoundEffect):
    """The goals of N rows.

    Args:
        num_rows: N.
        arrays: of the engine.
        axes: numbers of a goal.
    """

    def __init__(self, num_rows: int, arrays: Arrays, axes: int = 1) -> None:
        self._arrays, self.values = arrays, arrays.zeros((num_rows, axes))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put goals (n, axes) into the rows ids."""
        self.values[self._arrays.rows(ids)] = self._arrays.own(values)
