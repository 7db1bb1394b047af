"""DROPO: the Gaussian over parameters under which the logged transitions are likely.

    method = Dropo(search=Cma(), rows=1)
    found = method.fit(replay, prior, data)

Tiboni, Arndt and Kyrki, Robotics and Autonomous Systems 166, 2023 (arXiv:2201.08434). Each
transition is simulated under samples of the Gaussian; their mean and covariance, plus `noise`,
give the likelihood of what was measured. The Gaussian's means and standard deviations are searched
for; it is the spread of the robot, all else that differs included. How well it is known is not
said.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from envs.distribution import Distribution
from sim2real.identification.data import Recordings
from sim2real.identification.methods.base import ONCE, FitContext, gaussian
from sim2real.identification.providers.base import AlignedProvider, MakeProvider
from sim2real.identification.providers.replay import replay
from sim2real.identification.searches import Box, Search
from sim2real.identification.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

SAMPLES, CHOICE = 2, 3  # streams of randomness: of the Gaussian's samples, of transitions
HALF = 0.5


class Dropo:
    """Maximizes the likelihood of transitions under a diagonal Gaussian.

    Args:
        search: how means and standard deviations are searched for.
        provider: what simulates, where `fit` is called by a verb; it must be aligned.
        rows: how many rows on a transition goes (the paper's lambda, 1 to 5).
        samples: of the Gaussian, for each transition.
        noise: standard deviation added to every reading, in its change in a row (the paper's
            epsilon).
        transitions: maximum number that is compared, drawn at random.
        narrowest: least standard deviation that is looked for, in widths of the prior.
        widest: largest.
        settings: see `Settings`.

    Raises:
        Sim2RealError: a number out of its range.
    """

    name = "dropo"

    def __init__(
        self,
        search: Search,
        provider: MakeProvider = replay,
        rows: int = 1,
        samples: int = 100,
        noise: float = 0.01,
        transitions: int = 500,
        narrowest: float = 0.001,
        widest: float = 0.5,
        settings: Settings = DEFAULT,
    ) -> None:
        if rows < 1 or samples < 3 or not noise > 0 or transitions < 1:
            raise Sim2RealError(
                f"identify: rows={rows} and transitions={transitions} must be at least 1, "
                f"samples={samples} at least 3 and noise={noise:g} above 0"
            )
        if not 0 < narrowest < widest:
            raise Sim2RealError(
                f"identify: narrowest={narrowest:g} must be above 0 and below widest={widest:g}"
            )
        self.search, self.provider, self.rows, self.settings = search, provider, rows, settings
        self.samples, self.noise, self.transitions = samples, noise, transitions
        self.narrowest, self.widest = narrowest, widest

    def fit(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext = ONCE
    ) -> Distribution:
        """Return the distribution; see `Method`."""
        made: Any = provider(data, prior.effects, rows=self.rows, seed=run.seed)
        if not isinstance(made, AlignedProvider):
            raise Sim2RealError("dropo compares row by row; choose identify/provider=replay")
        fitted, _ = made.split(self.settings)
        found = self.found(fitted, prior, run)
        made_by = run.made_by(self.name, search=self.search) | {"rows": self.rows}
        return replace(found, made_by=made_by, logs=data.hashes())

    def found(
        self, provider: AlignedProvider, prior: Distribution, run: FitContext
    ) -> Distribution:
        """Return the Gaussian under which an aligned provider's data are likely."""
        provider, count = self._few(provider, run.seed), len(prior.names)
        width = prior.high - prior.low
        ends = np.log(width * self.narrowest), np.log(width * self.widest)
        box = Box(
            np.concatenate([prior.low, ends[0]]),
            np.concatenate([prior.high, ends[1]]),
            np.concatenate([prior.mean, np.mean(ends, axis=0)]),
            (*prior.names, *(f"log std of {name}" for name in prior.names)),
        )
        # the same normal numbers for every Gaussian: the likelihood is then smooth in it
        normal = np.random.default_rng([run.seed, SAMPLES]).standard_normal((self.samples, count))

        def evaluate(points: np.ndarray, turn: int) -> np.ndarray:
            return np.array([self._surprise(provider, prior, point, normal) for point in points])

        best = self.search.minimize(run.recorded(evaluate), box, run.seed, run.watch).best
        mean, std = best[:count], np.exp(best[count:])
        noise = self.noise * provider.scale
        found = gaussian(prior, mean, np.diag(std**2), std)
        return replace(found, noise=dict(zip(provider.names, map(float, noise), strict=True)))

    def _few(self, provider: AlignedProvider, seed: int) -> AlignedProvider:
        """Return the provider with at most `transitions` transitions."""
        count = len(provider.chosen)
        if count <= self.transitions:
            return provider
        rng = np.random.default_rng([seed, CHOICE])
        return provider.subset(np.sort(rng.choice(count, self.transitions, replace=False)))

    def _surprise(
        self, provider: AlignedProvider, prior: Distribution, point: np.ndarray, normal: np.ndarray
    ) -> float:
        """Return the mean negative log-likelihood of a transition under a Gaussian (2 P,)."""
        count = normal.shape[1]
        values = point[:count] + np.exp(point[count:]) * normal
        error = provider.errors(np.clip(values, prior.low, prior.high))[:, :, -1]  # (K, W, M)
        size = error.shape[2]
        mean = error.mean(axis=0)  # (W, M)
        apart = error - mean
        cover = np.einsum("kwm,kwn->wmn", apart, apart) / (len(error) - 1)
        cover += self.noise**2 * np.eye(size)
        _, volume = np.linalg.slogdet(cover)  # (W,)
        pull = np.linalg.solve(cover, mean[..., None])[..., 0]
        surprise = HALF * ((mean * pull).sum(axis=1) + volume + size * math.log(2 * math.pi))
        return float(surprise.mean())
