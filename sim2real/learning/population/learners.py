"""Members that learn from every step, as rows of batched environments.

    learned = learn(shards, cohort, values, seeds, normalizer)
    cohort.results                                  # (J, P) adapted parameters
    learned.returns                                 # (J, R) of each round

Each member has a row, in which it runs R rounds of S steps with drawn actions; an episode that ends
begins again at once. After a round all members of a shard learn side by side. What a member comes
to depends on its parameters, its robot and its seeds alone, to the last bit.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from envs.rows import Rows, Step
from sim2real.learning.adapt.batched_ppo import RolloutBatch
from sim2real.learning.adapt.ppo import LearnerCohort
from sim2real.learning.modules.normalizer import Normalizer


@dataclass(frozen=True)
class BatchedLearningResult:
    """The results of J members in R rounds."""

    # undiscounted return of the episodes that ended in a round, their mean, (J, R); of the one
    # that goes on where none did
    returns: np.ndarray
    lengths: np.ndarray  # control steps, (J, R)
    failed: np.ndarray  # whether a simulation error ended an episode, (J, R) bool
    sums: np.ndarray  # sum of (observation - frozen mean), (J, O)
    squares: np.ndarray  # sum of (observation - frozen mean)^2, (J, O)
    # sum of the discounted returns so far, and of their squares, over all steps, (J, 2)
    paid: np.ndarray


def learn(
    shards: Sequence[Rows],
    cohort: LearnerCohort,
    values: np.ndarray,
    seeds: np.ndarray,
    normalizer: Normalizer | None,
) -> BatchedLearningResult:
    """Let all members of a cohort learn; its results are then what they came to.

    Args:
        shards: environments of one task; each has a thread, the first the calling one.
        cohort: J members.
        values: their robots' parameters, (J, Q).
        seeds: of all their randomness, (J, R) uint64.
        normalizer: mean and std of the observations, frozen meanwhile; None feeds them raw.
    """
    count, rounds = seeds.shape
    size = shards[0].observation_size
    seen = normalizer or Normalizer(size)
    books = BatchedLearningResult(
        np.zeros((count, rounds)),
        np.full((count, rounds), cohort.operator.steps),
        np.zeros((count, rounds), bool),
        np.zeros((count, size)),
        np.zeros((count, size)),
        np.zeros((count, 2)),
    )

    def work(rows: Rows, members: np.ndarray) -> None:
        for start in range(0, len(members), rows.num_rows):
            some = members[start : start + rows.num_rows]
            _Wave(rows, cohort, some, values[some], seeds[some], seen, books).run()

    _side_by_side(work, shards, np.array_split(np.arange(count), len(shards)))
    return books


def _side_by_side(
    work: Callable[[Rows, np.ndarray], None], shards: Sequence[Rows], parts: list[np.ndarray]
) -> None:
    """Do a part in each shard's thread; raise the first error of any."""
    errors: list[BaseException] = []

    def guarded(rows: Rows, members: np.ndarray) -> None:
        try:
            work(rows, members)
        except BaseException as error:  # the calling thread raises it
            errors.append(error)

    pairs = list(zip(shards, parts, strict=True))
    threads = [threading.Thread(target=guarded, args=pair, daemon=True) for pair in pairs[1:]]
    for thread in threads:
        thread.start()
    guarded(*pairs[0])
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]


class _Wave:
    """As many members as there are rows, through all their rounds."""

    def __init__(
        self,
        rows: Rows,
        cohort: LearnerCohort,
        members: np.ndarray,
        values: np.ndarray,
        seeds: np.ndarray,
        seen: Normalizer,
        books: BatchedLearningResult,
    ) -> None:
        self._rows, self._cohort, self._members, self._values = rows, cohort, members, values
        self._operator, self._books = cohort.operator, books
        self._learners = cohort.learners(members)
        self._rngs = [np.random.default_rng(own) for own in seeds]
        self._mean, self._scale = seen.mean, 1 / seen.std
        self._ids = np.arange(len(members))
        self._view = None if len(members) == rows.num_rows else self._ids
        self._return, self._discounted = np.zeros(len(members)), np.zeros(len(members))
        self._raw = np.zeros((len(members), rows.observation_size))

    def run(self) -> None:
        """Run and learn, round after round."""
        self._restart(self._ids)
        for number in range(self._operator.rounds):
            steps = self._explore(number)
            orders = [self._operator.orders(rng, self._operator.steps) for rng in self._rngs]
            self._learners.learn(steps, torch.from_numpy(np.stack(orders)))
        self._cohort.results[self._members] = self._learners.thetas

    def _restart(self, ids: np.ndarray) -> None:
        """Start an episode in rows ids (k,), each with the next seed of its member."""
        seeds = np.array([self._rngs[i].integers(2**63, dtype=np.uint64) for i in ids])
        self._raw[ids] = self._rows.reset(ids, self._values[ids], seeds)
        self._return[ids] = self._discounted[ids] = 0.0

    def _explore(self, number: int) -> RolloutBatch:
        """Run a round; its rewards are in the critic's unit."""
        count, steps = len(self._ids), self._operator.steps
        size = len(self._rows.action_low)
        noise = np.stack([r.standard_normal((steps, size), np.float32) for r in self._rngs])
        seen = np.zeros((count, steps, self._raw.shape[1]), np.float32)
        after, action = np.zeros_like(seen), np.zeros((count, steps, size), np.float32)
        reward = np.zeros((count, steps), np.float32)
        done, terminated = np.zeros((count, steps), bool), np.zeros((count, steps), bool)
        ended, earned = np.zeros(count), np.zeros(count)
        for t in range(steps):
            seen[:, t] = self._look()
            action[:, t] = drawn = self._learners.act(seen[:, t], noise[:, t])
            cut = np.clip(drawn.astype(np.float64), self._rows.action_low, self._rows.action_high)
            step = self._rows.step(self._view, cut)
            reward[:, t] = step.reward / self._operator.unit
            after[:, t] = (step.observation - self._mean) * self._scale
            terminated[:, t], done[:, t] = step.terminated, step.terminated | step.truncated
            self._note(number, step)
            self._raw[:] = step.observation
            if (over := np.flatnonzero(done[:, t])).size:
                ended[over] += 1
                earned[over] += self._return[over]
                self._restart(over)
        mean = np.where(ended > 0, earned / np.maximum(ended, 1), self._return)
        self._books.returns[self._members, number] = mean
        columns = (seen, action, reward, after, done, terminated)
        return RolloutBatch(*(torch.from_numpy(x) for x in columns))

    def _look(self) -> np.ndarray:
        """Return the policies' normalized observations, (n, O), and update their statistics."""
        off = self._raw - self._mean
        self._books.sums[self._members] += off
        self._books.squares[self._members] += off**2
        return off * self._scale

    def _note(self, number: int, step: Step) -> None:
        """Count what a step paid."""
        self._return += step.reward
        self._discounted = self._operator.gamma * self._discounted + step.reward
        self._books.paid[self._members] += np.stack([self._discounted, self._discounted**2], -1)
        self._books.failed[self._members, number] |= step.failed
