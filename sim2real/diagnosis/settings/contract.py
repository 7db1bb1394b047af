"""Settings of `diagnosis/contract`: when a fault of the policy's interface is named."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting

RESAMPLES = 10  # of each block
ODDS = 20.0  # between faults that are alternatives


@dataclass(frozen=True)
class Contract:
    """When `contract` names a fault; a misfit is a number's RMS error, relative to its spread."""

    suspect: float = setting(0.01, "1", "misfit above which faults are searched for", JUDGED)
    floor: float = setting(2e-3, "1", "misfit below which fits count as equally good", JUDGED)
    unexplained: float = setting(
        0.05, "1", "remaining misfit above which a term is reported as unexplained", JUDGED
    )
    margin: float = setting(
        0.5, "1", "a fault is named only if it reduces the misfit to at most this fraction", JUDGED
    )
    effective_rows: int = setting(
        30, "1", "number of independent rows that is assumed when faults are compared", JUDGED
    )
    free_price: float = setting(
        1.5, "1", "evidence that a fault with a fitted value needs, relative to one without", JUDGED
    )
    still: float = setting(
        0.01, "1", "standard deviation below which a number is constant, before scaling", JUDGED
    )
    ages_max: int = setting(
        4, "1", "largest age of an observation or action that is tried, in control steps", COST
    )
    rows_min: int = setting(
        20, "1", "smallest number of rows, and number of blocks of rows that are resampled", JUDGED
    )

    @property
    def left_max(self) -> float:
        """Largest misfit that may remain with a named fault."""
        return 3 * self.unexplained

    @property
    def rows_few(self) -> int:
        """Smallest number of unclipped rows in which a number is compared."""
        return self.rows_min // 5

    @property
    def draws(self) -> int:
        """Resamples that give the certainty of a fault."""
        return RESAMPLES * self.rows_min

    @property
    def price(self) -> float:
        """Gain in log likelihood that each further change must bring [nats].

        That of reducing the RMS misfit of one number by `margin`.
        """
        return -self.effective_rows * math.log(self.margin)

    @property
    def alike(self) -> float:
        """Difference of log likelihood up to which faults are alternatives [nats]."""
        return math.log(ODDS)
