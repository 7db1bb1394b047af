"""Tasks on servo robots, which run in simulation and on the robot."""

from envs.tasks.servo.base import ServoTask
from envs.tasks.servo.bench1 import Bench1
from envs.tasks.servo.follow import Follow
from envs.tasks.servo.hopper2 import Hopper2
from envs.tasks.servo.quad8 import Quad8
from envs.tasks.servo.quad12 import Quad12

__all__ = ["Bench1", "Follow", "Hopper2", "Quad8", "Quad12", "ServoTask"]
