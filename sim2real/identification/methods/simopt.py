"""Rounds around any method: fit, narrow the prior to what was found, simulate again there.

    method = SimOpt(Dropo(search=Cma(generations=20)), rounds=5)
    found = method.fit(replay, prior, data)

Chebotar et al., "Closing the sim-to-real loop" (SimOpt, ICRA 2019). A round's prior is a box about
the last round's mean, a factor wider than its distribution and no wider than the box before. It may
leave that box, never the prior that the first round was given; directions of which the logs say
nothing stay as wide as they were. The answer is the last round's. Each round has a journal of its
own, so that a run that was stopped goes on within the round.
"""

import logging
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from envs.distribution import Distribution, Entry
from envs.marginals import UNIFORM_WIDTH, uniform
from sim2real.diagnosis.settings import TINY
from sim2real.identification.data import Recordings
from sim2real.identification.methods.base import ONCE, FitContext, Method
from sim2real.identification.providers.base import MakeProvider
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
FILE = "rounds.csv"


class SimOpt:
    """Repeats a method on narrower priors until its answer stays where it is.

    Args:
        method: what fits in each round; its provider, score and search are its own.
        rounds: at most.
        widen: width of a round's prior, in widths of the previous round's result, compared by
            their standard deviations. The logs are counted again in each round: with 2.5 the
            uncertainty comes out too small by 8 % at most, sqrt(1 - 1 / widen^2).
        narrowest: least width of a round's prior, in widths of the first one: a population that
            collapsed is not certain.
        still: the rounds end when no mean moves by more than this, in uncertainties of the estimate
            (in standard deviations of the distribution where the method knows no uncertainty).

    Raises:
        Sim2RealError: a number out of its range.
    """

    name = "simopt"

    def __init__(
        self,
        method: Method,
        rounds: int = 5,
        widen: float = 2.5,
        narrowest: float = 0.02,
        still: float = 1.0,
    ) -> None:
        if rounds < 1 or widen < 1 or not 0 < narrowest <= 1 or not still > 0:
            raise Sim2RealError(
                f"identify: rounds={rounds} and widen={widen:g} must be at least 1, "
                f"narrowest={narrowest:g} above 0 and up to 1, still={still:g} above 0"
            )
        self.method, self.rounds, self.widen = method, rounds, widen
        self.narrowest, self.still = narrowest, still
        self.rows, self.provider = method.rows, method.provider

    def fit(
        self, provider: MakeProvider, prior: Distribution, data: Recordings, run: FitContext = ONCE
    ) -> Distribution:
        """Return the last round's distribution; see `Method`."""
        box = prior
        boxes: list[Distribution] = []
        found: list[Distribution] = []
        for number in range(self.rounds):
            boxes.append(box)
            found.append(self.method.fit(provider, box, data, self._of_round(run, number)))
            _write(run.folder, boxes, found)
            if self._is_still(found):
                break
            box = narrow_prior(prior, box, found[-1], self.widen, self.narrowest)
        made_by = run.made_by(self.name) | {"of": self.method.name, "rounds": len(found)}
        return replace(_up_to(prior, found[-1]), made_by={**found[-1].made_by, **made_by})

    def _of_round(self, run: FitContext, number: int) -> FitContext:
        """Return a round's context: its own seed, and its own folder below the run's."""
        folder = f"round_{number + 1}"
        seed = run.seed if number == 0 else _mixed(run.seed, number)
        resume = None if run.resume is None else Path(run.resume) / folder
        if number and resume is not None and not resume.is_dir():
            resume = None  # the run was stopped before
        own = None if run.folder is None else run.folder / folder

        def watch(done: int, total: int, best: float | None) -> None:
            run.watch(number * total + done, self.rounds * total, best)

        return FitContext(seed, own, resume, watch)

    def _is_still(self, found: list[Distribution]) -> bool:
        """Return whether the last round moved nothing; say so, or what still moves at the end."""
        if len(found) < 2:
            return False
        far = mean_shift(*found[-2:])
        worst = int(far.argmax())
        what = f"{found[-1].names[worst]} moved by {far[worst]:.2g} of its uncertainty"
        log_.info("round %d: %s", len(found), what)
        if far[worst] <= self.still:
            return True
        if len(found) == self.rounds:
            log_.warning(
                "after %d rounds %s: the answer has not settled; give more identify.rounds",
                self.rounds,
                what,
            )
        return False


def mean_shift(before: Distribution, after: Distribution) -> np.ndarray:
    """Return how far each mean moved, (P,), in uncertainties of the later estimate."""
    sure = after.columns("uncertainty")
    sure = np.where(np.isfinite(sure), sure, after.std)
    return np.abs(after.mean - before.mean) / np.maximum(sure, TINY)


def narrow_prior(
    prior: Distribution, box: Distribution, found: Distribution, widen: float, narrowest: float
) -> Distribution:
    """Return uniform laws about what was found, within the prior's ends.

    Args:
        prior: gives effects and ends.
        box: what the last round searched; the laws are no wider.
        found: gives means and standard deviations.
        widen: the laws' standard deviations, over those found.
        narrowest: least width, in widths of the prior.
    """
    span = prior.high - prior.low
    width = np.minimum(widen * UNIFORM_WIDTH * found.std, box.high - box.low)
    width = np.clip(width, narrowest * span, span)
    low = np.clip(found.mean - width / 2, prior.low, prior.high - width)
    high = np.minimum(low + width, prior.high)
    entries, first = [], 0
    for entry in prior.entries:
        own = slice(first, first + len(entry.laws))
        laws = tuple(uniform(float(a), float(b)) for a, b in zip(low[own], high[own], strict=True))
        entries.append(Entry(entry.effect, laws))
        first = own.stop
    return Distribution(tuple(entries))


def _up_to(prior: Distribution, found: Distribution) -> Distribution:
    """Return the estimate with the prior's limits instead of the last round's."""
    if found.particles is not None:
        return found
    entries = tuple(
        replace(
            entry,
            laws=tuple(
                replace(law, low=end.low, high=end.high)
                for law, end in zip(entry.laws, wide.laws, strict=True)
            ),
        )
        for entry, wide in zip(found.entries, prior.entries, strict=True)
    )
    return replace(found, entries=entries)


def _mixed(seed: int, number: int) -> int:
    """Return a round's own seed."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


def _write(folder: Path | None, boxes: list[Distribution], found: list[Distribution]) -> None:
    """Write a line for each round and parameter: its prior, and what was found in it."""
    if folder is None:
        return
    made = Table(["round", "parameter", "prior low", "prior high", "mean", "std", "moved"])
    ways = [None, *(mean_shift(*pair) for pair in pairwise(found))]
    for number, (box, one, way) in enumerate(zip(boxes, found, ways, strict=True), start=1):
        for row in _rows(box, one, way):
            made.add(number, *row)
    write_text(folder / FILE, made.csv())


def _rows(
    box: Distribution, found: Distribution, way: np.ndarray | None
) -> Iterator[tuple[str, float, float, float, float, float | None]]:
    for i, name in enumerate(found.names):
        law = found.laws[i]
        step = None if way is None else float(way[i])
        yield name, float(box.low[i]), float(box.high[i]), law.mean, law.std, step
