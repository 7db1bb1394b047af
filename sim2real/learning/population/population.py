"""A population: members that adapt to tasks and are scored, as rows of batched environments.

    population = Population([env(num_rows=32) for _ in range(2)], policy)   # a thread per shard
    cohort = HillClimb(...).start_many(thetas, rngs)
    results = population.run(PopulationRequest(cohort, values, values, seeds), normalizer)
    results.final.mean(axis=1)                      # (J,) scores after adaptation

A member's episodes are those of its adaptation, then those that score the result. Episodes wait in
one queue; rows whose episodes ended take the next ones, so the batches stay full whatever the
episodes' lengths, and the shards share what is left at the end. Nothing a member gets depends on
rows, shards or order, to the last bit.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from envs.rows import Rows
from sim2real.learning.adapt import Adaptation, BatchedSession, NoAdaptation
from sim2real.learning.adapt.ppo import LearnerCohort
from sim2real.learning.modules.normalizer import Normalizer
from sim2real.learning.population.flat_policy import FlatPolicy
from sim2real.learning.population.learners import learn
from sim2real.learning.population.shard import Shard
from sim2real.runs.errors import Sim2RealError


@dataclass(frozen=True)
class PopulationRequest:
    """A population's plan: J members with A adaptation and F final episodes each."""

    cohort: BatchedSession  # their adaptations, J members
    values: np.ndarray  # task parameters during adaptation, (J, P)
    final_values: np.ndarray  # task parameters of the final episodes, (J, P); usually the same
    seeds: np.ndarray  # a seed for each episode, (J, A + F) uint64

    @property
    def adaptation_episodes(self) -> int:
        """A."""
        return sum(self.cohort.stages)

    def __post_init__(self) -> None:
        """Check that the shapes agree."""
        count = len(self.cohort.results)
        episodes = self.seeds.shape[1]
        shapes = (len(self.values), len(self.final_values), len(self.seeds))
        if shapes != (count,) * 3 or episodes < max(self.adaptation_episodes, 1):
            raise Sim2RealError(
                f"population: {count} members with {self.adaptation_episodes} adaptation episodes "
                f"need as many values and seeds, got {shapes} rows and {episodes} seeds each"
            )


@dataclass(frozen=True)
class PopulationResult:
    """A population's returns, E = A + F episodes a member, in their order."""

    returns: np.ndarray  # undiscounted returns, (J, E)
    lengths: np.ndarray  # control steps, (J, E)
    # episodes that a simulation error ended, (J, E) bool; their returns are up to there
    failed: np.ndarray
    thetas: np.ndarray  # adapted parameters, (J, P) float32
    adaptation_episodes: int  # A
    sums: np.ndarray  # sum of (observation - frozen mean) over all steps, (O,)
    squares: np.ndarray  # sum of (observation - frozen mean)^2, (O,)
    # sums of the discounted returns before each step's end and of their squares, of members that
    # learn from steps
    paid: tuple[float, float] = (0.0, 0.0)

    @property
    def final(self) -> np.ndarray:
        """Returns of the final episodes, (J, F)."""
        return self.returns[:, self.adaptation_episodes :]

    @property
    def frames(self) -> int:
        """Environment steps of all episodes."""
        return int(self.lengths.sum())


