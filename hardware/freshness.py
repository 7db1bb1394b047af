"""Whether a servo's answer is new: its millisecond counter must have gone on as the time has."""

from __future__ import annotations

ROUND = 32768  # the counter starts again after so many milliseconds
SLACK = 4.0  # ms that an answer may be older or newer than thought
DRIFT = 0.02  # of the time passed, between the servo's clock and ours
LATEST = 200.0  # ms, no answer is later


class Freshness:
    """The age of one servo's answers.

    Two odd answers that agree are believed if no lateness explains them: if they are newer than
    expected, or the servo counts from 0 again. Answers that are all late by the same time agree
    with each other as well, and are not believed.
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
        fits = self._fits(self._last, tick, time)
        anew = self._fits(self._odd, tick, time) and not self._may_be_late(tick, time)
        if fits or anew or self._last is None:
            self._last, self._odd = (tick, time), None
            return True
        self._odd = (tick, time)
        return False

    def _may_be_late(self, tick: int, time: float) -> bool:
        """Say whether an answer may be an old one, given the last that was accepted."""
        assert self._last is not None
        passed = 1000 * (time - self._last[1])
        off = _offset(self._last, tick, passed)
        started_anew = tick <= passed + SLACK + DRIFT * passed and off < -LATEST
        return off < 0 and not started_anew

    def _fits(self, known: tuple[int, float] | None, tick: int, time: float) -> bool:
        if known is None:
            return False
        passed = 1000 * (time - known[1])
        if tick == known[0] and passed < ROUND / 2:
            return False  # the same answer again
        return abs(_offset(known, tick, passed)) <= SLACK + DRIFT * passed


def _offset(known: tuple[int, float], tick: int, passed: float) -> float:
    """Return how much newer an answer is than expected after `passed` ms [ms]."""
    return (tick - known[0] - passed + ROUND / 2) % ROUND - ROUND / 2
