"""A point in the plane that must find a goal it cannot see: Nav-2D, four corners, several goals.

The observation is the position [m], the action a displacement per step within +-0.1 m in each
direction, the start the origin. Only the reward shows where the goal is, so a policy that has not
adapted can do no better than its prior. After Song et al. 2020, "ES-MAML", and its released tasks.
"""

import itertools
import math
from typing import Literal

import numpy as np

from envs.errors import TaskError
from envs.noise import normal, uniform
from envs.params import Parameter, ParamSpace
from envs.toys.base import Selection, Toy, ToyTasks

_STEP = 0.1  # m, largest displacement of a step in each direction
_SHOWN = 4.0  # m^2, squared distance within which a corner is felt
_NEAR = 0.01  # m^2, squared distance within which a goal is reached
_WRONG = 1e4  # cost of a wrong goal per m^2
_RADIUS = math.sqrt(8.0)  # m, of the circle of goals
_NOISE_STREAM = 2  # which of an episode seed's sequences the return's noise is


def _goal(limit: float) -> list[Parameter]:
    return [
        Parameter(f"goal.{axis}", "goal", unit="m", low=-limit, high=limit, how="set")
        for axis in "xy"
    ]


def _choices(goals: int, right: int) -> np.ndarray:
    """Return all choices of right goals, (C, goals) bool, in lexical order.

    Raises:
        TaskError: not at least one right goal and one wrong one.
    """
    if not 1 <= right < goals:
        raise TaskError(f"right={right} must be at least 1 and below goals={goals}")
    chosen = itertools.combinations(range(goals), right)
    return np.array([[k in one for k in range(goals)] for one in chosen])


def _choice(choices: np.ndarray) -> list[Parameter]:
    return [Parameter("goal", "goal", low=0.0, high=len(choices) - 1.0, how="set")]


def _on_circle(goals: int) -> np.ndarray:
    """Return where goals lie, (n, 2) [m], the first in the corner of positive x and y."""
    angle = math.pi / 4 + 2 * math.pi * np.arange(goals) / goals
    return _RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)


_RETURN_NOISE = Parameter("return_noise", "return_noise", low=0.0, how="set")


