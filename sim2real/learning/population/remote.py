"""A population whose episodes run in other processes: what is said to them, and what if one dies.

    shards = [RemoteShard(start, num_rows=32, name=f"worker {i}") for i in range(16)]
    population = RemotePopulation(shards, policy, space)
    results = population.run(members, normalizer)     # the numbers of a local `Population`

The adaptations stay here; what travels are single episodes: parameters, task and seed there, return
and sums of observations back. An episode is a function of these alone, so it does not matter who
runs it, nor whether it runs twice because a worker died. `sim2real.learning.population.cluster` has
the workers.
"""

import logging
import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from envs.params import ParamSpace
from envs.rows import Rows
from sim2real.learning.adapt.ppo import LearnerCohort
from sim2real.learning.modules.normalizer import Normalizer
from sim2real.learning.population.flat_policy import FlatPolicy
from sim2real.learning.population.population import (
    Job,
    Population,
    PopulationRequest,
    PopulationResult,
)
from sim2real.learning.population.shard import Shard
from sim2real.runs.errors import Sim2RealError

log = logging.getLogger(__name__)
AHEAD = 2  # episodes handed to a worker per row, so that its rows never wait for this process
GRACE = 10.0  # s, for the place of a dead worker to become free
Make = Callable[[], Rows]


class ClusterError(Sim2RealError):
    """The cluster is not there, too small, or all of its workers died."""


class Batch(NamedTuple):
    """Episodes to run, k of them."""

    tickets: np.ndarray  # (k,) int64, what identifies the outcomes
    thetas: np.ndarray  # (k, P) float32, policies' parameters
    values: np.ndarray  # (k, Q), task parameters
    seeds: np.ndarray  # (k,) uint64


class Outcomes(NamedTuple):
    """The results of k episodes; see `PopulationResult` for the columns."""

    tickets: np.ndarray  # (k,)
    returns: np.ndarray  # (k,)
    lengths: np.ndarray  # (k,)
    failed: np.ndarray  # (k,)
    sums: np.ndarray  # (k, O)
    squares: np.ndarray  # (k, O)


class ObservationScaling(NamedTuple):
    """The normalization of observations during a run; `mean` None feeds them raw."""

    run: int  # number of the run; a new one makes a worker forget what is left of the last
    mean: np.ndarray | None  # (O,)
    scale: np.ndarray | None  # (O,)


