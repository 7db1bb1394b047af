"""Rows: many independent episodes side by side, the interface that every simulated world offers.

    observation = rows.reset(ids, values, seeds)      # start episodes in these rows
    step = rows.step(ids, action)                     # advance them by one control step

Contracts:

* A row is one episode at a time. Nothing restarts by itself: the caller resets those
  that ended.
* An episode is a pure function of the actions it is given, of its parameter values and of its seed.
  Which row it runs in, what the other rows do, and the number of threads change no bit of it.
  Resuming a run, spreading it over machines and comparing two policies with common random numbers
  all rest on that. On a GPU it holds to rounding only: the same parameters and start, in float32.
"""

from typing import NamedTuple, Protocol

import numpy as np

from envs.params import ParamSpace
from envs.physics.arrays import NUMPY, Array, Arrays


class Step(NamedTuple):
    """The result of one control step of n rows, as arrays of the rows."""

    observation: Array  # (n, O) float64, float32 on a device
    reward: Array  # (n,) float64, float32 on a device
    terminated: Array  # (n,) bool: the task ended the episode
    truncated: Array  # (n,) bool: the time limit ended it
    failed: Array  # (n,) bool: the simulation broke (also terminated); its reward is 0


class Rows(Protocol):
    """N rows of episodes of one task; see the module's docstring.

    Rows whose observations, actions and rewards are not NumPy arrays say so by an attribute
    `arrays` (see `arrays_of`).
    """

    num_rows: int
    observation_size: int
    action_size: int
    max_steps: int
    action_low: np.ndarray  # (A,)
    action_high: np.ndarray  # (A,)
    space: ParamSpace

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> Array:
        """Start an episode in each of the rows ids.

        Args:
            ids: sorted, unique row numbers, (n,).
            values: one value for each parameter of the space, (n, P).
            seeds: uint64, (n,): all the randomness of the episode.

        Returns:
            The first observations, (n, O).
        """
        ...

    def step(self, ids: np.ndarray | None, action: Array) -> Step:
        """Advance the rows ids (None: all of them) by one control step of action (n, A)."""
        ...


def arrays_of(rows: Rows) -> Arrays:
    """Return the array library of the rows' observations, actions and rewards: NumPy or another."""
    return getattr(rows, "arrays", NUMPY)
