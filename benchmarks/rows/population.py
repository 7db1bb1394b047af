"""An evolution strategy's evaluation: whole episodes of members with physics of their own.

`Evaluation` is the job; `ESPopulation` does it with this project's population, `TwoProcesses` does
a random part of it with Gymnasium in two worker processes, `Evaluation.tape` is what raw physics
replays of it.
"""

import heapq
import multiprocessing
import time
from dataclasses import replace
from multiprocessing.pool import Pool
from typing import Any

import numpy as np

from benchmarks import workers
from benchmarks.rows.base import Row, Timing
from benchmarks.rows.physics import Advance, Start, Tape, start
from benchmarks.world import THREADS, Gait, controller, make_simulation, make_tasks
from envs.rows import Step
from envs.simulation import Simulation
from envs.tasks import Hopper
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.population.population import Population, PopulationRequest, draw_seeds

SIGMA = {"hopping": 0.02, "fresh": 0.05}  # spread of the members around the policy, in weights


class Evaluation:
    """The job: members, their robots and the seeds of their episodes, (members, episodes).

    The members spread around the policy of a gait.
    """

    def __init__(self, members: int, episodes: int, gait: Gait) -> None:
        rng, tasks = np.random.default_rng(11), make_tasks()
        tasks.check(make_simulation(1).space)
        self.controller, self.gait = controller(gait), gait
        size = len(self.controller.theta)
        noise = SIGMA[gait] * rng.standard_normal((members, size))
        self.thetas = (self.controller.theta + noise).astype(np.float32)  # (J, P)
        self.values = tasks.sample(rng, members)  # (J, 2)
        self.seeds = draw_seeds(rng, (members, episodes))  # (J, F)

    def members(self) -> PopulationRequest:
        """Return the job as a population takes it, new at each call."""
        noise = np.empty((len(self.thetas), 0, self.thetas.shape[1]), np.float32)
        return PopulationRequest(
            NoAdaptation().start_batch(self.thetas, noise), self.values, self.values, self.seeds
        )

    def tape(self, num_rows: int) -> Tape:
        """Run the job once; return its episodes as a tape for that many rows, the longest first."""
        log = make_simulation(len(self.thetas), kind=EpisodeLog)
        Population([log], self.controller.policy).run(self.members(), self.controller.normalizer())
        return pack(log.episodes, num_rows)

    def sample(self, count: int) -> list[workers.Member]:
        """Return a random part of the episodes as a worker process takes them."""
        rng = np.random.default_rng(12)
        task = Hopper()
        task.setup(task.spec().compile())
        chosen = rng.permutation(self.seeds.size)[:count]
        return [self._member(task, *np.unravel_index(k, self.seeds.shape)) for k in chosen]

    def _member(self, task: Hopper, member: np.intp, episode: np.intp) -> workers.Member:
        layers = replace(self.controller, theta=self.thetas[member]).layers()
        seed = self.seeds[member, episode]
        (qpos,), (qvel,) = task.initial(np.array([seed]))
        mass, friction = self.values[member]
        return workers.Member(
            layers,
            float(mass),
            float(friction),
            qpos,
            qvel,
            int(seed % 2**31),
            self.controller.mean,
        )


class Episode:
    """What one episode did: where it started, on what robot, and its controls."""

    def __init__(self, first: Start) -> None:
        self.start = first  # of one row
        self.controls: list[np.ndarray] = []  # (A,) each


