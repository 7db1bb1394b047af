"""A shard: one batched environment whose rows run a population's episodes.

    shard.clear()
    while episodes_are_left:
        shard.fill(feed)        # free rows take what waits
        shard.step(feed)        # one control step; episodes that end go into the feed's books

Rows are filled again soon after their episodes ended. What an episode comes to does not depend on
its row, on the other rows, or on how many there are.
"""

from typing import Protocol

import numpy as np

from envs.rows import Rows, arrays_of
from sim2real.learning.population.device_slots import Slots
from sim2real.learning.population.flat_policy import FlatPolicy


class EpisodeQueue(Protocol):
    """A shard's source of episodes and sink of their outcomes, by member and episode."""

    collect: bool  # whether sums of observations are wanted, and observations normalized
    mean: np.ndarray  # (O,)
    scale: np.ndarray  # (O,)
    returns: np.ndarray  # (J, E)
    lengths: np.ndarray  # (J, E)
    failed: np.ndarray  # (J, E)
    sums: np.ndarray  # (J, E, O)
    squares: np.ndarray  # (J, E, O)

    @property
    def waiting(self) -> bool:
        """Whether episodes wait for a row."""
        ...

    def dequeue(self, active: int, free: int) -> tuple[np.ndarray, np.ndarray]:
        """Take members' episodes off the queue, at most `free`."""
        ...

    def inputs(
        self, members: np.ndarray, episodes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the policies' parameters, the tasks' and the seeds of episodes."""
        ...

    def complete(self, members: np.ndarray, episodes: np.ndarray) -> None:
        """Report episodes as over; their outcomes are written."""
        ...


class SharedEpisodeQueue(EpisodeQueue, Protocol):
    """A feed that several shards share until it is done."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to run."""
        ...

    def wait(self) -> None:
        """Wait until there may be something to take."""
        ...


class Shard:
    """One batched environment, its policies and the books of the episodes in its rows."""

    def __init__(self, rows: Rows, policy: FlatPolicy, refill: int) -> None:
        count, size = rows.num_rows, policy.observation_size
        self.num_rows, self._refill = count, refill
        self.arrays = arrays = arrays_of(rows)
        on_host = arrays.on_host
        self.rows, self._slots = rows, policy.slots(count) if on_host else Slots(policy, rows)
        self._observation = arrays.zeros((count, size))
        self._sums, self._squares = arrays.zeros((count, size)), arrays.zeros((count, size))
        self._returns, self._lengths = arrays.zeros(count), arrays.zeros(count, np.int64)
        self._steps = self._idle = 0  # control steps of rows with and without an episode
        self._member, self._episode = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._active = np.zeros(count, bool)
        self._ids = np.flatnonzero(self._active)  # (n,) rows with an episode in them

    def run(self, job: SharedEpisodeQueue) -> None:
        """Work until the job is done."""
        self.clear()
        self._steps = self._idle = 0
        while not job.done:
            self.fill(job)
            if self.active:
                self.step(job)
            else:
                job.wait()

    @property
    def in_use(self) -> float:
        """Part of the last run's row steps that were an episode's."""
        return self._steps / max(1, self._steps + self._idle)

    @property
    def active(self) -> int:
        """Rows with an episode in them."""
        return len(self._ids)

    def clear(self) -> None:
        """Forget the episodes in the rows."""
        self._active[:] = False
        self._ids = np.flatnonzero(self._active)

    def fill(self, job: EpisodeQueue) -> None:
        """Start queued episodes in free rows."""
        free = self.num_rows - self.active
        if free == 0 or not job.waiting or (self.active and free < self._refill):
            return
        members, episodes = job.dequeue(self.active, free)
        if not len(members):
            return
        ids = np.flatnonzero(~self._active)[: len(members)]
        self._member[ids], self._episode[ids] = members, episodes
        thetas, values, seeds = job.inputs(members, episodes)
        self._slots.load(ids, thetas)
        rows = self.arrays.rows(ids)
        self._observation[rows] = self.rows.reset(ids, values, seeds)
        for book in (self._sums, self._squares, self._returns, self._lengths):
            book[rows] = 0
        self._active[ids] = True
        self._ids = np.flatnonzero(self._active)

    def step(self, job: EpisodeQueue) -> None:
        """Advance every running episode by one control step.

        A device steps all its rows, those without an episode, too.
        """
        full = len(self._ids) == self.num_rows or not self.arrays.on_host
        ids, view = (None, slice(None)) if full else (self._ids, self._ids)
        self._steps += len(self._ids)
        self._idle += self.num_rows - len(self._ids)
        observation = self._observation[view]
        if job.collect:
            observation = observation - self.arrays.own(job.mean)  # (n, O)
            self._sums[view] += observation
            self._squares[view] += observation**2
            observation = observation * self.arrays.own(job.scale)
        step = self.rows.step(ids, self._slots.act(ids, observation))
        self._observation[view] = step.observation
        self._returns[view] += step.reward
        self._lengths[view] += 1
        over = self.arrays.host(step.terminated | step.truncated)
        if full and len(self._ids) < self.num_rows:
            over = over & self._active
        if over.any():
            ended = np.flatnonzero(over) if full else self._ids[over]
            self._finish(job, ended, self.arrays.host(step.failed)[over])

    def _finish(self, job: EpisodeQueue, ids: np.ndarray, failed: np.ndarray) -> None:
        """Write down the outcomes of episodes that are over and free their rows."""
        members, episodes = self._member[ids], self._episode[ids]
        rows, host = self.arrays.rows(ids), self.arrays.host
        job.returns[members, episodes] = host(self._returns[rows])
        job.lengths[members, episodes] = host(self._lengths[rows])
        job.failed[members, episodes] = failed
        if job.collect:
            job.sums[members, episodes] = host(self._sums[rows])
            job.squares[members, episodes] = host(self._squares[rows])
        self._active[ids] = False
        self._ids = np.flatnonzero(self._active)
        job.complete(members, episodes)
