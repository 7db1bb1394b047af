"""Hill climbing: try a perturbed policy, keep it if it did better (Song et al. 2020)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from sim2real.learning.adapt.base import Adaptation, Cohort
from sim2real.learning.adapt.gradient import mean_rows
from sim2real.runs.errors import Sim2RealError

Mode = Literal["sequential", "average", "batch"]


class HillClimb(Adaptation):
    """Q rounds of proposals around the best policy so far, the incumbent.

    The incumbent is first run I times; the mean is its value. Each round costs P episodes:
    *sequential* (P = 1) proposes one policy and runs it once; *average* proposes one and takes its
    mean over P episodes; *batch* proposes P, runs each once and takes the best. A proposal replaces
    the incumbent, with its value, if it is better.

    In all I + Q P episodes; with `reevaluate_incumbent` Q (I + P).

    Args:
        mode: see above.
        queries: Q, rounds.
        parallel: P, episodes a round.
        sigma: standard deviation of the perturbations, in parameter units.
        incumbent_episodes: I, runs of the unchanged policy at the start; 0 stands for P, as in the
            reference.
        reevaluate_incumbent: run the incumbent I times in each round and compare with that. Without
            it one lucky value under noise can stop the climb for good; the reference does without.

    Raises:
        Sim2RealError: for values out of range.
    """

    def __init__(
        self,
        *,
        mode: Mode,
        queries: int,
        parallel: int,
        sigma: float,
        incumbent_episodes: int = 0,
        reevaluate_incumbent: bool = False,
    ) -> None:
        if mode not in ("sequential", "average", "batch"):
            raise Sim2RealError(f"adapt.mode={mode!r} is not one of sequential, average, batch")
        if mode == "sequential" and parallel != 1:
            raise Sim2RealError(
                f"adapt.parallel={parallel} with mode=sequential: it must be 1; "
                "use mode=average or batch"
            )
        if queries < 1 or parallel < 1 or not sigma > 0 or incumbent_episodes < 0:
            raise Sim2RealError(
                f"adapt: queries={queries} and parallel={parallel} must be at least 1, "
                f"sigma={sigma} above 0, incumbent_episodes={incumbent_episodes} at least 0"
            )
        self.mode, self.rounds, self.parallel, self.sigma = mode, queries, parallel, sigma
        self.incumbent_episodes = incumbent_episodes or parallel
        self.reevaluate_incumbent = reevaluate_incumbent

    @property
    def proposals(self) -> int:
        """Different policies proposed in a round."""
        return self.parallel if self.mode == "batch" else 1

    @property
    def queries(self) -> int:
        """Perturbations that a whole climb needs."""
        return self.rounds * self.proposals

    @property
    def stages(self) -> tuple[int, ...]:
        """A stage per round: the incumbent's episodes, if any, then the proposals'."""
        first = self.incumbent_episodes + self.parallel
        later = first if self.reevaluate_incumbent else self.parallel
        return (first, *(later,) * (self.rounds - 1))

    def cohort(self, thetas: np.ndarray, noise: np.ndarray) -> Cohort:
        """Start members with given perturbations; see the base class."""
        return _Climbers(self, thetas, noise)


class _Climbers(Cohort):
    def __init__(self, operator: HillClimb, thetas: np.ndarray, noise: np.ndarray) -> None:
        super().__init__(operator.stages, thetas, noise)
        self._operator, self._sigma = operator, np.float32(operator.sigma)
        self._best = np.full(len(thetas), np.nan)  # (n,) the incumbents' values

    def candidates(self, members: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        stage = self._stage[members]
        place = episodes - self._ends[stage] - self._incumbents(stage)  # < 0: the incumbent's own
        step = self._perturbation(members, stage, np.maximum(place, 0))
        step[place < 0] = 0
        return self.results[members] + step

    def _incumbents(self, stage: np.ndarray) -> np.ndarray:
        """Episodes of the incumbent at the start of each stage."""
        every = self._operator.reevaluate_incumbent
        return np.where((stage == 0) | every, self._operator.incumbent_episodes, 0)

    def _perturbation(
        self, members: np.ndarray, stage: np.ndarray | int, place: np.ndarray
    ) -> np.ndarray:
        """Return the step from the incumbent to a proposal, (k, P)."""
        proposals = self._operator.proposals
        return self._sigma * self.noise[members, stage * proposals + place % proposals]

    def _advance(self, members: np.ndarray, stage: int) -> None:
        values = self._stage_values(members, stage)
        own = values.shape[1] - self._operator.parallel
        if own:
            self._best[members] = mean_rows(values[:, :own])
        tried = values[:, own:]  # (k, P)
        if self._operator.mode == "batch":
            winner = tried.argmax(axis=1)
            value = tried.max(axis=1)
        else:
            winner = np.zeros(len(members), np.int64)
            value = mean_rows(tried)
        better = value > self._best[members]
        members, winner = members[better], winner[better]
        self.results[members] += self._perturbation(members, stage, winner)
        self._best[members] = value[better]
