"""From logs to a distribution of simulators.

outcome = identify("logs/", "arm.xml", method, prior=["coulomb_friction", "link_mass"])
outcome.found.names, outcome.found.mean, outcome.found.std
outcome.judged.coverage            # of held-out readings, by the 90 % band of draws
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from envs.distribution import Distribution
from envs.randomization import Randomization, Tasks
from sim2real.identification.data import Recordings
from sim2real.identification.held_out import HeldOutScores, score_held_out
from sim2real.identification.methods.base import ONCE, FitContext, Method
from sim2real.identification.outcome import Outcome
from sim2real.identification.prior import prior_from_candidates, prior_from_tasks
from sim2real.identification.providers.base import AlignedProvider, MakeProvider, Provider
from sim2real.identification.providers.replay import replay
from sim2real.runs.errors import Sim2RealError

JUDGING = 1  # the stream of randomness of draws on held-out recordings


def prior_of(
    candidates: str | Path | Sequence[str] | None, tasks: Tasks, data: Recordings
) -> Distribution:
    """Return the prior: of a diagnosis or of effects by name, or what a training draws.

    Raises:
        Sim2RealError: both or neither are given, or see `prior_from_candidates` and
            `prior_from_tasks`.
    """
    drawn = bool(tasks.effects)
    if candidates is None:
        return prior_from_tasks(tasks, data if drawn else None)
    if drawn:
        raise Sim2RealError(
            "candidates and params are two priors; give one of them (params=none leaves it out)"
        )
    return prior_from_candidates(candidates, data)


def identify(
    data: Recordings,
    method: Method,
    prior: Distribution | str | Path | Sequence[str] | Tasks,
    provider: MakeProvider = replay,
    run: FitContext = ONCE,
) -> Outcome:
    """Fit a distribution to logs, and judge it by those that were held out.

    Args:
        data: the logs.
        method: how.
        prior: a distribution, a diagnosis's report.json, names of effects, or a randomization.
        provider: what simulates.
        run: journal, seed and who watches.

    Raises:
        Sim2RealError: logs, priors, methods and scores that do not fit each other, before any work.
    """
    if not isinstance(prior, Distribution):
        tasks = prior if hasattr(prior, "effects") else Randomization()
        given = None if hasattr(prior, "effects") else prior
        prior = prior_of(given, tasks, data)  # type: ignore[arg-type]
    found = method.fit(provider, prior, data, run)
    made = provider(data, found.effects, rows=method.rows, seed=run.seed)
    return Outcome(prior, found, _judged(made, found, run.seed), made.neutral)


def _judged(made: Provider, found: Distribution, seed: int) -> HeldOutScores | None:
    """Return the scores on held-out recordings; None if the provider is not aligned."""
    if not isinstance(made, AlignedProvider):
        return None
    _, held = made.split()
    return score_held_out(held, found, np.random.default_rng([seed, JUDGING]))
