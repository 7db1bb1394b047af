"""Small tasks whose dynamics are a few lines of arithmetic: millions of steps a second, for tests of meta-learning.

Each is `Rows` (see `envs.rows`) and has a distribution of tasks beside it.
"""

from envs.toys.cartpole import AngleBias, BiasedCartPole
from envs.toys.navigation import Corners, FourCorners, Nav2D, NavGoals, NoisyNav2D

__all__ = ["AngleBias", "BiasedCartPole", "Corners", "FourCorners", "Nav2D", "NavGoals", "NoisyNav2D"]
