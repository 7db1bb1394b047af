"""Whether a servo's answer is new: its millisecond counter must have gone on as the time has.

    age = Freshness()
    age.accept(tick=1000, asked=1.000, received=1.002)      # True: the first is believed
    age.accept(tick=1020, asked=1.020, received=1.031)      # True, though it took long
    age.accept(tick=1020, asked=1.040, received=1.042)      # False: the same answer again

What was measured for an answer was measured between asking and receiving. So each answer says in
which window of our time the servo counted `tick`; a new answer's window must meet the one that the
last answer foretells. Slow answers have wide windows, and quick ones narrow what is known, so that
a busy machine costs no good answer, and an answer to an earlier question is still found out.
"""

from typing import NamedTuple

ROUND = 32768  # ms after which the counter starts again
SLACK = 2.0  # ms: the counter's resolution, and how old a servo's registers may be
DRIFT = 0.02  # of the time passed, between the servo's clock and ours
LATEST = 200.0  # ms, no answer is later


class _Known(NamedTuple):
    """A count and the window of our time in which the servo counted it [ms]."""

    tick: int
    low: float
    high: float

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2


class Freshness:
    """The age of one servo's answers.

    Two odd answers that agree are believed if no lateness explains them: if they are newer than
    expected, or the servo counts from 0 again. Answers that are all late by the same time agree
    with each other as well, and are not believed.
    """

    def __init__(self) -> None:
        self._last: _Known | None = None
        self._odd: _Known | None = None

    @property
    def known(self) -> bool:
        """Whether an answer was accepted before."""
        return self._last is not None

    def accept(self, tick: int, asked: float, received: float) -> bool:
        """Say whether an answer is new, and remember it if so.

        Args:
            tick: the servo's counter [ms], 0 to 32767.
            asked: when the answer was asked for [s].
            received: when it had come [s].
        """
        answer = _Known(tick, 1000 * asked, 1000 * received)
        fits = _narrowed(self._last, answer)
        agrees = _narrowed(self._odd, answer)
        if fits is None and agrees is not None and not self._may_be_late(answer):
            fits = agrees
        if fits is not None or self._last is None:
            self._last, self._odd = fits or answer, None
            return True
        self._odd = answer
        return False

    def _may_be_late(self, answer: _Known) -> bool:
        """Say whether an answer may be an old one, given the last that was accepted."""
        assert self._last is not None
        passed = answer.high - self._last.low
        off = _offset(self._last, answer)
        started_anew = answer.tick <= passed * (1 + DRIFT) + SLACK and off < -LATEST
        return off < 0 and not started_anew


def _narrowed(known: _Known | None, answer: _Known) -> _Known | None:
    """Return the answer with the window that both allow; None if there is none."""
    if known is None:
        return None
    passed = answer.middle - known.middle
    if answer.tick == known.tick and passed < ROUND / 2:
        return None  # the same answer again
    counted = passed + _offset(known, answer)
    slack = SLACK + DRIFT * abs(passed)
    low = max(answer.low, known.low + counted - slack)
    high = min(answer.high, known.high + counted + slack)
    return _Known(answer.tick, low, high) if low <= high else None


def _offset(known: _Known, answer: _Known) -> float:
    """Return how much newer an answer is than expected [ms]."""
    passed = answer.middle - known.middle
    return (answer.tick - known.tick - passed + ROUND / 2) % ROUND - ROUND / 2
