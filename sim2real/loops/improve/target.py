"""A task that stands for the robot in a loop; its state is all known, and nothing else of it.

    target = Target(world, simulator, trials=10, seed=0)
    target.deploy(trained, folder)              # returns there, one an episode
    target.score(trained, effects)              # in the simulator, from the same starts
    target.record(place, number)                # the episodes of the round before, to be diagnosed

It takes the place of `site.RobotSetup`. What was recorded of its episodes is diagnosed in pieces
that restart from the recorded state: a simulation of a robot that nothing holds, such as a hopper
in flight, leaves the recording soon whatever the model; restarted often, what it makes of the
model's errors stays measurable.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from envs.models import named
from envs.randomization import Randomization
from envs.simulation import Simulation
from hardware.log import Log, read_logs, write_log
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.population.recording import RecordedEpisodes, record
from sim2real.learning.trained import TrainedPolicy
from sim2real.loops.improve.site import DEPLOYED, check_trials
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import atomic_folder, write_text

PIECE = 0.25  # s between restarts from a recorded state: longer ones diverge by themselves
RETURNS = "returns.csv"
STARTS = 1  # stream of randomness: the episodes, the same for all policies


@dataclass(frozen=True)
class Target:
    """A simulated robot, of which the loop knows its episodes alone.

    Raises:
        Sim2RealError: fewer than two trials, or worlds that are not simulations of a robot.
    """

    world: EnvironmentFactory  # what stands for the robot
    environment: EnvironmentFactory  # the simulator of its task, as given
    trials: int  # episodes of each policy
    seed: int  # of their starts
    stand = False
    by_distance = False

    def __post_init__(self) -> None:
        check_trials(self.trials)
        for made, key in ((self.world, "target"), (self.environment, "env")):
            if not made.simulated:
                raise Sim2RealError(
                    f"{key} is a {made.name}, which has no robot to diagnose; "
                    f"choose a simulated one, such as {key}=hopper_polito"
                )

    @property
    def name(self) -> str:
        """Its name in the loop's files."""
        return f"target {self.world.name}"

    @cached_property
    def _seeds(self) -> np.ndarray:
        return draw_seeds(np.random.default_rng([self.seed, STARTS]), self.trials)

    def _played(self, trained: TrainedPolicy, world: EnvironmentFactory) -> RecordedEpisodes:
        robot = world.base_rows(self.trials)
        assert isinstance(robot, Simulation)
        return record(robot, trained.controller(num_rows=self.trials), self._seeds)

    def score(self, trained: TrainedPolicy, effects: Sequence = ()) -> list[float]:
        """Return a policy's returns in the simulator with effects, from the target's starts."""
        world = replace(self.environment, tasks=Randomization(), fixed=effects)
        return self._played(trained, world).returns.tolist()

    def deploy(self, trained: TrainedPolicy, folder: Path) -> list[float]:
        """Run a policy on the target, unless the folder is there, and return its returns."""
        if not folder.is_dir():
            done = self._played(trained, self.world)
            with atomic_folder(folder) as place:
                write_text(place / "model.xml", self._model())
                (place / "logs").mkdir()
                log = replace(done.log, meta={**done.log.meta, "model": "../model.xml"})
                write_log(place / "logs" / "episodes.csv", log)
                lines = ["return", *map(repr, done.returns.tolist())]
                write_text(place / RETURNS, "\n".join(lines) + "\n")
        with (folder / RETURNS).open(encoding="utf-8", newline="") as file:
            return [float(row["return"]) for row in csv.DictReader(file)]

    def _model(self) -> str:
        """Return the simulator's robot, which the target's episodes are held against."""
        rows = self.environment.base_rows(1)
        assert isinstance(rows, Simulation)
        return named(rows.task.spec()).to_xml()

    def record(self, place: Path, number: int) -> list[Log]:
        """Return the episodes of the round before a round's folder, in pieces."""
        before = place.with_name(f"round_{number - 1}") / DEPLOYED
        return [cut(log, PIECE) for log in read_logs(before)]


def cut(log: Log, seconds: float) -> Log:
    """Return the log in episodes of about `seconds` s, each from its own recorded state."""
    parts = []
    for part in log.episodes():
        pieces = max(1, round(float(part.time[-1]) / seconds))
        edges = np.linspace(0, len(part) - 1, pieces + 1).astype(int)
        parts += [(part, a, b + 1) for a, b in pairwise(edges)]
    columns = {
        name: np.concatenate([part.columns[name][a:b] for part, a, b in parts])
        for name in log.columns
    }
    columns["time"] = np.concatenate([p.time[a:b] - p.time[a] for p, a, b in parts])
    columns["episode"] = np.repeat(np.arange(len(parts)), [b - a for _, a, b in parts])
    return Log(columns, log.meta, log.path)