class Stream:
    """The episodes that a worker holds: a shard's feed in which each is a separate member.

    Args:
        capacity: episodes held at a time.
        policy: the policy of all members.
        space_size: Q, numbers of a task.
    """

    def __init__(self, capacity: int, policy: FlatPolicy, space_size: int) -> None:
        size = policy.observation_size
        self.returns, self.lengths = np.zeros((capacity, 1)), np.zeros((capacity, 1), np.int64)
        self.failed = np.zeros((capacity, 1), bool)
        self.sums, self.squares = np.zeros((capacity, 1, size)), np.zeros((capacity, 1, size))
        self._tickets, self._seeds = np.zeros(capacity, np.int64), np.zeros(capacity, np.uint64)
        self._thetas = np.zeros((capacity, policy.num_parameters), np.float32)
        self._values = np.zeros((capacity, space_size))
        self.start(ObservationScaling(-1, None, None))

    def start(self, frame: ObservationScaling) -> None:
        """Forget all episodes and begin a run."""
        self.run, self.collect = frame.run, frame.mean is not None
        self.mean = np.zeros(0) if frame.mean is None else frame.mean
        self.scale = np.zeros(0) if frame.scale is None else frame.scale
        self._free = list(range(len(self._seeds)))
        self._queue: deque[int] = deque()
        self._finished: list[int] = []

    def add(self, batch: Batch) -> None:
        """Queue episodes."""
        places = [self._free.pop() for _ in batch.tickets]
        self._tickets[places], self._seeds[places] = batch.tickets, batch.seeds
        self._thetas[places], self._values[places] = batch.thetas, batch.values
        self._queue.extend(places)

    @property
    def waiting(self) -> bool:
        """Whether episodes wait for a row."""
        return bool(self._queue)

    @property
    def finished(self) -> int:
        """Episodes that are over and not yet collected."""
        return len(self._finished)

    def dequeue(self, active: int, free: int) -> tuple[np.ndarray, np.ndarray]:
        """Take up to `free` episodes off the queue."""
        places = [self._queue.popleft() for _ in range(min(free, len(self._queue)))]
        return np.array(places, np.int64), np.zeros(len(places), np.int64)

    def inputs(
        self, members: np.ndarray, episodes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the policies' parameters, the tasks' and the seeds of episodes."""
        return self._thetas[members], self._values[members], self._seeds[members]

    def complete(self, members: np.ndarray, episodes: np.ndarray) -> None:
        """Note that episodes are over."""
        self._finished += members.tolist()

    def outcomes(self) -> Outcomes:
        """Return the outcomes of finished episodes, and free their rows."""
        at = np.array(self._finished, np.int64)
        self._free += self._finished
        self._finished = []
        numbers = (self.returns, self.lengths, self.failed, self.sums, self.squares)
        return Outcomes(self._tickets[at], *(column[at, 0] for column in numbers))


class Worker:
    """Runs the episodes that it is sent, in a process of the cluster.

    Args:
        make: makes its environment.
        policy: the policy of all members.
        refill: see `Population`.
    """

    def __init__(self, make: Make, policy: FlatPolicy, refill: int) -> None:
        rows = make()
        self._shard = Shard(rows, policy, min(refill, rows.num_rows))
        self._stream = Stream(AHEAD * rows.num_rows, policy, rows.space.size)
        self._enough = max(1, rows.num_rows // 4)

    def ready(self) -> int:
        """Return the process's number, once the environment is built."""
        return os.getpid()

    def advance(self, frame: ObservationScaling, batch: Batch) -> Outcomes:
        """Take on episodes, and work until some, of these or of earlier ones, are over.

        Args:
            frame: of the run that they belong to.
            batch: may be empty.
        """
        shard, stream = self._shard, self._stream
        if frame.run != stream.run:
            stream.start(frame)
            shard.clear()
        stream.add(batch)
        while True:
            shard.fill(stream)
            enough = self._enough if stream.waiting else 1
            if not shard.active or stream.finished >= enough:
                return stream.outcomes()
            shard.step(stream)


class WorkerLostError(Exception):
    """A worker, or what it had to say, is gone."""


class Link(Protocol):
    """A worker somewhere."""

    def advance(self, frame: ObservationScaling, batch: Batch) -> Outcomes:
        """Do `Worker.advance` there; raises Lost when the worker is gone."""
        ...


class RemoteShard:
    """Stands for a worker among a population's shards: feeds it, and replaces it when it dies.

    Args:
        start: starts a worker, waiting for a place for so long [s]; None if there is none.
        num_rows: the number of rows of the worker.
        name: the name in messages.
    """

    def __init__(self, start: Callable[[float], Link | None], num_rows: int, name: str) -> None:
        self.num_rows, self.name = num_rows, name
        self.fleet: Sequence[RemoteShard] = (self,)  # all that share a population
        self._start, self.link = start, start(GRACE)
        self._taken: dict[int, tuple[int, int]] = {}  # member and episode by ticket
        self._tickets = self._runs = 0

    def run(self, job: Job) -> None:
        """Work until the job is done.

        Raises:
            ClusterError: when all workers died and there is no place for others.
        """
        self._taken.clear()
        self._runs += 1
        mean, scale = (job.mean, job.scale) if job.collect else (None, None)
        frame = ObservationScaling(self._runs, mean, scale)
        self.link = self.link or self._start(0.0)
        while not job.done and self.link is not None:
            batch = self._batch(job)
            if not self._taken:
                job.wait()
                continue
            try:
                self._write(job, self.link.advance(frame, batch))
            except WorkerLostError as error:
                self._recover(job, error)
        if not any(shard.link for shard in self.fleet):
            raise ClusterError("all workers died, and no CPU is free for replacements")
        while not job.done:
            time.sleep(0.05)  # without a worker: the others finish

    def _batch(self, job: Job) -> Batch:
        """Take as many episodes as the worker has room for."""
        room = AHEAD * self.num_rows - len(self._taken)
        members, episodes = job.dequeue(len(self._taken), room)
        tickets = np.arange(self._tickets, self._tickets + len(members))
        self._tickets += len(members)
        pairs = zip(members.tolist(), episodes.tolist(), strict=True)
        self._taken.update(zip(tickets.tolist(), pairs, strict=True))
        return Batch(tickets, *job.inputs(members, episodes))

    def _write(self, job: Job, outcomes: Outcomes) -> None:
        """Enter outcomes into the job's books."""
        pairs = [self._taken.pop(ticket) for ticket in outcomes.tickets.tolist()]
        members, episodes = np.array(pairs, np.int64).reshape(-1, 2).T
        job.returns[members, episodes] = outcomes.returns
        job.lengths[members, episodes] = outcomes.lengths
        job.failed[members, episodes] = outcomes.failed
        if job.collect:
            job.sums[members, episodes] = outcomes.sums
            job.squares[members, episodes] = outcomes.squares
        job.complete(members, episodes)

    def _recover(self, job: Job, error: Exception) -> None:
        """Give the episodes of a dead worker to the others, and start another in its place."""
        log.warning(
            "%s is lost (%s); rescheduling its %d episodes", self.name, error, len(self._taken)
        )
        members, episodes = np.array(list(self._taken.values()), np.int64).reshape(-1, 2).T
        self._taken.clear()
        job.requeue(members, episodes)
        self.link = self._start(GRACE)
        if self.link is None:
            log.warning("no CPU is free for a replacement worker; continuing with the others")


class RemotePopulation(Population):
    """A population whose shards are elsewhere.

    Args:
        shards: the workers' stand-ins.
        policy: the policy of all members, whose parameters differ.
        space: parameters of the task.
    """

    def __init__(
        self, shards: Sequence[RemoteShard], policy: FlatPolicy, space: ParamSpace
    ) -> None:
        self.policy, self.space = policy, space
        self._shards = list(shards)  # type: ignore[assignment]
        for shard in shards:
            shard.fleet = shards

    def _learn(
        self, members: PopulationRequest, cohort: LearnerCohort, normalizer: Normalizer | None
    ) -> PopulationResult:
        raise ClusterError(
            f"{cohort.operator} needs every step, but a cluster reports only returns; use "
            f"cluster=none"
        )
