"""Keeps the engine's warnings out of the terminal and out of MUJOCO_LOG.TXT.

    with quiet_engine():
        batch.step(nstep=4)

By default MuJoCo prints a warning for each simulation that diverges and appends it to
MUJOCO_LOG.TXT in the working directory: among a thousand rows that is a flood. Nothing is lost by
silence, since the warnings are counted for each simulation and its row ends as failed. The engine's
setting belongs to the process, so it is put back when the last of the blocks that run in several
threads ends, and the user's own calls of MuJoCo stay as loud as they were.
"""

import threading
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from mujoco import MjLogConfig


class _Silence:
    """Counts the blocks that want silence, over all threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._blocks = 0
        self._loud = MjLogConfig.get()

    def __enter__(self) -> None:
        with self._lock:
            if self._blocks == 0:
                self._loud, silent = MjLogConfig.get(), MjLogConfig.get()
                silent.logto_console = silent.logto_file = False
                MjLogConfig.set(silent)
            self._blocks += 1

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._blocks -= 1
            if self._blocks == 0:
                MjLogConfig.set(self._loud)


_silence = _Silence()


def no_log_file() -> None:
    """Let the engine write no MUJOCO_LOG.TXT into whatever folder this program was started in."""
    kept = MjLogConfig.get()
    kept.logto_file = False
    MjLogConfig.set(kept)


def quiet_engine() -> AbstractContextManager[None]:
    """Send the engine's messages nowhere inside the block, and in all that are within it."""
    return _silence


@contextmanager
def no_deprecation_notice() -> Iterator[None]:
    """Keep quiet about `settotalmass`, an attribute that Gymnasium's half_cheetah.xml still has."""
    with quiet_engine(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*settotalmass.*")
        yield
