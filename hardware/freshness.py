"""Whether a servo's answer is new: its millisecond counter must have gone on as the time has."""

from __future__ import annotations

ROUND = 32768  # the counter starts again after so many milliseconds
SLACK = 4.0  # ms that an answer may be older or newer than thought
DRIFT = 0.02  # of the time passed, between the servo's clock and ours


class Freshness:
    """The age of one servo's answers.

    A servo that started anew counts from 0 again: two odd answers that agree are believed.
    """

    def __init__(self) -> None:
        self._last: tuple[int, float] | None = None
        self._odd: tuple[int, float] | None = None

    @property
    def known(self) -> bool:
        """Whether an answer was accepted before."""
        return self._last is not None

    def accept(self, tick: int, time: float) -> bool:
        """Say whether an answer is new, and remember it if so.

        Args:
            tick: the servo's counter [ms], 0 to 32767.
            time: when the answer was asked for [s].
        """
        fits = self._fits(self._last, tick, time) or self._fits(self._odd, tick, time)
        if fits or self._last is None:
            self._last, self._odd = (tick, time), None
            return True
        self._odd = (tick, time)
        return False

    def _fits(self, known: tuple[int, float] | None, tick: int, time: float) -> bool:
        if known is None:
            return False
        passed = 1000 * (time - known[1])
        if tick == known[0] and passed < ROUND / 2:
            return False  # the same answer again
        off = (tick - known[0] - passed + ROUND / 2) % ROUND - ROUND / 2
        return abs(off) <= SLACK + DRIFT * passed
