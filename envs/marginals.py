"""Marginal laws of a distribution of robots, as functions of a uniform number.

    law = Marginal("normal", mean=0.2, std=0.05, low=0.0, high=0.5)
    law.values(np.array([0.05, 0.5, 0.95]))       # quantiles, within [low, high]

Correlated draws are a Gaussian copula: correlated normal numbers are turned into uniform ones, and
each law turns its own into values.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.special import ndtr, ndtri

from envs.errors import ParameterError, refuse_unknown

Kind = Literal["normal", "uniform", "lognormal", "particles"]
KINDS: tuple[str, ...] = get_args(Kind)
UNIFORM_WIDTH = math.sqrt(12.0)  # of a uniform law, over its standard deviation


@dataclass(frozen=True)
class Marginal:
    """The distribution of one parameter.

    Raises:
        ParameterError: an unknown law, a number that is not finite, a negative std, a mean outside
            [low, high], or a lognormal law whose mean is not positive.
    """

    # "normal" and "lognormal" (mean and std before they are cut off at low and high), "uniform"
    # (low to high), "particles" (rows of a table; mean and std describe them)
    kind: Kind
    mean: float  # in the parameter's unit and way
    std: float  # standard deviation, 0 for a single value
    low: float  # smallest value of a draw
    high: float  # largest value of a draw

    def __post_init__(self) -> None:
        refuse_unknown("law", self.kind, KINDS, ParameterError)
        for name in ("mean", "std", "low", "high"):
            if not math.isfinite(getattr(self, name)):
                raise ParameterError(f"{name}={getattr(self, name)} must be a finite number")
        if self.std < 0:
            raise ParameterError(f"std={self.std:g} is negative; give 0 for a single value")
        if not self.low <= self.mean <= self.high:
            raise ParameterError(
                f"mean={self.mean:g} is not within low={self.low:g} and high={self.high:g}; "
                "correct one of them"
            )
        if self.kind == "lognormal" and not self.mean > 0:
            raise ParameterError(f"mean={self.mean:g} of a lognormal distribution must be above 0")

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Return the law's quantiles at some shares in (0, 1), of any shape.

        Raises:
            ParameterError: particles have no marginal distribution.
        """
        if self.kind == "particles":
            raise ParameterError("particles are drawn from their table and have no quantiles")
        if self.std == 0.0 or self.low == self.high:
            return np.full(np.shape(shares), self.mean)
        if self.kind == "uniform":
            return self.low + shares * (self.high - self.low)
        if self.kind == "normal":
            return np.clip(
                _cut(shares, self.mean, self.std, self.low, self.high), self.low, self.high
            )
        variance = math.log1p((self.std / self.mean) ** 2)
        ends = [math.log(end) if end > 0 else -math.inf for end in (self.low, self.high)]
        logs = _cut(shares, math.log(self.mean) - variance / 2, math.sqrt(variance), *ends)
        return np.clip(np.exp(logs), self.low, self.high)


def _cut(shares: np.ndarray, mean: float, std: float, low: float, high: float) -> np.ndarray:
    """Return quantiles of a normal law that is cut off at low and high."""
    first, last = ndtr((low - mean) / std), ndtr((high - mean) / std)
    return mean + std * ndtri(first + shares * (last - first))


def uniform(low: float, high: float) -> Marginal:
    """Return the uniform law between two values."""
    return Marginal("uniform", (low + high) / 2, (high - low) / UNIFORM_WIDTH, low, high)
