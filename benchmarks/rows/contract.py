"""The check of a policy's interface on one long log: quad12's own policy, walking in simulation.

The log is read from its file, and the policy from its export, each time.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.contract_walk import Fault, walk
from benchmarks.policies.tasks import OWN
from benchmarks.rows.base import Row
from envs.tasks import Quad12
from hardware.exported import ExportedPolicy
from hardware.log import read_log, write_log
from sim2real.deployment.actors import load_actor
from sim2real.diagnosis.contract.answer import Answer
from sim2real.diagnosis.contract.description import read_description
from sim2real.diagnosis.contract.logged import check_logs

SWAPPED = ("hip_fl", "hip_fr")  # joints that the policy sees in each other's place


class CheckContract(Row):
    """One check; the rate is seconds of log a second."""

    of = None
    unit = "s of log"

    def __init__(self, name: str, faulty: bool, seconds: float) -> None:
        self.name, self._faulty, self._seconds = name, faulty, seconds
        what = f"{' and '.join(SWAPPED)} swapped" if faulty else "no fault"
        self.setup = f"a log of {seconds:g} s at 50 Hz, 12 joints, {what}"
        self.answer: Answer | None = None

    def build(self) -> None:
        """Walk, and write the log."""
        self._folder = tempfile.TemporaryDirectory()
        self._log = Path(self._folder.name) / "walk.csv"
        task = Quad12(seconds=self._seconds)
        about = read_description("quad12", list(ExportedPolicy.load(OWN).joints))
        order = np.arange(len(about.joints))
        swapped = [about.joints.index(name) for name in SWAPPED]
        order[swapped] = order[swapped[::-1]]
        place = f"joint_position: {', '.join(SWAPPED)}"
        faults = [Fault(("observation", "permutation", place), lambda seen: seen[order])]
        actor = ExportedPolicy.load(OWN)
        made = walk(task, about, faults if self._faulty else [], actor, np.random.default_rng(0))
        write_log(self._log, replace(made, meta={"task": "Quad12", "policy": str(OWN.resolve())}))

    def work(self) -> tuple[float, int]:
        """Check it once."""
        self.answer = check_logs([read_log(self._log)], load_policy=load_actor)
        return self._seconds, 0

    def close(self) -> None:
        """Take the log away."""
        self._folder.cleanup()