class EpisodeLog(Simulation):
    """Rows that remember each episode by itself."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.episodes: list[Episode] = []
        self._now: dict[int, Episode] = {}

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Reset, and begin episodes."""
        observation = super().reset(ids, values, seeds)
        for row in ids.tolist():
            self._now[row] = Episode(start(self, np.array([row])))
            self.episodes.append(self._now[row])
        return observation

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Step, and write down the controls."""
        rows = range(self.num_rows) if ids is None else ids.tolist()
        for row, control in zip(rows, action.copy(), strict=True):
            self._now[row].controls.append(control)
        return super().step(ids, action)


def pack(episodes: list[Episode], num_rows: int) -> Tape:
    """Lay episodes out over rows, the longest first, which keeps the rows full the longest."""
    schedule: list[tuple[int, int, Episode]] = []  # (first step, row, episode)
    free = [(0, row) for row in range(num_rows)]
    for episode in sorted(episodes, key=lambda e: -len(e.controls)):
        first, row = heapq.heappop(free)
        schedule.append((first, row, episode))
        heapq.heappush(free, (first + len(episode.controls), row))
    begins: dict[int, list[tuple[int, Episode]]] = {}
    for first, row, episode in schedule:
        begins.setdefault(first, []).append((row, episode))
    return _tape(begins, num_rows)


def _tape(begins: dict[int, list[tuple[int, Episode]]], num_rows: int) -> Tape:
    tape: Tape = []
    running: dict[int, tuple[int, Episode]] = {}  # row: (first step, episode)
    step = 0
    while running or any(first >= step for first in begins):
        running = {
            row: (first, e) for row, (first, e) in running.items() if step - first < len(e.controls)
        }
        new = sorted(begins.get(step, []), key=lambda pair: pair[0])
        if new:
            parts = [episode.start for _, episode in new]
            state = tuple(np.concatenate(p) for p in zip(*(s.state for s in parts), strict=True))
            fields = tuple(np.concatenate(p) for p in zip(*(s.fields for s in parts), strict=True))
            tape.append(Start(np.array([row for row, _ in new]), state, fields))
            running.update({row: (step, episode) for row, episode in new})
        if running:
            rows = sorted(running)
            control = np.stack([running[row][1].controls[step - running[row][0]] for row in rows])
            tape.append(Advance(None if len(rows) == num_rows else np.array(rows), control))
        step += 1
    return tape


class ESPopulation(Row):
    """This project's population."""

    memory = "batched"
    refill = 8  # as in conf/algorithm/esmaml.yaml

    def __init__(self, name: str, job: Evaluation, num_rows: int, of: str) -> None:
        self.name, self.of, self._job, self._rows = name, of, job, num_rows
        self.simulations = THREADS * num_rows
        members, episodes = job.seeds.shape
        shards = f"{THREADS} shards of {num_rows} rows, a thread each"
        self.setup = f"{members} members x {episodes}, {shards}, {job.gait}"

    def build(self) -> None:
        """Make the shards."""
        shards = [make_simulation(self._rows, threads=1) for _ in range(THREADS)]
        self._population = Population(shards, self._job.controller.policy, self.refill)

    def run(self) -> Timing:
        """Evaluate all the members."""
        members = self._job.members()
        begin = time.perf_counter()
        results = self._population.run(members, self._job.controller.normalizer())
        return Timing(results.frames, time.perf_counter() - begin, results.lengths.size)


class TwoProcesses(Row):
    """Worker processes that take the members one at a time, in Gymnasium."""

    simulations = THREADS

    def __init__(
        self, name: str, job: Evaluation, episodes: int, kind: workers.Kind, of: str
    ) -> None:
        self.name, self.of, self._kind, self._job = name, of, kind, job
        self._episodes = episodes
        self.setup = (
            f"{episodes} random episodes of those, {THREADS} processes, {kind} policy, {job.gait}"
        )

    def build(self) -> None:
        """Start the workers."""
        self._members = self._job.sample(self._episodes)
        self._pool: Pool = multiprocessing.get_context("spawn").Pool(
            THREADS, workers.start, (self._kind,)
        )
        self._pool.map(workers.evaluate, self._members[: 4 * THREADS], chunksize=1)

    def work(self) -> tuple[float, int]:
        """Evaluate them once; whichever worker is free takes the next."""
        outcomes = list(self._pool.imap_unordered(workers.evaluate, self._members))
        return sum(outcome.steps for outcome in outcomes), len(outcomes)

    def pids(self) -> list[int]:
        """Return the workers."""
        return [process.pid for process in self._pool._pool]  # type: ignore[attr-defined]

    def close(self) -> None:
        """End the workers."""
        self._pool.terminate()
        self._pool.join()
