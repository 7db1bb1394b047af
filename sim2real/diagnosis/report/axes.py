"""Axes: where a value is drawn, and which round numbers label it.

    axis = Linear(0.0, 0.3, start=52, end=324)
    axis(0.1), list(axis.ticks(4))               # a coordinate; (value, text) of each number
    scale_for([0.108, 0.0015], floor=0.0006)     # a Log axis: they lie far apart

`Log` is for positive sizes that differ by more than a factor of ten; `Signed` does the same for
errors of both signs: linear next to zero, logarithmic beyond.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from sim2real.diagnosis.settings import TINY

EVEN = 0.401  # of an axis about 0: the least step that puts one number on either side
ROUND = (1, 2, 5, 10)  # steps between numbers, of a power of ten
FAR = 10.0  # ratio of the largest to the smallest value from which an axis is logarithmic
SPARE = 1.05  # length of an axis, of the largest value on it
BELOW = 0.6  # where a logarithmic axis starts, of the smallest value on it


class Linear:
    """A linear map from values to coordinates, and round numbers on it."""

    def __init__(self, low: float, high: float, start: float = 0.0, end: float = 1.0) -> None:
        self.low, self.high, self.start, self.end = low, max(high, low + TINY), start, end

    def __call__(self, values: np.ndarray | float) -> np.ndarray:
        """Return coordinates."""
        share = (np.asarray(values) - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self, count: int) -> Iterator[tuple[float, str]]:
        """Yield about so many round numbers and their text; one on each side about 0."""
        even = self.low == -self.high
        step = _round_step(EVEN * self.high if even else (self.high - self.low) / count)
        digits = max(0, -math.floor(math.log10(step) + TINY))
        first = math.ceil(self.low / step - TINY)
        for k in range(first, math.floor(self.high / step + TINY) + 1):
            yield k * step, f"{k * step:.{digits}f}".replace("-", "−")


class Log:
    """A logarithmic map of positive values; what is smaller is drawn at its start."""

    def __init__(self, low: float, high: float, start: float = 0.0, end: float = 1.0) -> None:
        self.low, self.high, self.start, self.end = low, max(high, low * SPARE), start, end

    def __call__(self, values: np.ndarray | float) -> np.ndarray:
        """Return coordinates."""
        inside = np.maximum(np.asarray(values, float), self.low)
        share = np.log(inside / self.low) / math.log(self.high / self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self, count: int) -> Iterator[tuple[float, str]]:
        """Yield powers of ten, and 2 and 5 times these where that makes about so many numbers."""
        first, last = math.log10(self.low), math.log10(self.high)
        steps = ROUND[:3] if 3 * (last - first) <= 2 * count else ROUND[:1]
        for power in range(math.floor(first), math.ceil(last) + 1):
            for step in steps:
                value = step * 10.0**power
                if self.low <= value <= self.high:
                    yield value, f"{value:.6g}"


class Signed:
    """A map of errors: linear up to a size on either side of zero, logarithmic beyond."""

    def __init__(self, size: float, most: float, start: float, end: float) -> None:
        self.size, self.most, self.start, self.end = size, max(most, size), start, end

    def __call__(self, values: np.ndarray | float) -> np.ndarray:
        """Return coordinates."""
        bent = np.arcsinh(np.asarray(values) / self.size) / math.asinh(self.most / self.size)
        return (self.start + self.end) / 2 + bent / 2 * (self.end - self.start)

    def ticks(self, count: int) -> Iterator[tuple[float, str]]:
        """Yield zero and the largest powers of ten on either side of it."""
        high = math.floor(math.log10(self.most))
        every = max(1, math.ceil((high - math.log10(self.size)) / max(1, count // 2)))
        powers = [p for p in range(high, math.floor(math.log10(self.size)), -every)]
        values = [10.0**p for p in powers]
        for value in sorted([0.0, *values, *(-v for v in values)]):
            yield value, f"{value:.6g}".replace("-", "−")


def scale_for(values: Sequence[float], floor: float) -> Linear | Log:
    """Return an axis from 0 to 1 for sizes: linear from zero, or logarithmic if they lie far apart.

    Args:
        values: what is drawn on it, none below zero.
        floor: the smallest size that matters.
    """
    most = max([*values, TINY])
    least = min([v for v in values if v > 0] or [most])
    if most / least < FAR:
        return Linear(0.0, SPARE * most)
    return Log(BELOW * max(least, min(floor, most / FAR)), SPARE * most)


def _round_step(rough: float) -> float:
    power = float(ROUND[-1]) ** math.floor(math.log10(rough))
    return next(m * power for m in ROUND if m * power >= rough * (1 - TINY))