class Nav2D(Toy):
    """Reach a goal in the box [-1, 1]^2.

    Reward: minus the squared distance [m^2] after the step; ends within 0.1 m of the goal.

    Args:
        num_rows: N, episodes at a time.
        max_steps: steps of an episode.
    """

    box = 1.0  # m

    def __init__(self, num_rows: int, max_steps: int = 100) -> None:
        super().__init__(
            num_rows,
            ParamSpace(self._parameters()),
            state_size=2,
            observation_size=2,
            action_limit=np.full(2, _STEP),
            max_steps=max_steps,
        )

    def _parameters(self) -> list[Parameter]:
        return _goal(self.box)

    def _start(self, ids: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        return np.zeros((len(ids), 2))

    def _advance(
        self, rows: Selection, action: np.ndarray, truncated: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        gap = self._moved(rows, action) - self._values[rows, :2]
        return self._pay(gap[:, 0] ** 2 + gap[:, 1] ** 2)

    def _moved(self, rows: Selection, action: np.ndarray) -> np.ndarray:
        """Move the points within the box; return where they are, (k, 2)."""
        moved = self._state[rows] + action
        position = np.minimum(np.maximum(moved, -self.box), self.box)
        self._state[rows] = position
        return position

    def _pay(self, squared_distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return reward and terminated for squared distances to the goal [m^2], (n,)."""
        return -squared_distance, squared_distance <= _NEAR

    def _observe(self, rows: Selection) -> np.ndarray:
        return self._state[rows].copy()


class FourCorners(Nav2D):
    """Find the right one of four corners in the box [-5, 5]^2.

    Reward: -4 + max(0, 4 - squared distance), so nothing shows the goal until the point is within 2
        m of it. The
    episode always lasts `max_steps`.
    """

    box = 5.0  # m

    def _pay(self, squared_distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.maximum(-squared_distance, -_SHOWN), np.zeros(len(squared_distance), bool)


class Combo(FourCorners):
    """Visit the right ones of n goals in the box [-5, 5]^2, and stay away from the wrong ones.

    The goals lie on a circle of radius sqrt(8) m, four of them in the corners (+-2, +-2). Each
    right goal costs 4 - max(0, 4 - squared distance) a step until the point has been within 0.1 m
    of it. Each wrong goal costs 1e4 times what the squared distance to it is below 4 m^2: a look
    into the wrong corner is worse than never moving. The parameter `goal` is the number of one of
    the choices of right goals, in lexical order; numbers between are rounded.

    Args:
        num_rows: N, episodes at a time.
        goals: n.
        right: how many of them are right.
        max_steps: steps of an episode.

    Raises:
        TaskError: not at least one right goal and one wrong one.
    """

    def __init__(self, num_rows: int, goals: int = 4, right: int = 1, max_steps: int = 100) -> None:
        self._places, self._choices = _on_circle(goals), _choices(goals, right)
        super().__init__(num_rows, max_steps)
        self._visited = np.zeros((num_rows, goals), bool)

    def _parameters(self) -> list[Parameter]:
        return _choice(self._choices)

    def _start(self, ids: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        self._visited[ids] = False
        return super()._start(ids, seeds)

    def _advance(
        self, rows: Selection, action: np.ndarray, truncated: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        position = self._moved(rows, action)
        squared = np.square(position[:, None] - self._places).sum(axis=2)  # (k, n)
        right = self._choices[np.rint(self._values[rows, 0]).astype(int)]  # (k, n)
        visited = self._visited[rows] | (squared < _NEAR)
        self._visited[rows] = visited
        sought = np.maximum(-squared, -_SHOWN) * (right & ~visited)
        avoided = _WRONG * np.minimum(0.0, squared - _SHOWN) * ~right
        return (sought + avoided).sum(axis=1), np.zeros(len(position), bool)


class NoisyNav2D(Nav2D):
    """Nav-2D whose return carries noise, paid with the last step's reward.

    A third parameter, `return_noise`, scales the noise; at its neutral 0 the return is exact.

    Args:
        num_rows: N, episodes at a time.
        noise: "gaussian" adds scale times a standard normal number to the return; "corrupt" takes
            scale times the size of one away, in a share of the episodes: an error that only ever
            hurts.
        scale: size of the noise, in units of the return.
        share: probability that "corrupt" strikes an episode; of no effect for "gaussian".
        max_steps: steps of an episode.

    Raises:
        TaskError: for an unknown noise, a negative scale or a share outside [0, 1].
    """

    def __init__(
        self,
        num_rows: int,
        noise: Literal["gaussian", "corrupt"],
        scale: float,
        share: float = 1.0,
        max_steps: int = 100,
    ) -> None:
        if noise not in ("gaussian", "corrupt"):
            raise TaskError(f"noise={noise!r} is not one of gaussian, corrupt")
        if not scale >= 0 or not 0 <= share <= 1:
            raise TaskError(f"scale={scale} must be at least 0, share={share} in [0, 1]")
        super().__init__(num_rows, max_steps)
        self._law, self._scale, self._share = noise, scale, share
        self._noise = np.zeros(num_rows)  # (N,) to be paid at the end

    def _parameters(self) -> list[Parameter]:
        return [*super()._parameters(), _RETURN_NOISE]

    def _start(self, ids: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        draw = self._scale * normal(seeds, _NOISE_STREAM, 1)[:, 0]
        if self._law == "corrupt":
            struck = uniform(seeds, _NOISE_STREAM + 1, 1)[:, 0] < self._share
            draw = -np.abs(draw) * struck
        self._noise[ids] = draw * self._values[ids, 2]
        return super()._start(ids, seeds)

    def _advance(
        self, rows: Selection, action: np.ndarray, truncated: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        reward, terminated = super()._advance(rows, action, truncated)
        return reward + np.where(terminated | truncated, self._noise[rows], 0.0), terminated


class NavGoals(ToyTasks):
    """Goals spread evenly over the box [-1, 1]^2.

    Args:
        return_noise: for `NoisyNav2D`, the factor on its noise; None for `Nav2D`, which has none.
    """

    def __init__(self, return_noise: float | None = None) -> None:
        self._return_noise = return_noise
        extra = [] if return_noise is None else [_RETURN_NOISE]
        super().__init__(ParamSpace([*_goal(Nav2D.box), *extra]))

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n goals, (n, P)."""
        goals = rng.uniform(-Nav2D.box, Nav2D.box, (n, 2))
        if self._return_noise is None:
            return goals
        return np.column_stack([goals, np.full(n, self._return_noise)])


class Corners(ToyTasks):
    """One of the corners (+-2, +-2) m, each as likely, for `FourCorners`."""

    def __init__(self) -> None:
        super().__init__(ParamSpace(_goal(FourCorners.box)))
        self.distinct = np.array([[-2.0, -2.0], [-2.0, 2.0], [2.0, -2.0], [2.0, 2.0]])

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n corners, (n, 2)."""
        return rng.choice([-2.0, 2.0], (n, 2))


class ComboGoals(ToyTasks):
    """Every choice of right goals of `Combo`, each as likely.

    Args:
        goals: how many goals there are.
        right: how many of them are right.

    Raises:
        TaskError: not at least one right goal and one wrong one.
    """

    def __init__(self, goals: int = 4, right: int = 1) -> None:
        choices = _choices(goals, right)
        super().__init__(ParamSpace(_choice(choices)))
        self._count = len(choices)
        self.distinct = np.arange(float(self._count))[:, None]

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n choices, (n, 1)."""
        return rng.integers(self._count, size=(n, 1)).astype(float)
