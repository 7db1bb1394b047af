"""What was simulated.

work = Work()
work.add(seconds=2.0, steps=1000)
work.steps                                     # 1000
"""

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
Done = tuple[float, int]  # seconds and steps


class Work:
    """Physics steps and seconds of robot time, of all rows."""

    def __init__(self) -> None:
        self.seconds, self.steps = 0.0, 0

    def add(self, seconds: float, steps: int) -> None:
        """Count what was simulated."""
        self.seconds, self.steps = self.seconds + seconds, self.steps + steps

    def apart(self, task: Callable[[], T]) -> tuple[T, Done]:
        """Return what a task returns, and what it simulated, which is not counted here."""
        kept, self.seconds, self.steps = (self.seconds, self.steps), 0.0, 0
        try:
            return task(), (self.seconds, self.steps)
        finally:
            self.seconds, self.steps = kept
