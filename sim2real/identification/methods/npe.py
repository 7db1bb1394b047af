"""Neural posterior estimation: a network learns from simulations which values made which readings.

    method = Npe(simulations=1000)
    found = method.fit(replay, prior, data)         # its draws are particles

What BayesSim (Ramos et al., RSS 2019) and NPDR (Muratore et al., RA-L 2022) do, by the library sbi.
Each simulation replays the logs under values drawn from the prior, with the encoders' noise added.
Its summary is the principal components of what differs from the measured readings; the logs'
own summary is that of zeros. The posterior says how well one set of values for all episodes is
known; a spread between episodes it does not say.
"""

import logging
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from envs.distribution import Distribution, Entry
from envs.marginals import Marginal
from sim2real.diagnosis.settings import TINY
from sim2real.identification.calibration import ALARM, Calibration, calibrate, write
from sim2real.identification.data import Recordings
from sim2real.identification.methods.base import ONCE, FitContext
from sim2real.identification.providers.base import AlignedProvider, MakeProvider
from sim2real.identification.providers.replay import replay
from sim2real.identification.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)
VALUES, NOISE, PILOT = 10, 11, 0  # streams of randomness; the turn that finds the components
BATCH = 100  # simulations at once
FEWEST = 50  # simulations that a network can learn from
FILE = "calibration.csv"


