"""What happened to the requests to one servo, as counts."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass
class Counters:
    """What happened to the requests to one servo."""

    asked: int = 0
    answered: int = 0
    timeout: int = 0  # no answer in time
    corrupt: int = 0  # an answer with a wrong CRC
    short: int = 0  # an answer of another length than asked
    foreign: int = 0  # an answer that was not asked for
    stale: int = 0  # an answer from before
    alert: int = 0  # an answer with the hardware error bit
    error: int = 0  # an answer with an error number

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)
