"""The tasks: each names a robot, what it observes, its reward and its end."""

from envs.tasks.ant import Ant
from envs.tasks.ball_balance import BallBalance
from envs.tasks.base import State, Task
from envs.tasks.cart_pole import CartPole
from envs.tasks.easi_ant import EasiAnt
from envs.tasks.goals import (
    AntDirection,
    AntPosition,
    AntVelocity,
    GoalTask,
    HalfCheetahDirection,
    HalfCheetahVelocity,
    SwimmerDirection,
    SwimmerVelocity,
    Walker2dDirection,
    Walker2dFastVelocity,
    Walker2dVelocity,
)
from envs.tasks.half_cheetah import HalfCheetah
from envs.tasks.hopper import Hopper, HopperPolito
from envs.tasks.inverted_pendulum import InvertedPendulum
from envs.tasks.servo import Bench1, Follow, Hopper2, Quad8, Quad12, ServoTask
from envs.tasks.swimmer import Swimmer
from envs.tasks.walker2d import Walker2d

__all__ = [
    "Ant",
    "AntDirection",
    "AntPosition",
    "AntVelocity",
    "BallBalance",
    "Bench1",
    "CartPole",
    "EasiAnt",
    "Follow",
    "GoalTask",
    "HalfCheetah",
    "HalfCheetahDirection",
    "HalfCheetahVelocity",
    "Hopper",
    "Hopper2",
    "HopperPolito",
    "InvertedPendulum",
    "Quad8",
    "Quad12",
    "ServoTask",
    "State",
    "Swimmer",
    "SwimmerDirection",
    "SwimmerVelocity",
    "Task",
    "Walker2d",
    "Walker2dDirection",
    "Walker2dFastVelocity",
    "Walker2dVelocity",
]
