"""Nearby: from the middle of the prior, a few damped steps to where the logs are followed.

    method = Nearby(rows="auto", transitions=100)
    found = method.fit(replay, prior, data)

Gauss-Newton steps on all episodes together, held by the prior: what the logs do not tell stays
where it was. It takes far fewer simulations than a global search, so that it can be asked between
two episodes; where the prior is so wide that errors are no longer smooth in it, take
`identify=cma`.
"""

import logging
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from envs.distribution import Distribution
from sim2real.identification.data import Recordings
from sim2real.identification.local import Surroundings
from sim2real.identification.methods.base import ONCE, FitContext, gaussian
from sim2real.identification.providers.base import AlignedProvider, MakeProvider
from sim2real.identification.providers.replay import replay
from sim2real.identification.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)
AUTO, ONE = "auto", 1


class Nearby:
    """Damped Gauss-Newton steps from the prior's middle.

    Args:
        provider: what simulates, where `fit` is called by a verb; it must be aligned.
        rows: how many rows on from each measured state; None for whole windows, which need no
            velocities; "auto" for one row on where the logs hold the whole state in even rows, and
            else for whole windows.
        transitions: maximum number of states (or windows) that is compared, spread evenly.
        steps: Gauss-Newton steps at most; it ends where no step helps.
        difference: step of central differences, in widths of the prior. Where feet hit the ground,
            errors bend at every contact, and a small step tells the slope of one moment alone.
        settings: see `Settings`.

    Raises:
        Sim2RealError: numbers below 1.
    """

    name = "nearby"

    def __init__(
        self,
        provider: MakeProvider = replay,
        rows: int | Literal["auto"] | None = "auto",
        transitions: int = 100,
        steps: int = 20,
        difference: float = 0.05,
        settings: Settings = DEFAULT,
    ) -> None:
        counted = isinstance(rows, int)
        if (counted and rows < 1) or not (counted or rows in (None, AUTO)):
            raise Sim2RealError(
                f"identify: rows={rows} must be at least 1, null for whole windows, or {AUTO}"
            )
        if transitions < 1 or steps < 1 or not 0 < difference <= 0.5:
            raise Sim2RealError(
                f"identify: transitions={transitions} and steps={steps} must be at least 1, and "
                f"difference={difference:g} above 0 and at most 0.5"
            )
        self.provider, self.transitions = provider, transitions
        self.rows, self._auto = (ONE if rows == AUTO else rows), rows == AUTO
        # batches of one size, for which the simulator is made once
        self.settings = replace(
            settings, step_rows=transitions, rounds=steps, difference=difference
        )

    def fit(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext = ONCE
    ) -> Distribution:
        """Return normal laws about the point; see `Method`."""
        made: Any = self._provided(provider, prior, data, run)
        if not isinstance(made, AlignedProvider):
            raise Sim2RealError(
                "identify=nearby compares row by row, but rollouts are not aligned with the logs; "
                "choose identify/provider=replay"
            )
        few = made.subset(_spread(len(made.real), self.transitions))
        few.episode = np.zeros(len(few.real), np.int64)  # one robot: all logs together
        around = Surroundings(few, prior, self.settings)
        point, sure = around.maximum_a_posteriori()
        return replace(
            gaussian(prior, point, sure, None, np.sqrt(np.diag(sure))),
            flat=around.explore(point).named(prior.names, self.settings),
            noise=dict.fromkeys(made.names, 0.0),
            made_by=run.made_by(self.name),
            logs=data.hashes(),
        )

    def _provided(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext
    ) -> Any:
        effects, seed = prior.effects, run.seed
        if self.rows is None:
            return provider(data, effects, rows=None, seed=seed)
        if provider is not replay:
            return provider(data, effects, rows=self.rows, seed=seed)
        try:
            return replay(data, effects, rows=self.rows, seed=seed, settings=self.settings)
        except Sim2RealError as error:
            if not self._auto:
                raise
            log_.info("whole windows are compared: %s", error)
            return replay(data, effects, rows=None, seed=seed)


def _spread(count: int, most: int) -> np.ndarray:
    """Return at most `most` of `count` numbers, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
