"""A closed-form provider: readings are linear in the parameters, so that truth is known exactly."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from envs.distribution import Distribution, Entry
from envs.effects import make
from envs.marginals import uniform
from sim2real.identification.providers.base import AlignedProvider

PRIOR = Distribution(
    tuple(
        Entry(make(name, where="hinge"), (uniform(-5.0, 5.0),))
        for name in ("armature", "viscous_friction")
    )
)


class Linear(AlignedProvider):
    """E episodes of T rows and M readings: real = change @ value of the episode + noise.

    Args:
        values: the true value of each episode, (E, P).
        noise: standard deviation of a reading.
        rng: for sensitivities and noise.
        hidden: a direction (P,) along which nothing changes.
        rows: T.
    """

    def __init__(
        self,
        values: np.ndarray,
        noise: float,
        rng: np.random.Generator,
        hidden: Sequence[float] | None = None,
        rows: int = 40,
    ) -> None:
        count, size = values.shape
        change = rng.normal(size=(count, rows, 1, size))
        if hidden is not None:
            away = np.array(hidden) / np.linalg.norm(hidden)
            change -= (change @ away)[..., None] * away
        self._change = change
        self._measured = (change @ values[:, None, :, None])[..., 0] + noise * rng.normal(
            size=(count, rows, 1)
        )
        super().__init__(
            self._measured,
            np.arange(count),
            np.ones(1),
            ["hinge"],
            np.full(1, noise),
            np.zeros(size),
        )

    def errors_of(self, pieces: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return simulated minus measured."""
        simulated = (self._change[pieces] @ values[:, None, :, None])[..., 0]
        return simulated - self._measured[pieces]


def maker(made: Linear) -> Any:
    """Return what makes this provider, whatever it is asked for."""
    return lambda data, effects, rows, seed: made
