"""The progress of a running job: a bar in a terminal, a line now and then elsewhere.

    with Progress(total=200, unit="iteration", done=0) as progress:
        progress.update(10, frames=81920, score=812.4)

Time left is reckoned from the units done since the start; speed is in environment steps.
"""

from __future__ import annotations

import logging
import sys
import time
from contextlib import ExitStack
from typing import Any, TextIO

from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

log = logging.getLogger(__name__)


class Progress:
    """Shows how far a job is, its return, its speed and the time left.

    Args:
        total: units of work in all.
        unit: what they are called.
        done: units done before, by a run that this one continues.
        frames: environment steps done before.
        every: seconds between lines where there is no terminal.
        stream: where the bar goes; None for stderr. Lines go to the log.
    """

    def __init__(
        self,
        total: int,
        unit: str,
        done: int = 0,
        frames: int = 0,
        every: float = 30.0,
        stream: TextIO | None = None,
    ) -> None:
        terminal = stream or sys.stderr
        self.total, self.unit = total, unit
        self._start_done, self._start_frames = done, frames
        self._start = self._last_line = time.monotonic()
        self._every = every
        self._bar: Any = None
        self._lines = ExitStack()
        if terminal is not None and terminal.isatty():
            self._lines.enter_context(logging_redirect_tqdm())  # the log's lines go above the bar
            layout = "{desc} {n_fmt}/{total_fmt} |{bar}| {elapsed}, {remaining} left{postfix}"
            self._bar = tqdm(
                total=total,
                initial=done,
                desc=unit,
                bar_format=layout,
                file=terminal,
                dynamic_ncols=True,
                unit_scale=total >= 10_000,
            )

    def update(self, done: int, frames: int | None = None, score: float | None = None) -> None:
        """Show a new state.

        Args:
            done: units done so far, those before this run included.
            frames: environment steps so far, if they are counted.
            score: the newest return, if there is one.
        """
        now = time.monotonic()
        words = [] if score is None else [f"return {score:.1f}"]
        if frames is not None:
            words.append(
                f"{(frames - self._start_frames) / max(now - self._start, 1e-9):,.0f} steps/s"
            )
        if self._bar is not None:
            self._bar.set_postfix_str(", ".join(words), refresh=False)
            self._bar.update(min(done, self.total) - self._bar.n)
        elif now - self._last_line >= self._every or done >= self.total:
            self._last_line = now
            left = (now - self._start) * max(self.total - done, 0) / max(done - self._start_done, 1)
            words.append(f"{format_duration(left)} left")
            log.info("%s %d/%d, %s", self.unit, done, self.total, ", ".join(words))

    def report(self, done: int, total: int) -> None:
        """Show a new state of a job that says itself how much there is."""
        self.total = total
        if self._bar is not None:
            self._bar.total = total
        self.update(done)

    def close(self) -> None:
        """Leave the bar as it is and end its line."""
        if self._bar is not None:
            self._bar.close()
        self._lines.close()

    def __enter__(self) -> Progress:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the bar."""
        self.close()


def format_duration(seconds: float) -> str:
    """Write a duration as 1:02:03 or 2:03."""
    minutes, seconds = divmod(round(max(seconds, 0)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
