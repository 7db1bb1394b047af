"""Axes: where a value is drawn, and which round numbers label it.

    axis = Axis(0.0, 0.3, start=52, end=324)
    axis(0.1), list(axis.ticks(4))               # a coordinate; (coordinate, text) of each number
    scale_for([0.108, 0.0015], floor=0.0006)     # a Log axis: they lie far apart

`Log` is for positive sizes that differ by more than a factor of ten; `Signed` does the same for
errors of both signs: linear next to zero, logarithmic beyond.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sim2real.diagnosis.settings import TINY

EVEN = 0.401  # of an axis about 0: the least step that puts one number on either side
ROUND = (1, 2, 5, 10)  # steps between numbers, of a power of ten
DENSE = ROUND[:3]  # numbers in each power of ten of a short logarithmic axis
FAR = 10.0  # ratio of the largest to the smallest value from which an axis is logarithmic
SPARE = 1.05  # length of an axis, of the largest value on it
BELOW = 0.6  # where a logarithmic axis starts, of the smallest value on it
MARGIN = 0.04  # of a line's length: left free on either side of an axis without numbers


@dataclass(frozen=True)
class Axis:
    """A map from values to coordinates: a linear one, where no subclass says otherwise."""

    low: float  # the number at its start
    high: float
    start: float = 0.0  # a coordinate
    end: float = 1.0
    factor: float = 1.0  # of the numbers on it, over the values
    logarithmic = False

    def __call__(self, values: np.ndarray | float) -> np.ndarray:
        """Return coordinates."""
        return self.start + self._share(self.factor * np.asarray(values)) * (self.end - self.start)

    def ticks(self, count: int) -> Iterator[tuple[float, str]]:
        """Yield coordinate and text of about so many round numbers."""
        for number, text in self._numbers(count):
            yield float(self(number / self.factor)), text.replace("-", "−")

    def _share(self, numbers: np.ndarray) -> np.ndarray:
        """Return where numbers are, as shares of the axis."""
        return (numbers - self.low) / max(self.high - self.low, TINY)

    def _numbers(self, count: int) -> Iterator[tuple[float, str]]:
        """Yield round numbers; of an axis about 0 one is on each side."""
        even = self.low == -self.high
        rough = EVEN * self.high if even else (self.high - self.low) / count
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(m * power for m in ROUND if m * power >= rough * (1 - TINY))
        digits = max(0, -math.floor(math.log10(step) + TINY))
        first = math.ceil(self.low / step - TINY)
        for k in range(first, math.floor(self.high / step + TINY) + 1):
            yield k * step, f"{k * step:.{digits}f}"


class Log(Axis):
    """A logarithmic axis of positive values; what is smaller is drawn at its start."""

    logarithmic = True

    def _share(self, numbers: np.ndarray) -> np.ndarray:
        return np.log(np.maximum(numbers, self.low) / self.low) / math.log(self.high / self.low)

    def _numbers(self, count: int) -> Iterator[tuple[float, str]]:
        """Yield powers of ten, and 2 and 5 times these where that makes about so many numbers."""
        first, last = math.log10(self.low), math.log10(self.high)
        steps = DENSE if len(DENSE) * (last - first) <= 2 * count else ROUND[:1]
        for power in range(math.floor(first), math.ceil(last) + 1):
            for value in (step * 10.0**power for step in steps):
                if self.low <= value <= self.high:
                    yield value, f"{value:.6g}"


class Signed(Axis):
    """An axis of errors up to `high`: linear up to `low` on either side of 0, then logarithmic."""

    def _share(self, numbers: np.ndarray) -> np.ndarray:
        return (1 + np.arcsinh(numbers / self.low) / math.asinh(self.high / self.low)) / 2

    def _numbers(self, count: int) -> Iterator[tuple[float, str]]:
        """Yield zero and the largest powers of ten on either side of it."""
        high, low = math.floor(math.log10(self.high)), math.log10(self.low)
        every = max(1, math.ceil((high - low) / max(1, count // 2)))
        values = [10.0**power for power in range(high, math.floor(low), -every)]
        for value in sorted([0.0, *values, *(-v for v in values)]):
            yield value, f"{value:.6g}"


def scale_for(values: Sequence[float], floor: float, factor: float = 1.0) -> Axis:
    """Return an axis from 0 to 1 for sizes: linear from zero, or logarithmic if they lie far apart.

    Args:
        values: what is drawn on it, none below zero.
        floor: the smallest size that matters.
        factor: what they are multiplied by to get the numbers on it.
    """
    sizes = [factor * value for value in values]
    most = max([*sizes, TINY])
    least = min([size for size in sizes if size > 0] or [most])
    if most / least < FAR:
        return Axis(0.0, SPARE * most, factor=factor)
    return Log(BELOW * max(least, min(factor * floor, most / FAR)), SPARE * most, factor=factor)


def inset(low: float, high: float) -> Axis:
    """Return an axis for two values, at a margin from the ends of a line."""
    return Axis(low, high, MARGIN, 1 - MARGIN)
