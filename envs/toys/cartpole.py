"""Balancing a pole whose angle sensor is off by an unknown constant.

After Yang et al. 2019, "NoRML", and its released task; dynamics of Barto, Sutton and Anderson 1983
as in Gymnasium's CartPole, with a continuous force.
"""

import math

import numpy as np

from envs.noise import uniform
from envs.params import Parameter, ParamSpace
from envs.toys.base import Selection, Toy, ToyTasks

_GRAVITY = 9.8  # m/s^2
_CART, _POLE = 1.0, 0.1  # kg
_HALF_LENGTH = 0.5  # m, half the pole
_TIMESTEP = 0.02  # s
_REACH = 2.4  # m, largest excursion of the cart
_TILT = math.radians(12)  # rad, largest angle of the pole
_START = 0.05  # half width of the uniform start of all four states
_SPACE = ParamSpace(
    [
        Parameter(
            "encoder_offset.pole", "encoder_offset", "pole", unit="rad", low=-math.pi, high=math.pi
        )
    ]
)


class BiasedCartPole(Toy):
    """Balance a pole by a force within +-10 N on its cart, seeing the angle plus a constant bias.

    Observation: cart position [m] and velocity, pole angle [rad] plus bias and velocity. Reward: 1
        for each step that
    ends with the cart within 2.4 m and the pole within 12 degrees of the vertical.

    Args:
        num_rows: N, episodes at a time.
        max_steps: steps of an episode.
    """

    def __init__(self, num_rows: int, max_steps: int = 500) -> None:
        super().__init__(
            num_rows,
            _SPACE,
            state_size=4,
            observation_size=4,
            action_limit=np.array([10.0]),
            max_steps=max_steps,
        )

    def _start(self, ids: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        return _START * (2 * uniform(seeds, 0, 4) - 1)

    def _advance(
        self, rows: Selection, action: np.ndarray, truncated: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        _, speed, angle, spin = self._state[rows].T
        sin, cos = np.sin(angle), np.cos(angle)
        total = _CART + _POLE
        push = (action[:, 0] + _POLE * _HALF_LENGTH * spin**2 * sin) / total
        spin_rate = (_GRAVITY * sin - cos * push) / (
            _HALF_LENGTH * (4 / 3 - _POLE * cos**2 / total)
        )
        acceleration = push - _POLE * _HALF_LENGTH * spin_rate * cos / total
        rates = np.stack([speed, acceleration, spin, spin_rate], axis=1)
        state = self._state[rows] + _TIMESTEP * rates
        self._state[rows] = state
        fallen = (np.abs(state[:, 0]) >= _REACH) | (np.abs(state[:, 2]) >= _TILT)
        return np.where(fallen, 0.0, 1.0), fallen

    def _observe(self, rows: Selection) -> np.ndarray:
        seen = self._state[rows].copy()
        seen[:, 2] += self._values[rows, 0]
        return seen


class AngleBias(ToyTasks):
    """Angle biases spread evenly over +-limit, for `BiasedCartPole`.

    Args:
        limit: largest bias [rad]; the reference takes 10 degrees.
    """

    def __init__(self, limit: float = math.radians(10)) -> None:
        super().__init__(_SPACE)
        self.limit = limit

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n biases, (n, 1) [rad]."""
        return rng.uniform(-self.limit, self.limit, (n, 1))
