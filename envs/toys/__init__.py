"""Small tasks, a few lines of arithmetic each: millions of steps a second.

Each is `Rows` (see `envs.rows`) and has a distribution of tasks in its module.
"""

from envs.toys.cartpole import AngleBias, BiasedCartPole
from envs.toys.env import ToyEnv
from envs.toys.navigation import (
    Combo,
    ComboGoals,
    Corners,
    FourCorners,
    Nav2D,
    NavGoals,
    NoisyNav2D,
)

__all__ = [
    "AngleBias",
    "BiasedCartPole",
    "Combo",
    "ComboGoals",
    "Corners",
    "FourCorners",
    "Nav2D",
    "NavGoals",
    "NoisyNav2D",
    "ToyEnv",
]
