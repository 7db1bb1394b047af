"""Settings of `diagnosis/contract`: when a fault of the policy's interface is named."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting

RESAMPLES = 10  # of each block
ODDS = 20.0  # between faults that are alternatives


@dataclass(frozen=True)
class Contract:
    """When `contract` names a fault; a misfit is a number's RMS error, relative to its spread."""

    suspect: float = setting(
        5e-3, "misfit below which numbers agree, and fits count as equally good", JUDGED
    )
    unexplained: float = setting(
        0.05, "remaining misfit above which a term is reported as unexplained", JUDGED
    )
    margin: float = setting(
        0.5, "a fault is named only if it reduces the misfit to at most this fraction", JUDGED
    )
    still: float = setting(
        0.01, "standard deviation below which a number is constant, before scaling", JUDGED
    )
    ages_max: int = setting(
        4, "largest age of an observation or action that is tried, in control steps", COST
    )
    rows_min: int = setting(
        20,
        "smallest number of rows; a log of any length counts as so many independent ones",
        JUDGED,
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
        return -self.rows_min * math.log(self.margin)

    @property
    def free_price(self) -> float:
        """Price of a change with a fitted value, in that of one without.

        The fit may be better by `alike` by chance, and is then no alternative yet: twice that.
        """
        return 1 + 2 * self.alike / self.price

    @property
    def alike(self) -> float:
        """Difference of log likelihood up to which faults are alternatives [nats]."""
        return math.log(ODDS)
