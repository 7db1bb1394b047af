"""Hill climbing: try a perturbed policy and keep it if its return is higher (Song et al. 2020)."""

from typing import Literal

import numpy as np

from sim2real.learning.adapt.base import Adaptation, BatchedSession, check_budget
from sim2real.learning.adapt.gradient import mean_rows
from sim2real.runs.errors import Sim2RealError

Mode = Literal["sequential", "average", "batch"]


class HillClimb(Adaptation):
    """Hill climbing in Q rounds of proposals around the best policy so far, the incumbent.

    The incumbent first runs I episodes; their mean is its value. Each round costs P episodes:
    *sequential* (P = 1) proposes one policy and runs it once; *average* proposes one and takes its
    mean over P episodes; *batch* proposes P, runs each once and takes the best. A proposal replaces
    the incumbent, with its value, if it is better.

    The climb takes I + Q P episodes; with `reevaluate_incumbent`, Q (I + P).

    The step size may change between rounds. With `grow` and `shrink` equal and below 1, it is
    annealed. With 1.5 and 1.5^(-1/4), it follows the 1/5 rule of the (1+1) evolution strategy,
    which keeps the size if one proposal in five is better (Rechenberg 1973; factors: Auger 2009).

    Args:
        mode: see above.
        queries: Q, number of rounds.
        parallel: P, episodes per round.
        sigma: standard deviation of the parameter perturbations.
        incumbent_episodes: I, episodes of the unchanged policy at the start; 0: P, as in the
            reference.
        reevaluate_incumbent: run the incumbent I times in each round, and compare with their mean.
            If false, as in the reference, a single lucky value can end all progress.
        grow: factor on sigma after a round with a better proposal.
        shrink: factor on sigma after any other round.
        budget: required total number of episodes; None: the number that follows from the rest.

    Raises:
        Sim2RealError: a value is out of range, or the budget does not match.
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
        grow: float = 1.0,
        shrink: float = 1.0,
        budget: int | None = None,
    ) -> None:
        if mode not in ("sequential", "average", "batch"):
            raise Sim2RealError(f"adapt.mode={mode!r} is not one of sequential, average, batch")
        if mode == "sequential" and parallel != 1:
            raise Sim2RealError(
                f"adapt.parallel={parallel} must be 1 with mode=sequential; use mode=average or "
                f"batch"
            )
        if queries < 1 or parallel < 1 or not sigma > 0 or incumbent_episodes < 0:
            raise Sim2RealError(
                f"adapt: queries={queries} and parallel={parallel} must be at least 1, "
                f"sigma={sigma} above 0, incumbent_episodes={incumbent_episodes} at least 0"
            )
        if not grow > 0 or not shrink > 0:
            raise Sim2RealError(f"adapt: grow={grow} and shrink={shrink} must be above 0")
        self.mode, self.rounds, self.parallel, self.sigma = mode, queries, parallel, sigma
        self.incumbent_episodes = incumbent_episodes or parallel
        self.reevaluate_incumbent = reevaluate_incumbent
        self.grow, self.shrink = grow, shrink
        check_budget(self, budget, self._fitting(budget or 0))

    def _fitting(self, budget: int) -> str:
        """Say how many rounds come nearest to a budget from below."""
        own, each = self.incumbent_episodes, self.parallel
        again = self.reevaluate_incumbent
        rounds = max(1, budget // (own + each) if again else (budget - own) // each)
        spent = rounds * (own + each) if again else own + rounds * each
        return f"queries={rounds} spends {spent}"

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        own = f"{self.incumbent_episodes} of the policy so far" + (
            " in each round" if self.reevaluate_incumbent else " first"
        )
        return (
            f"{self.mode} hill climbing, {self.episodes} episodes: {own}, "
            f"{self.rounds} rounds of {self.parallel}"
        )

    @property
    def proposals(self) -> int:
        """Number of different policies proposed in a round."""
        return self.parallel if self.mode == "batch" else 1

    @property
    def queries(self) -> int:
        """Number of perturbations of a whole climb."""
        return self.rounds * self.proposals

    @property
    def stages(self) -> tuple[int, ...]:
        """Stages, one per round: episodes of the incumbent, if any, then of the proposals."""
        first = self.incumbent_episodes + self.parallel
        later = first if self.reevaluate_incumbent else self.parallel
        return (first, *(later,) * (self.rounds - 1))

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> BatchedSession:
        """Start members with given perturbations; see the base class."""
        return _Climbers(self, thetas, noise)


class _Climbers(BatchedSession):
    def __init__(self, operator: HillClimb, thetas: np.ndarray, noise: np.ndarray) -> None:
        super().__init__(operator.stages, thetas, noise)
        self._operator = operator
        self._sigma = np.full(
            (len(thetas), 1), operator.sigma, np.float32
        )  # of each member's steps
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
        return self._sigma[members] * self.noise[members, stage * proposals + place % proposals]

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
        won = members[better]
        self.results[won] += self._perturbation(won, stage, winner[better])
        self._best[won] = value[better]
        factors = np.where(better, self._operator.grow, self._operator.shrink)
        self._sigma[members] *= factors[:, None].astype(np.float32)
