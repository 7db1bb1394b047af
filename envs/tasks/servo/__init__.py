"""Tasks on servo robots, which run in simulation and on the robot."""

from envs.tasks.servo.base import ServoTask
from envs.tasks.servo.bench1 import Bench1

__all__ = ["Bench1", "ServoTask"]