class Population:
    """Runs members over shards, each a batched environment with its own thread.

    Args:
        shards: environments of the same task. One shard runs in the calling thread.
        policy: the policy of all members, whose parameters differ.
        refill: rows of a shard that must be free before the queue fills them; half of them always
            will do. Starting several episodes at once costs little more than starting one, so that
            more than 1 pays where episodes are short, or where a step of few rows costs as much as
            one of many.
    """

    def __init__(self, shards: Sequence[Rows], policy: FlatPolicy, refill: int = 1) -> None:
        if not shards or refill < 1:
            raise Sim2RealError(
                f"population: {len(shards)} shards and refill={refill}; both must be at least 1"
            )
        self.policy = policy
        self.space = shards[0].space
        self._shards = [
            Shard(rows, policy, min(refill, max(1, rows.num_rows // 2))) for rows in shards
        ]

    @property
    def num_rows(self) -> int:
        """Rows of all shards."""
        return sum(shard.num_rows for shard in self._shards)

    @property
    def in_use(self) -> float:
        """Part of the last run's row steps that were an episode's; the rest waited for others."""
        return float(np.mean([shard.in_use for shard in self._shards]))

    def run(self, members: PopulationRequest, normalizer: Normalizer | None) -> PopulationResult:
        """Run all episodes of all members.

        Args:
            members: what to run. Its cohort is used up.
            normalizer: mean and std of the observations, frozen meanwhile; None feeds them raw.
        """
        if isinstance(members.cohort, LearnerCohort):
            if any(not shard.arrays.on_host for shard in self._shards):
                raise Sim2RealError(
                    "physics=warp cannot run members that learn from their steps; use "
                    "adapt=hillclimb, adapt=none or physics=batch"
                )
            return self._learn(members, members.cohort, normalizer)
        job = Job(members, self.policy.observation_size, len(self._shards))
        job.normalize(normalizer)
        threads = [
            threading.Thread(target=_guard, args=(shard, job), daemon=True)
            for shard in self._shards[1:]
        ]
        for thread in threads:
            thread.start()
        try:
            self._shards[0].run(job)
        finally:
            job.stop()
            for thread in threads:
                thread.join()
        if job.error is not None:
            raise job.error
        return job.results()

    def _learn(
        self, members: PopulationRequest, cohort: LearnerCohort, normalizer: Normalizer | None
    ) -> PopulationResult:
        """Let members learn from their steps, and run the final episodes of what they came to."""
        rounds, shards = members.adaptation_episodes, [shard.rows for shard in self._shards]
        learned = learn(shards, cohort, members.values, members.seeds[:, :rounds], normalizer)
        total, squares = learned.paid.sum(axis=0).tolist()
        found = PopulationResult(
            learned.returns,
            learned.lengths,
            learned.failed,
            cohort.results,
            rounds,
            learned.sums.sum(axis=0),
            learned.squares.sum(axis=0),
            (total, squares),
        )
        if members.seeds.shape[1] == rounds:
            return found
        own = members.final_values
        scored = PopulationRequest(_unchanged(cohort.results), own, own, members.seeds[:, rounds:])
        final = self.run(scored, normalizer)
        return replace(
            found,
            returns=np.concatenate([found.returns, final.returns], axis=1),
            lengths=np.concatenate([found.lengths, final.lengths], axis=1),
            failed=np.concatenate([found.failed, final.failed], axis=1),
            sums=found.sums + final.sums,
            squares=found.squares + final.squares,
        )


def _guard(shard: Shard, job: Job) -> None:
    """Run a shard in a thread and hand its error to the one that waits."""
    try:
        shard.run(job)
    except BaseException as error:  # the calling thread raises it
        job.error = error
        job.stop()


class Job:
    """One run of a population, shared by the shards: its queue and its outcomes."""

    def __init__(self, members: PopulationRequest, observation_size: int, num_shards: int) -> None:
        count, episodes = members.seeds.shape
        self.members, self.cohort = members, members.cohort
        self.error: BaseException | None = None
        self.finals = range(members.adaptation_episodes, episodes)
        self.returns = np.zeros((count, episodes))
        self.lengths = np.zeros((count, episodes), np.int64)
        self.failed = np.zeros((count, episodes), bool)
        self.sums = np.zeros((count, episodes, observation_size))
        self.squares = np.zeros((count, episodes, observation_size))
        self.collect = False
        self.mean = self.scale = np.zeros(0)
        self._num_shards = num_shards
        self._changed = threading.Condition()
        self._queue: deque[tuple[int, int]] = deque()
        self._running = 0
        self._left = count * episodes
        for member in range(count):
            self._enqueue(member)

    def normalize(self, normalizer: Normalizer | None) -> None:
        """Freeze the observations' mean and scale for this run."""
        if normalizer is not None:
            self.collect = True
            self.mean, self.scale = normalizer.mean.copy(), 1 / normalizer.std

    def _enqueue(self, member: int) -> None:
        episodes = self.cohort.available(member) or self.finals
        self._queue.extend((member, episode) for episode in episodes)

    @property
    def waiting(self) -> bool:
        """Whether episodes wait for a row."""
        return bool(self._queue)

    @property
    def done(self) -> bool:
        """Whether nothing is left to run."""
        return self._left <= 0

    def stop(self) -> None:
        """Make all shards return."""
        with self._changed:
            self._left = 0
            self._changed.notify_all()

    def wait(self) -> None:
        """Wait until there may be something to take."""
        with self._changed:
            while not self.done and not self._queue:
                self._changed.wait()

    def dequeue(self, active: int, free: int) -> tuple[np.ndarray, np.ndarray]:
        """Take a fair share of what is left off the queue, for a shard that runs `active`.

        Returns:
            Members and episodes, each (k,), k <= free.
        """
        with self._changed:
            share = -(-(self._running + len(self._queue)) // self._num_shards)
            count = max(0, min(free, share - active, len(self._queue)))
            self._running += count
            taken = [self._queue.popleft() for _ in range(count)]
        members, episodes = np.array(taken, np.int64).reshape(-1, 2).T
        return members, episodes

    def requeue(self, members: np.ndarray, episodes: np.ndarray) -> None:
        """Put episodes that were taken back at the head of the queue."""
        with self._changed:
            self._running -= len(members)
            pairs = zip(members.tolist(), episodes.tolist(), strict=True)
            self._queue.extendleft(reversed(list(pairs)))
            self._changed.notify_all()

    def inputs(
        self, members: np.ndarray, episodes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return all that episodes depend on.

        Args:
            members: (k,).
            episodes: one of each, (k,), of its present stage.

        Returns:
            The policies' parameters (k, P) float32, the tasks' (k, Q) and the seeds (k,) uint64.
        """
        finals = episodes >= self.finals.start
        thetas = self.cohort.results[members]
        if not finals.all():
            adapting = ~finals
            thetas[adapting] = self.cohort.candidates(members[adapting], episodes[adapting])
        own = self.members
        values = np.where(finals[:, None], own.final_values[members], own.values[members])
        return thetas, values, own.seeds[members, episodes]

    def complete(self, members: np.ndarray, episodes: np.ndarray) -> None:
        """Report episodes as over; their outcomes are written."""
        adapting = episodes < self.finals.start
        with self._changed:
            self._running -= len(members)
            self._left -= len(members)
            if adapting.any():
                who, which = members[adapting], episodes[adapting]
                for member in self.cohort.tell(who, which, self.returns[who, which]).tolist():
                    self._enqueue(member)
            self._changed.notify_all()

    def results(self) -> PopulationResult:
        """Gather everything; sums run over members and episodes in their order."""
        return PopulationResult(
            self.returns,
            self.lengths,
            self.failed,
            self.cohort.results,
            self.finals.start,
            self.sums.reshape(-1, self.sums.shape[-1]).sum(axis=0),
            self.squares.reshape(-1, self.squares.shape[-1]).sum(axis=0),
        )


@dataclass(frozen=True)
class AdaptationScores:
    """Returns of n tasks before and after adaptation, (n, episodes) each, and steps spent."""

    before: np.ndarray
    after: np.ndarray
    steps: int


def evaluate_adaptation(
    population: Population,
    theta: np.ndarray,
    normalizer: Normalizer | None,
    adapt: Adaptation,
    values: np.ndarray,
    seeds: np.ndarray,
    episodes: int,
    final_values: np.ndarray | None = None,
) -> AdaptationScores:
    """Score a policy before and after it adapts, on episodes that adaptation has not seen.

    Before and after run under the same seeds, so the starts' randomness cancels in their
    difference.

    Args:
        population: where to run.
        theta: the policy's parameters, (P,).
        normalizer: its observation normalizer, unchanged by this; None for raw observations.
        adapt: the operator. With `NoAdaptation` after equals before.
        values: the tasks, (n, P).
        seeds: one per task, (n,) uint64: all randomness of its perturbations and episodes.
        episodes: scoring episodes of each kind and task.
        final_values: the tasks in scoring episodes, (n, P); None: as `values`.
    """
    final_values = values if final_values is None else final_values
    rngs = [np.random.default_rng(int(seed)) for seed in seeds]
    thetas = np.tile(np.asarray(theta, np.float32), (len(values), 1))
    cohort = adapt.start_many(thetas, rngs)
    fresh = [draw_seeds(rng, adapt.episodes + episodes) for rng in rngs]
    seeds_after = np.stack(fresh)  # (n, A + F)
    adapted = population.run(
        PopulationRequest(cohort, values, final_values, seeds_after), normalizer
    )
    if not adapt.episodes:  # nothing has changed: the same policy on the same episodes
        return AdaptationScores(adapted.final, adapted.final.copy(), adapted.frames)
    unadapted = PopulationRequest(
        _unchanged(thetas), final_values, final_values, seeds_after[:, adapt.episodes :]
    )
    before = population.run(unadapted, normalizer)
    return AdaptationScores(before.returns, adapted.final, adapted.frames + before.frames)


def draw_seeds(rng: np.random.Generator, size: int | tuple[int, ...]) -> np.ndarray:
    """Draw episode seeds, uint64 of the given shape."""
    return rng.integers(0, 2**63, size=size, dtype=np.uint64)


def _unchanged(thetas: np.ndarray) -> BatchedSession:
    return NoAdaptation().start_batch(
        thetas, np.empty((len(thetas), 0, thetas.shape[1]), np.float32)
    )
