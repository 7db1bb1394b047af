"""Trajectory matching: the values under which simulations follow the logs best.

    method = Matching(score=KStep(rows=None), search=Cma())
    found = method.fit(replay, prior, data)

What DROID (Tsai et al., RA-L 2021) and PACE do by CMA-ES, and then, from the point that the search
found: each episode is fitted by itself along the directions that the logs know, the scatter of
those fits is split into the robot's own spread and their uncertainty, and directions that the logs
say nothing of keep the width of the prior.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t as student

from envs.distribution import Distribution
from envs.distribution_file import NINETY
from sim2real.diagnosis.settings import TINY_SQUARE
from sim2real.identification.data import Recordings
from sim2real.identification.held_out import inflate_noise
from sim2real.identification.local import LocalSensitivity, Surroundings
from sim2real.identification.methods.base import ONCE, FitContext, gaussian, refuse_kind
from sim2real.identification.providers.base import AlignedProvider, MakeProvider
from sim2real.identification.providers.replay import replay
from sim2real.identification.random_effects import (
    VarianceComponents,
    random_effects,
    shrink_correlations,
)
from sim2real.identification.scores.base import Score
from sim2real.identification.searches import Search
from sim2real.identification.settings import DEFAULT, Settings

WIDENING = 2  # the stream of randomness of the noise that draws lack
UPPER = 0.95  # the quantile at the upper end of a 90 % interval


class Estimates(NamedTuple):
    """Episodes' estimates along K directions."""

    shifts: np.ndarray  # (E, K)
    covariances: np.ndarray  # (E, K, K) how well each is known
    split: VarianceComponents  # of their scatter
    shared: np.ndarray  # (K, K) covariance of what may be wrong in all of them alike


class Matching:
    """Matches trajectories or transitions, then splits spread and uncertainty.

    Args:
        score: what is minimized: `KStep`, `OneStep` or `Likelihood`.
        search: how.
        provider: what simulates, where `fit` is called by a verb.
        settings: see `Settings`.

    Raises:
        Sim2RealError: a score that is not aligned.
    """

    name = "matching"

    def __init__(
        self,
        score: Score,
        search: Search,
        provider: MakeProvider = replay,
        settings: Settings = DEFAULT,
    ) -> None:
        refuse_kind(score, aligned=True)
        self.score, self.search, self.provider = score, search, provider
        self.rows, self.settings = score.rows, settings

    def fit(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext = ONCE
    ) -> Distribution:
        """Return the distribution; see `Method`."""
        made: Any = provider(data, prior.effects, rows=self.score.rows, seed=run.seed)
        refuse_kind(self.score, made.aligned)
        fitted, _ = made.split(self.settings)
        found = self.found(fitted, prior, run)
        made_by = run.made_by(self.name, score=self.score, search=self.search)
        return replace(found, made_by=made_by, logs=data.hashes())

    def found(
        self, provider: AlignedProvider, prior: Distribution, run: FitContext
    ) -> Distribution:
        """Return the distribution that an aligned provider's data speak for."""

        def evaluate(points: np.ndarray, turn: int) -> np.ndarray:
            return self.score(provider.real, provider.simulate(points, turn), turn)

        best = self.search.minimize(run.recorded(evaluate), prior, run.seed, run.watch).best
        around = Surroundings(provider, prior, self.settings)
        local = around.explore(best)
        shifts, covariances, left = around.fit_per_episode(local)
        split = random_effects(shifts, covariances, self.settings)
        shared, rest = around.model_discrepancy(local, left)
        found = _spelled(prior, local, Estimates(shifts, covariances, split, shared))
        noise = rest * provider.scale
        found = replace(
            found,
            flat=local.named(prior.names, self.settings),
            noise=dict(zip(provider.names, map(float, noise), strict=True)),
        )
        rng = np.random.default_rng([run.seed, WIDENING])
        return inflate_noise(provider, found, rng, self.settings)


def _spelled(prior: Distribution, local: LocalSensitivity, estimates: Estimates) -> Distribution:
    """Return laws of the parameters from what is known along directions.

    Draws are robots that were not seen yet. Few episodes tell badly how much robots differ, and
    worse which of their parameters go together: draws are as wide as Student's law asks for, and
    correlations smaller than those of the episodes.
    """
    turn = local.known * local.scale[:, None]  # (P, K)
    rest = local.flat * local.scale[:, None]  # (P, F)
    split, several = estimates.split, len(estimates.shifts) > 1
    count = len(estimates.shifts)
    spread, sure = turn @ split.spread @ turn.T, turn @ split.uncertainty @ turn.T
    draws = spread
    if several:
        factor = _few_episodes(estimates, turn)
        sure = sure * np.outer(factor, factor)
        draws = shrink_correlations(spread, count) * (student.ppf(UPPER, count - 1) / NINETY) ** 2
    sure = sure + turn @ estimates.shared @ turn.T
    unknown = rest @ rest.T
    return gaussian(
        prior,
        local.values(split.mean),
        draws + sure + unknown,
        np.sqrt(np.maximum(np.diag(spread), 0.0)) if several else None,
        np.sqrt(np.maximum(np.diag(sure + unknown), 0.0)),
    )


def _few_episodes(estimates: Estimates, turn: np.ndarray) -> np.ndarray:
    """Return by what the parameters' uncertainties (P,) grow as few episodes tell the spread badly.

    Student's quantile and the scatter that is really there, of the method of Knapp and Hartung
    (Statistics in Medicine 22, 2003); never less than the normal law's.
    """
    split, count = estimates.split, len(estimates.shifts)
    apart = (estimates.shifts - split.mean) @ turn.T  # (E, P)
    both = np.einsum("pk,ekl,pl->ep", turn, estimates.covariances + split.spread, turn)
    scatter = (apart**2 / np.maximum(both, TINY_SQUARE)).sum(axis=0) / (count - 1)
    return np.maximum(student.ppf(UPPER, count - 1) * np.sqrt(scatter) / NINETY, 1.0)
