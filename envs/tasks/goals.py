"""Tasks with a hidden goal, which only the rewards reveal.

    MujocoEnv(task=SwimmerDirection(), effects=[Goal()])       # forward or backward
    MujocoEnv(task=AntPosition(), effects=[Goal(axes=2)])      # to a point of the plane

The robots, their physics and what they show are those of the tasks that they inherit from; no
policy can solve them all without finding out in its first episodes what is asked for. After Finn
et al. 2017 and Song et al. 2020; a goal is drawn as any parameter (`envs.effects.Goal`).
"""

from abc import abstractmethod

from envs.physics.arrays import Array
from envs.tasks.ant import Ant
from envs.tasks.base import State, Task
from envs.tasks.half_cheetah import HalfCheetah
from envs.tasks.swimmer import Swimmer
from envs.tasks.walker2d import Walker2d


class GoalTask(Task):
    """Base class of tasks with a goal: the reward depends on it, and each step alive pays a bonus.

    Attributes:
        effort_cost: taken off for each squared action.
        alive: paid for each step that does not end the episode.
    """

    has_goal = True
    effort_cost: float = 0.0
    alive: float = 0.0

    @abstractmethod
    def goal_reward(self, before: State, after: State, goal: Array) -> Array:
        """Return the reward, (n,), of goals (n,) or (n, axes) for the motion between two states."""

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return the goal's reward + alive - cost of the effort, (n,)."""
        assert after.goal is not None
        paid = self.goal_reward(before, after, after.goal)
        return paid + self.alive * ~terminated - self.effort_cost * self.effort(action)


class Direction(GoalTask):
    """The goal is 1 for forward and -1 for backward; it pays goal * velocity [m/s]."""

    def goal_reward(self, before: State, after: State, goal: Array) -> Array:
        """Return the velocity towards the goal, (n,)."""
        return goal * self.velocity(before, after)


class Velocity(GoalTask):
    """The goal is a forward velocity [m/s]; it pays -|velocity - goal|."""

    def goal_reward(self, before: State, after: State, goal: Array) -> Array:
        """Return minus the distance from the velocity asked for, (n,)."""
        return -self.xp.abs(self.velocity(before, after) - goal)


class HalfCheetahDirection(Direction, HalfCheetah):
    """A HalfCheetah that runs forward or backward: goal * velocity - 0.05 |action|^2."""

    effort_cost = 0.05


class HalfCheetahVelocity(Velocity, HalfCheetah):
    """A HalfCheetah with a goal velocity; reward -|velocity - goal| - 0.05 |action|^2."""

    effort_cost = 0.05


class SwimmerDirection(Direction, Swimmer):
    """A Swimmer that swims forward or backward: goal * velocity."""


class SwimmerVelocity(Velocity, Swimmer):
    """A Swimmer that swims as fast as it is asked: -|velocity - goal|."""


class Walker2dDirection(Direction, Walker2d):
    """A Walker2d that walks forward or backward: goal * velocity + 1; a fall ends it."""

    alive = 1.0


class Walker2dVelocity(Velocity, Walker2d):
    """A Walker2d that walks as fast as it is asked: 1 - |velocity - goal|; a fall ends it."""

    alive = 1.0


class Walker2dFastVelocity(Walker2dVelocity):
    """ProMP's variant, for goals up to 10 m/s: 15 - |velocity - goal|, control steps of 16 ms."""

    frame_skip = 8
    alive = 15.0


class _Lasting(Ant):
    """An Ant whose episodes end by their length alone.

    A fall ends Gymnasium's. Where each step costs, that would reward a fall.
    """

    def terminated(self, state: State) -> Array:
        """Return which states are not finite, (n,)."""
        return ~self.finite(state)


class AntDirection(Direction, _Lasting):
    """An Ant that goes forward or backward along x: goal * velocity."""


class AntVelocity(Velocity, _Lasting):
    """An Ant that goes along x as fast as it is asked: -|velocity - goal|."""


class AntPosition(GoalTask, _Lasting):
    """An Ant that goes to a point of the plane [m]: -|x - goal.x| - |y - goal.y|.

    Unlike Ant's, its observation begins with its own x and y: else it could not know where to stop.
    """

    goal_axes = 2

    def observe(self, state: State) -> Array:
        """Return (x, y, then what Ant observes), (n, 29 or 107)."""
        return self.xp.concat([state.qpos[:, :2], super().observe(state)], axis=1)

    def goal_reward(self, before: State, after: State, goal: Array) -> Array:
        """Return minus the distance to the point, summed over x and y, (n,)."""
        return -self.xp.sum(self.xp.abs(after.qpos[:, :2] - goal), axis=1)
