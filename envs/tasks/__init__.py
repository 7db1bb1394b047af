"""The tasks: each names a robot, what it observes, its reward and its end."""

from envs.tasks.base import State, Task
from envs.tasks.hopper import Hopper, HopperPolito

__all__ = ["Hopper", "HopperPolito", "State", "Task"]
