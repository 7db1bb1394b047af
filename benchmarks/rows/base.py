"""A row of the comparison: something that makes environment steps, and by what its rate is divided.

    row.build()
    rate = row.run().per_second
    row.close()

Rows run in turns, so a row must stay idle between its runs.
"""

import time
from abc import ABC, abstractmethod
from importlib.util import find_spec
from typing import NamedTuple


class Timing(NamedTuple):
    """One run of a row."""

    steps: float  # environment steps, or what the row counts
    seconds: float
    episodes: int  # that ended within

    @property
    def per_second(self) -> float:
        """Environment steps, or what the row counts, a second."""
        return self.steps / self.seconds


class Row(ABC):
    """One way to make environment steps."""

    name: str  # the row's, for good
    # the row whose rate divides this one's; None for a row that is a divisor itself
    of: str | None = "raw_physics"
    unit: str = "env steps"  # what it counts
    setup: str  # threads, processes and sizes, in words
    # a package that the row cannot run without, and is not among the project's own
    needs: str | None = None
    simulations: int = 1  # how many it holds
    # kind of memory of `benchmarks.memory` that each takes; None for one process a simulation
    memory: str | None = None
    long: bool = False  # whether it takes so long that it runs only where it is named

    def missing(self) -> str | None:
        """Return why the row cannot run here, or None."""
        if self.needs and find_spec(self.needs) is None:
            return f"{self.name}: {self.needs} is not installed; pip install '.[bench]'"
        return None

    @abstractmethod
    def build(self) -> None:
        """Make everything that is not timed, and warm it up."""

    def run(self) -> Timing:
        """Do the work once; of rows that time only a part of it, in a way of their own."""
        begin = time.perf_counter()
        steps, episodes = self.work()
        return Timing(steps, time.perf_counter() - begin, episodes)

    def work(self) -> tuple[float, int]:
        """Do what is timed; return what `Timing` counts of it: steps, and episodes that ended."""
        raise NotImplementedError

    def pids(self) -> list[int]:
        """Return its worker processes, if it has any."""
        return []

    def peak(self) -> float | None:
        """Return the bytes that its process has taken at most; None where it has none."""
        return None

    def close(self) -> None:  # noqa: B027 - most rows hold nothing that needs it
        """End workers."""
