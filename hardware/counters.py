"""Counters of the requests to one servo and of their answers."""

from dataclasses import asdict, dataclass


@dataclass
class Counters:
    """Counters of the requests to one servo and of their answers."""

    asked: int = 0
    answered: int = 0
    timeout: int = 0  # no good answer in time
    late: int = 0  # an answer that the wire explains earlier, see `bus_client.LATE`
    corrupt: int = 0  # an answer with a wrong CRC
    short: int = 0  # an answer of another length than asked
    foreign: int = 0  # an answer that was not asked for
    stale: int = 0  # an answer from before
    alert: int = 0  # an answer with the hardware error bit
    error: int = 0  # an answer with an error number

    @property
    def lost(self) -> int:
        """Answers that did not come in time, or came damaged."""
        return self.timeout

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)
