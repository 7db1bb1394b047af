"""What a walking robot's logs take: a diagnosis of quad8's walks, and the price of four causes.

The emulated robot walks six times for 3 s with drawn offsets, hides dry friction in a knee, and
logs encoders and IMU alone. The policy that is priced is one of linear feedback: a step of it costs
what a step of any small policy does.
"""

import multiprocessing
import tempfile
from dataclasses import replace
from pathlib import Path

from benchmarks.ground import DEVELOPED, KNEE
from benchmarks.ground_loop import feedback
from benchmarks.ground_walks import EPISODES, SECONDS, walks
from benchmarks.rows.base import Row
from benchmarks.rows.diagnosis import Recorded, Worker, diagnosed, imported
from envs.effects import make
from envs.tasks import Quad8
from hardware.config import load_robot
from hardware.log import write_log
from sim2real.evaluation.cause_costs import Cause, CauseCosts, compute_cause_costs

CAUSES: tuple[tuple[str, str | None, float], ...] = (
    ("position_gain", None, 0.7),
    ("viscous_friction", None, 0.05),
    ("ground_friction", None, 0.4),
    ("command_delay", None, 0.02),
)


class DiagnoseWalks(Worker):
    """The ground mode's diagnosis with all its candidates; the rate is seconds of log a second."""

    unit = "s of log"

    def __init__(self, name: str, episodes: int = EPISODES) -> None:
        super().__init__(diagnosed, 8, SECONDS, episodes)
        self.name, self._episodes = name, episodes
        self.setup = (
            f"whole library, {episodes} walks of quad8 of {SECONDS:g} s at 50 Hz, no base logged"
        )

    def build(self) -> None:
        """Walk, write the logs and start the process."""
        self._folder = tempfile.TemporaryDirectory()
        paths = []
        for log in walks("quad8", [KNEE], DEVELOPED, self._episodes):
            paths.append(Path(self._folder.name) / str(log.path))
            write_log(paths[-1], replace(log, path=None))
        self._recorded = Recorded(tuple(paths), Path(load_robot("quad8").model))
        self._pool = multiprocessing.get_context("spawn").Pool(1)
        self._pool.apply(imported)


class PriceCauses(Row):
    """The price of four causes in 16 robots; the rate is episodes a second."""

    of = None
    unit = "episodes"

    def __init__(self, name: str, episodes: int = 64) -> None:
        self.name, self._episodes = name, episodes
        self.setup = f"{len(CAUSES)} causes, {episodes} episodes of quad8 on each of 16 robots"
        self.worth: CauseCosts | None = None

    def build(self) -> None:
        """Make policy and causes."""
        self._policy = feedback(Quad8())
        self._causes = [Cause(make(name, where=where), (value,)) for name, where, value in CAUSES]

    def work(self) -> tuple[float, int]:
        """Price them once."""
        self.worth = compute_cause_costs(self._policy, self._causes, self._episodes)
        count = self._episodes * 2 ** len(CAUSES)
        return count, count
