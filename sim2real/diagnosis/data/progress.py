"""Progress that moves: what is being tried, and a share of the work that neither falls nor rests.

moving = Moving(progress)
moving("fitting backlash.elbow", 0.3)
moving.tick()                               # something was simulated: the share rises a little
"""

import logging
import time
from collections.abc import Callable

import numpy as np

from sim2real.diagnosis.data.together import is_helper

log_ = logging.getLogger(__name__)
Progress = Callable[[str, float], None]  # what is being tried, and the share of the work done
EVERY = 5.0  # s between lines of progress
CREEP, LAST = 0.002, 0.99  # of what is left until the last share, that one simulation takes


class ProgressLines:
    """Progress as lines of the log, not more often than every few seconds."""

    def __init__(self) -> None:
        self._last = -np.inf

    def __call__(self, text: str, share: float) -> None:
        """Log what is being done and the share that is done, in [0, 1]."""
        if time.monotonic() - self._last > EVERY:
            self._last = time.monotonic()
            log_.info("%3.0f %%  %s", 100 * share, text)


class Moving:
    """Progress whose share neither falls nor rests: what is left is known only as it goes."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._text, self._share = progress, "", 0.0

    def __call__(self, text: str, share: float) -> None:
        """Tell what is being tried, at a share of the work that is done at least."""
        self._text, self._share = text, max(self._share, share)
        if is_helper():  # another process tells what it tries
            return
        self._progress(text, self._share)

    def tick(self) -> None:
        """Tell that something more was simulated."""
        self(self._text, self._share + CREEP * max(LAST - self._share, 0.0))
