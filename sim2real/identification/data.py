"""The input of an identification: logs, their model, and known effects.

data = Recordings(read_logs("logs/"), "arm.xml", fixed=load_effects("effects.yaml"))
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from envs.effects import Effect
from envs.plant import Fixed
from envs.rows import Rows
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.ground.estimate import estimate_all
from sim2real.diagnosis.ground.windows import grounded
from sim2real.diagnosis.settings import DEFAULT

Act = Callable[[np.ndarray], np.ndarray]  # observations (n, O) to actions (n, A)


@dataclass(frozen=True)
class PolicySimulation:
    """The simulated task that a policy acts in, for rollouts."""

    rows: Callable[[Sequence[Effect], int], Rows]  # makes them, of these effects and this number
    # makes the policy for a number of rows; called with all their observations, step after step,
    # it returns their actions
    act: Callable[[int], Act]
    name: str = "the task"  # its name, for messages


@dataclass(frozen=True)
class Recordings:
    """Logs of one robot."""

    logs: Sequence[Log]
    model: str | Path | None = None  # an MJCF for all of them; None: the one that each log names
    fixed: Sequence[Fixed] = ()  # effects that are known, and part of the model
    world: PolicySimulation | None = None  # what rollouts need; None where nothing rolls out

    @cached_property
    def windows(self) -> Data:
        """The logs, cut into windows as a diagnosis cuts them.

        If the base of a walking robot was not measured, it is estimated from encoders, IMU and
        the feet that stand, and what is not known of a window's start is taken out of its errors.

        Raises:
            Sim2RealError: what `estimate_all` and `Data.of` refuse.
        """
        estimates = estimate_all(self.logs, self.model, DEFAULT.ground)
        data = Data.of([one.log for one in estimates] or self.logs, self.model)
        return grounded(data, estimates, self.fixed) if estimates else data

    def hashes(self) -> dict[str, str]:
        """Return the SHA-256 of each log's file, by name; of one in memory, of its numbers."""
        found = {}
        for number, log in enumerate(self.logs):
            name = log.path.name if log.path else f"log {number + 1}"
            content = (
                log.path.read_bytes()
                if log.path and log.path.is_file()
                else b"".join(np.ascontiguousarray(c).tobytes() for c in log.columns.values())
            )
            found[name] = hashlib.sha256(content).hexdigest()
        return found
