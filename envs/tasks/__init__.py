"""The tasks: each names a robot, what it observes, its reward and its end."""

from envs.tasks.ant import Ant
from envs.tasks.base import State, Task
from envs.tasks.half_cheetah import HalfCheetah, HalfCheetahDirection, HalfCheetahVelocity
from envs.tasks.hopper import Hopper, HopperPolito
from envs.tasks.inverted_pendulum import InvertedPendulum
from envs.tasks.servo import Bench1, Follow, Hopper2, Quad8, ServoTask
from envs.tasks.swimmer import Swimmer
from envs.tasks.walker2d import Walker2d

__all__ = [
    "Ant",
    "Bench1",
    "Follow",
    "HalfCheetah",
    "HalfCheetahDirection",
    "HalfCheetahVelocity",
    "Hopper",
    "Hopper2",
    "HopperPolito",
    "InvertedPendulum",
    "Quad8",
    "ServoTask",
    "State",
    "Swimmer",
    "Task",
    "Walker2d",
]
