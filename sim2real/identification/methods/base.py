"""The interface of every method, and what it reports to a caller that watches or stops it.

found = method.fit(provider, prior, data)
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from envs.distribution import Distribution, Entry
from envs.marginals import Marginal
from sim2real.identification.data import Recordings
from sim2real.identification.journal import Journal
from sim2real.identification.providers.base import MakeProvider
from sim2real.identification.scores.base import Score
from sim2real.identification.searches import Evaluate
from sim2real.runs.errors import Sim2RealError

Watch = Callable[[int, int, float | None], None]  # turns done, turns in all, best number so far


@dataclass(frozen=True)
class FitContext:
    """The context of a fit: its journal's folder, its observer and its seed."""

    seed: int = 0  # all randomness follows from it
    folder: Path | None = None  # gets `journal.npz`; None keeps nothing
    resume: Path | None = None  # the folder of a run to go on from; None starts a new one
    watch: Watch = field(default=lambda done, total, best: None)  # called after each turn

    def journal(self, score: Score | None = None) -> Journal:
        """Return the fit's journal, that of the resumed run read."""
        path = None if self.folder is None else self.folder / "journal.npz"
        start = None if self.resume is None else Path(self.resume) / "journal.npz"
        return Journal(path, score, start)

    def recorded(self, evaluate: Evaluate, score: Score | None = None) -> Evaluate:
        """Return an evaluation of a search whose numbers the journal keeps, or has already."""
        journal = self.journal(score)
        return lambda points, turn: journal.evaluate(points, turn, evaluate)

    def made_by(self, method: str, **parts: object) -> dict[str, str | int]:
        """Return the provenance that a distribution records: the method and its parts' classes."""
        classes = {name: type(part).__name__ for name, part in parts.items()}
        return {"method": method, **classes, "seed": self.seed}


ONCE = FitContext()  # of a fit that keeps nothing and that nobody watches


class Method(Protocol):
    """Base class of identification methods."""

    name: str  # what `made_by` calls it
    provider: MakeProvider  # what a verb gives `fit`

    @property
    def rows(self) -> int | None:
        """The horizon of its score, see `Score`."""
        ...

    def fit(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext = ...
    ) -> Distribution:
        """Return the distribution of simulators that the data speak for.

        Args:
            provider: makes what simulates, of data and effects.
            prior: where values may be, and how wide that is.
            data: the logs.
            run: journal, seed and who watches.
        """
        ...


def refuse_kind(score: Score, aligned: bool) -> None:
    """Raise Sim2RealError for a score that cannot compare what the provider offers."""
    if score.aligned == aligned:
        return
    name = type(score).__name__
    if aligned:
        raise Sim2RealError(
            f"{name} compares transitions of rollouts, but the provider replays logs; choose "
            "identify/provider=rollout, or a score such as one_step, k_step or likelihood"
        )
    raise Sim2RealError(
        f"{name} compares row by row, but rollouts are not aligned with the logs; choose "
        "identify/provider=replay, or a score such as mmd, sliced_wasserstein or critic_gp"
    )


def gaussian(
    prior: Distribution,
    mean: np.ndarray,
    covariance: np.ndarray,
    spread: np.ndarray | None = None,
    uncertainty: np.ndarray | None = None,
) -> Distribution:
    """Return normal laws about a mean, cut off at the prior's ends.

    Args:
        prior: gives effects and ends.
        mean: (P,).
        covariance: of a draw, (P, P).
        spread: standard deviations between episodes, (P,); None where they are not known.
        uncertainty: of the mean, (P,); None where it is not known.
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(std > 0, std, 1.0)
    joint = covariance / np.outer(safe, safe)
    joint = (joint + joint.T) / 2
    np.fill_diagonal(joint, 1.0)
    mean = np.clip(mean, prior.low, prior.high)
    entries, first = [], 0
    for entry in prior.entries:
        own = slice(first, first + len(entry.laws))
        laws = tuple(
            Marginal("normal", float(m), float(s), law.low, law.high)
            for m, s, law in zip(mean[own], std[own], entry.laws, strict=True)
        )
        apart = [None if v is None else tuple(map(float, v[own])) for v in (spread, uncertainty)]
        entries.append(Entry(entry.effect, laws, *apart))
        first = own.stop
    return Distribution(tuple(entries), joint)