class Npe:
    """Learns the posterior from simulations, and checks it on more of them.

    Args:
        provider: what simulates, where `fit` is called by a verb; it must be aligned.
        simulations: that the network learns from.
        calibrations: more simulations, by which it is checked.
        draws: of the posterior, the particles of the answer.
        components: maximum number of principal components that summarize a simulation.
        epochs: of the training, at most; it stops where held-out simulations gain no more.
        settings: see `Settings`.

    Raises:
        Sim2RealError: the library is not installed, or a number out of its range.
    """

    name = "npe"
    rows = None

    def __init__(
        self,
        provider: MakeProvider = replay,
        simulations: int = 1000,
        calibrations: int = 200,
        draws: int = 1000,
        components: int = 20,
        epochs: int = 200,
        settings: Settings = DEFAULT,
    ) -> None:
        if find_spec("sbi") is None:
            raise Sim2RealError("identify=npe needs the package sbi: pip install 'sim2real[npe]'")
        if min(simulations, calibrations) < FEWEST or min(draws, components, epochs) < 1:
            raise Sim2RealError(
                f"identify: simulations={simulations} and calibrations={calibrations} must be at "
                f"least {FEWEST}, draws={draws}, components={components} and epochs={epochs} 1"
            )
        self.provider, self.settings = provider, settings
        self.simulations, self.calibrations, self.draws = simulations, calibrations, draws
        self.components, self.epochs = components, epochs

    def fit(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext = ONCE
    ) -> Distribution:
        """Return the posterior's draws; see `Method`."""
        made: Any = provider(data, prior.effects, rows=None, seed=run.seed)
        if not isinstance(made, AlignedProvider):
            raise Sim2RealError("npe summarizes replays of logs; choose identify/provider=replay")
        fitted, _ = made.split(self.settings)
        found, checked = self.found(fitted, prior, run)
        if run.folder is not None:
            write(checked, run.folder / FILE)
        least = min(checked.p)
        if least < ALARM:
            log_.warning(
                "npe: the posterior is not calibrated (ranks are uniform with p = %.2g); give more "
                "identify.simulations",
                least,
            )
        made_by = run.made_by(self.name) | {"calibration": checked.line()}
        return replace(found, made_by=made_by, logs=data.hashes())

    def found(
        self, provider: AlignedProvider, prior: Distribution, run: FitContext
    ) -> tuple[Distribution, Calibration]:
        """Return the posterior of an aligned provider's data, and how it is calibrated."""
        if prior.joint is not None or prior.particles is not None:
            raise Sim2RealError(
                "npe needs independent parameters, but this prior has correlations; give "
                "candidates=, or "
                "params=NAME of a randomization"
            )
        shares, summaries, real = self._simulated(provider, prior, run)
        _warn_outside(summaries[: self.simulations], real)
        posterior = _learned(
            shares[: self.simulations], summaries[: self.simulations], self.epochs, run.seed
        )
        rest = slice(self.simulations, None)
        checked = calibrate(posterior.ranker, shares[rest], summaries[rest], prior.names)
        found = particles(prior, _values(prior, posterior.draws(real, self.draws)))
        left = provider.errors(found.mean[None])[0]
        rest_rms = np.sqrt(np.nanmean(left**2, axis=(0, 1))) * provider.scale
        noise = dict(zip(provider.names, map(float, rest_rms), strict=True))
        return replace(found, noise=noise), checked

    def _simulated(
        self, provider: AlignedProvider, prior: Distribution, run: FitContext
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return places in the prior (n, P), their summaries (n, K) and that of the logs (K,)."""
        count = self.simulations + self.calibrations
        shares = np.random.default_rng([run.seed, VALUES]).random((count, len(prior.names)))
        journal = run.journal()

        def plain(points: np.ndarray, turn: int) -> np.ndarray:
            return provider.errors(_values(prior, points))  # (n, W, T, M)

        def pilot(points: np.ndarray, turn: int) -> np.ndarray:
            noise = float(np.sqrt(np.mean(provider.floor**2)))
            return _components(_flat(plain(points, turn)), self.components, noise)

        def summed(points: np.ndarray, turn: int) -> np.ndarray:
            rng = np.random.default_rng([run.seed, NOISE, turn])
            error = plain(points, turn)
            error = error + provider.floor * rng.standard_normal(error.shape)
            return (_flat(error) - basis[0]) @ basis[1:].T

        basis = journal.evaluate(shares[:BATCH], PILOT, pilot)  # (K + 1, D), the mean first
        found = []
        starts = range(0, count, BATCH)
        for turn, start in enumerate(starts, start=1):
            found.append(journal.evaluate(shares[start : start + BATCH], turn, summed))
            run.watch(turn, len(starts), None)
        return shares, np.concatenate(found), -basis[0] @ basis[1:].T


class NullTracker:
    """A logger for sbi's training; its default writes a folder below the current one."""

    log_dir = None

    def log_metric(self, name: str, value: float, step: int | None = None) -> None:
        """Keep nothing."""

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        """Keep nothing."""

    def log_params(self, params: dict[str, Any]) -> None:
        """Keep nothing."""

    def add_figure(self, name: str, figure: Any, step: int | None = None) -> None:
        """Keep nothing."""

    def flush(self) -> None:
        """Keep nothing."""


class TrainedPosterior(NamedTuple):
    """A posterior that was learned."""

    draws: Callable[[np.ndarray, int], np.ndarray]  # summary (K,), n -> places in the prior (n, P)
    ranker: Callable[[np.ndarray, np.ndarray, int], np.ndarray]  # see `calibrate`


def _learned(shares: np.ndarray, summaries: np.ndarray, epochs: int, seed: int) -> TrainedPosterior:
    """Train a masked autoregressive flow on simulations; torch's generator stays as it is."""
    import torch
    from sbi.diagnostics import run_sbc
    from sbi.inference import NPE
    from sbi.neural_nets import posterior_nn
    from sbi.utils import BoxUniform

    count = shares.shape[1]

    def tensor(values: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(np.atleast_2d(values), dtype=torch.float32)

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        box = BoxUniform(torch.zeros(count), torch.ones(count))
        # in logits a flow has no way out of the box, and no draw is thrown away
        net = posterior_nn("zuko_maf", z_score_theta="transform_to_unconstrained", x_dist=box)
        inference = NPE(
            prior=box, density_estimator=net, tracker=NullTracker(), show_progress_bars=False
        )
        inference.append_simulations(tensor(shares), tensor(summaries))
        inference.train(max_num_epochs=epochs)
        posterior: Any = inference.build_posterior()

    def draws(summary: np.ndarray, number: int) -> np.ndarray:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            found = posterior.sample((number,), x=tensor(summary), show_progress_bars=False)
        return found.double().numpy()

    def ranks(truth: np.ndarray, seen: np.ndarray, number: int) -> np.ndarray:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            found, _ = run_sbc(
                tensor(truth),
                tensor(seen),
                posterior,
                num_posterior_samples=number,
                show_progress_bar=False,
            )
        return found.numpy()

    return TrainedPosterior(draws, ranks)


def particles(prior: Distribution, values: np.ndarray) -> Distribution:
    """Return draws (n, P) as a distribution; their deviations are the uncertainties."""
    entries, first = [], 0
    for entry in prior.entries:
        own = values[:, first : first + len(entry.laws)]
        first += len(entry.laws)
        laws = tuple(
            Marginal("particles", float(c.mean()), float(c.std()), float(c.min()), float(c.max()))
            for c in own.T
        )
        entries.append(Entry(entry.effect, laws, None, tuple(law.std for law in laws)))
    return Distribution(tuple(entries), particles=values)


def _values(prior: Distribution, shares: np.ndarray) -> np.ndarray:
    """Return the prior's quantiles (n, P) at shares (n, P)."""
    return np.column_stack([law.values(shares[:, i]) for i, law in enumerate(prior.laws)])


def _flat(error: np.ndarray) -> np.ndarray:
    """Return errors (n, W, T, M) as (n, D); nothing is compared where they are 0."""
    return np.nan_to_num(error, nan=0.0).reshape(len(error), -1)


def _components(readings: np.ndarray, most: int, noise: float) -> np.ndarray:
    """Return the mean of readings (n, D) and their first principal components, (K + 1, D).

    Those that vary less than a reading's noise are left out: a network would learn from noise.
    """
    mean = readings.mean(axis=0)
    _, sizes, found = np.linalg.svd(readings - mean, full_matrices=False)
    least = max(noise * np.sqrt(len(readings)), TINY * sizes[0])
    count = max(min(most, int((sizes > least).sum())), 1)
    return np.concatenate([mean[None], found[:count]])


def _warn_outside(summaries: np.ndarray, real: np.ndarray) -> None:
    """Warn where the logs are unlike every simulation: a network says nothing of use there."""
    wide = summaries.max(axis=0) - summaries.min(axis=0)
    out = (real < summaries.min(axis=0) - wide) | (real > summaries.max(axis=0) + wide)
    if out.any():
        log_.warning(
            "npe: the logs lie outside what simulations under the prior show (%d of %d components)"
            "; the posterior is a guess there: widen the prior, or use identify=cma",
            int(out.sum()),
            len(real),
        )
