"""Settings of `diagnosis/contract`: when a fault of the policy's interface is named."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting


@dataclass(frozen=True)
class Contract:
    """When a rebuilt number differs from the logged one, and which explanation is named."""

    suspect: float = setting(
        0.01, "1", "misfit that is examined (RMS, relative to the spread)", JUDGED
    )
    unexplained: float = setting(0.05, "1", "misfit that is reported even if unexplained", JUDGED)
    margin: float = setting(
        0.5,
        "1",
        "largest misfit with a named fault, relative to that without",
        JUDGED,
    )
    left_max: float = setting(
        0.15, "1", "largest misfit with a named fault, relative to the spread", JUDGED
    )
    floor: float = setting(
        2e-3, "1", "largest difference of equal misfits, relative to the spread", JUDGED
    )
    effective_rows: int = setting(
        30,
        "1",
        "number of independent rows that a log counts as, in the choice between faults",
        JUDGED,
    )
    free_price: float = setting(
        1.5, "1", "price of a change with a fitted value, relative to one without", JUDGED
    )
    alike: float = setting(
        3.0, "nat", "difference up to which explanations are listed together", "derived: odds of 20"
    )
    set_max: int = setting(3, "1", "maximum number of listed equivalents", JUDGED)
    still: float = setting(
        0.01, "1", "minimum spread of a number that moves, before scaling", JUDGED
    )
    ages_max: int = setting(4, "1", "largest age of an observation or action tried, in steps", COST)
    ways_few: int = setting(
        4, "1", "number of alternatives of a term up to which each is tried at every age", COST
    )
    filters: tuple[float, ...] = setting(
        (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9), "1", "smoothing factors tried", COST
    )
    rows_min: int = setting(20, "1", "rows needed for an answer", JUDGED)
    rows_few: int = setting(4, "1", "minimum number of unclipped rows of a number", JUDGED)
    draws: int = setting(200, "1", "resamples for the certainty of a fault", COST)
    blocks: int = setting(20, "1", "blocks of rows in the bootstrap", JUDGED)

    @property
    def price(self) -> float:
        """Gain in log likelihood that each further change must bring [nats].

        That of halving the RMS misfit of one number.
        """
        return self.effective_rows * math.log(2)
