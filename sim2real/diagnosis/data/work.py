"""What was simulated, and what for.

work = Work()
with work.during("screening"):
    work.add(seconds=2.0, steps=1000)
work.steps["screening"], work.total            # 1000, 1000
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")
Done = tuple[float, Counter[str]]  # seconds, and steps by stage
OTHER = "other"  # what no stage is named for


class Work:
    """Physics steps by stage, and seconds of robot time.

    Attributes:
        steps: of all rows, by the name of the stage; a stage within another one is "outer: inner".
        seconds: of robot time, of all rows.
    """

    def __init__(self) -> None:
        self.steps: Counter[str] = Counter()
        self.seconds = 0.0
        self._stages: list[str] = []

    @property
    def total(self) -> int:
        """Physics steps of all stages."""
        return sum(self.steps.values())

    @contextmanager
    def during(self, stage: str) -> Iterator[None]:
        """Count what is simulated in the block for a stage."""
        self._stages.append(stage)
        try:
            yield
        finally:
            self._stages.pop()

    def add(self, seconds: float, steps: int) -> None:
        """Count what was simulated, for the stage that is going on."""
        self.seconds += seconds
        self.steps[": ".join(self._stages) or OTHER] += steps

    def apart(self, task: Callable[[], T]) -> tuple[T, Done]:
        """Return what a task returns, and what it simulated, which is not counted here."""
        kept, self.seconds, self.steps = (self.seconds, self.steps), 0.0, Counter()
        try:
            return task(), (self.seconds, self.steps)
        finally:
            self.seconds, self.steps = kept

    def join(self, done: Done) -> None:
        """Count what was done apart."""
        self.seconds += done[0]
        self.steps.update(done[1])
