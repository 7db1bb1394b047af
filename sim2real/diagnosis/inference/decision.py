"""The verdict on a gap, from what the likelihood says of the best explanation.

    decide_verdict(Standing(...), settings)

One equivalence test decides what counts as explained: the discrepancy that may still be there is
free in one likelihood and at most a count of the encoder in the other; what the free one gains, in
nats a reading, has its upper bound below a tolerance at every joint, so that many sound ones hide
none. Errors of the model's parameters are free in both, and must be as small as usual. That a gain
is not significant proves nothing: a log too weak to tell passes neither for `no_gap` nor for
`explained`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.inference.score import Gain
from sim2real.diagnosis.schema import Verdict
from sim2real.diagnosis.settings.inference import Inference


class Left(NamedTuple):
    """What a discrepancy of any size gains over one of at most an encoder count.

    Contact and sticking make errors jump: the few windows in which it gains most may be left.
    """

    gain: Gain  # without these windows [nats a reading], with bounds
    worst: Gain  # the same of a joint alone, of its own readings, where all pass and that is more
    whole: float = 0.0  # upper bound with them [nats a reading]
    closes: float = 1.0  # share that the fit closes of the errors of the others that exceed noise
    usual: bool = True  # whether errors of the model's parameters that it takes are as usual

    def is_nothing(self, settings: Inference) -> bool:
        """Return whether a fit passes the test of equivalence."""
        return self.usual and self.worst.high <= settings.equivalence_tolerance


class Standing(NamedTuple):
    """How an explanation stands."""

    members: int  # how many changes it has; 0: the model as given
    left: Left
    # what it gains over each null explanation and the model as given [nats], with bounds
    over: Sequence[Gain] = ()
    inside: bool = True  # whether all values lie within the bounds of what they can physically be
    replays: bool = True  # whether whole episodes follow it at least as well as a joint that stays
    # whether no explanation as short as this does as well with quite other causes or an excluded
    # effect, and no two of its effects are at one joint of several
    alone: bool = True


def decide_verdict(standing: Standing, settings: Inference) -> Verdict:
    """Return the verdict on the best explanation."""
    equivalent, closes = standing.left.is_nothing(settings), standing.left.closes
    if not standing.members:
        return "no_gap" if equivalent else "unexplained"
    if not all(gain.low > 0 for gain in standing.over):
        return "unexplained"
    sound = standing.inside and standing.replays and standing.alone
    if equivalent and sound and closes >= settings.most:
        return "explained"
    return "partly_explained" if closes > 0 else "unexplained"


def compute_price(members: int, values: int, choices: int, settings: Inference) -> float:
    """Return what a hypothesis has to win over the model as given [nats a row].

    Each member is one of so many that were looked at, so that one of them is expected to gain the
    log of their number by chance (Bonferroni), and odds of one over the level are asked for as
    well. Each value that is free costs half the log of the evidence (Schwarz 1978,
    doi:10.1214/aos/1176344136), which is one over the temperature: rows are no independent
    evidence.
    """
    each, value = math.log(choices / settings.level), math.log(1 / settings.temperature) / 2
    return settings.temperature * (each * members + value * values)


def compute_posterior(
    scores: Sequence[float], prices: Sequence[float], left: float, settings: Inference
) -> tuple[np.ndarray, float]:
    """Return the probability of each hypothesis, (n,), and of a law that is not in the vocabulary.

    What the best hypothesis gains and what a free discrepancy still gains over it are one gap, in
    the same unit; a law that is missing has made the second, and may have made the first: its odds
    are their ratio, times prior ones. Among the hypotheses odds are exponentials of log predictive
    densities a row over a temperature, since rows are no independent evidence; each costs its
    price.

    Args:
        scores: what each hypothesis gains over the model as given [nats a row].
        prices: of each, see `compute_price` [nats a row].
        left: what a free discrepancy gains over the best [nats a row].
        settings: temperature, and prior odds of a law that is missing.
    """
    gained, left = max(scores[0], 0.0), max(left, 0.0)
    missing = settings.unlisted * left
    unknown = missing / (missing + gained) if left > 0 else 0.0
    worth = np.array(scores) - np.array(prices)
    odds = np.exp((worth - worth.max()) / settings.temperature)
    return odds / odds.sum() * (1 - unknown), unknown
