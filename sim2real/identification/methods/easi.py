"""EASI: simulators move to where a critic cannot tell their rollouts from the robot's.

    method = Easi(score=Critic("gp"), search=EasiEs(), provider=rollout)
    found = method.fit(rollout, prior, data)

Dong et al., "EASI: Evolutionary Adversarial Simulator Identification" (2024). Any score of
transitions takes the critic's place, and any search the strategy's. The distribution is the last
generation's: a population that follows the data, no posterior.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from envs.distribution import Distribution
from sim2real.identification.data import Recordings
from sim2real.identification.methods.base import ONCE, FitContext, gaussian, refuse_kind
from sim2real.identification.providers.base import MakeProvider
from sim2real.identification.providers.rollout import Rollout, rollout
from sim2real.identification.scores.base import Score
from sim2real.identification.searches import Search


class Easi:
    """Matches the transitions of rollouts.

    Args:
        score: of transitions: `Critic`, `Mmd` or `SlicedWasserstein`.
        search: how values are moved.
        provider: what simulates, where `fit` is called by a verb.

    Raises:
        Sim2RealError: a score that compares row by row.
    """

    name = "easi"
    rows = None

    def __init__(self, score: Score, search: Search, provider: MakeProvider = rollout) -> None:
        refuse_kind(score, aligned=False)
        self.score, self.search, self.provider = score, search, provider

    def fit(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext = ONCE
    ) -> Distribution:
        """Return the distribution; see `Method`."""
        made: Any = provider(data, prior.effects, rows=None, seed=run.seed)
        refuse_kind(self.score, made.aligned)
        found = self.found(made, prior, run)
        made_by = run.made_by(self.name, score=self.score, search=self.search)
        return replace(found, made_by=made_by, logs=data.hashes())

    def found(self, provider: Rollout, prior: Distribution, run: FitContext) -> Distribution:
        """Return the last generation's distribution."""
        self.score.begin(provider.observation_size, run.seed)

        def evaluate(points: np.ndarray, turn: int) -> np.ndarray:
            return self.score(provider.real, provider.simulate(points, turn), turn)

        recorded = run.recorded(evaluate, self.score)
        last = self.search.minimize(recorded, prior, run.seed, run.watch)
        return gaussian(prior, last.mean, np.diag(last.std**2))
