"""Keeps the engine's warnings out of the terminal and out of MUJOCO_LOG.TXT.

    with quiet_engine():
        batch.step(nstep=4)

By default MuJoCo prints a warning for each simulation that diverges and appends it to
MUJOCO_LOG.TXT in the working directory: among a thousand rows that is a flood. Nothing is lost by
silence, since the warnings are counted for each simulation and its row ends as failed. The engine's
setting belongs to the process, so it is put back at once and the user's own calls of MuJoCo stay as
loud as they were.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from mujoco import MjLogConfig


@contextmanager
def quiet_engine() -> Iterator[None]:
    """Send the engine's messages nowhere inside the block; takes 2 µs."""
    loud, silent = MjLogConfig.get(), MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    MjLogConfig.set(silent)
    try:
        yield
    finally:
        MjLogConfig.set(loud)


@contextmanager
def no_deprecation_notice() -> Iterator[None]:
    """Keep quiet about `settotalmass`, an attribute that Gymnasium's half_cheetah.xml still has."""
    with quiet_engine(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*settotalmass.*")
        yield
