"""Old and doubled answers do not fit the time; a servo that starts anew is believed again."""

import numpy as np
import pytest

from hardware.freshness import Freshness

REPLY = 0.001  # s that a quick answer takes


def take(age: Freshness, tick: int, asked: float, reply: float = REPLY) -> bool:
    """Hand over an answer that took `reply` seconds."""
    return age.accept(tick, asked, asked + reply)


def test_regular_answers_are_new_through_the_wrap():
    """Answers at any pace are new while counter and time agree, also across 32768."""
    rng = np.random.default_rng(0)
    age, asked = Freshness(), 30.0
    assert not age.known
    for _ in range(5000):
        sampled = asked + rng.uniform(0, REPLY)
        assert take(age, int(1000 * sampled * 1.005) % 32768, asked)
        asked += rng.uniform(0.004, 0.5)
    assert age.known


def test_slow_answers_are_new_on_a_busy_machine():
    """Answers that take up to 60 ms, sampled anywhere in between, are all believed."""
    rng = np.random.default_rng(1)
    age, asked = Freshness(), 1.0
    for _ in range(5000):
        reply = min(REPLY + rng.exponential(0.005), 0.06)
        sampled = asked + rng.uniform(REPLY / 2, reply - REPLY / 2)
        assert take(age, int(1000 * sampled) % 32768, asked, reply)
        asked += max(0.01, reply)


def test_an_answer_to_the_question_before_is_old_however_slow_some_were():
    """At 100 questions a second, an answer from the step before is never taken for a new one."""
    rng = np.random.default_rng(2)
    age, asked = Freshness(), 1.0
    for k in range(2000):
        reply = 0.03 if k % 50 == 7 else 0.0015
        if k % 10 == 9:
            assert not take(age, int(1000 * (asked - 0.01)) % 32768, asked)
        assert take(age, int(1000 * (asked + rng.uniform(0, reply))) % 32768, asked, reply)
        asked += 0.04


ANSWERS = {  # the counter, when it was asked for, and whether it is taken
    "doubled and late": [  # the same again, or one from 6 ms before, is not new
        *[(1000, 1.0, True), (1000, 1.02, False), (1000, 1.001, False)],
        *[(1040, 1.04, True), (1054, 1.06, False), (1080, 1.08, True)],
    ],
    "started anew": [  # the first after a reboot is doubted, the next that agrees with it taken
        *[(20000, 20.0, True), (120, 20.3, False), (140, 20.32, True), (160, 20.34, True)]
    ],
    "first one late": [  # what comes afterwards is newer than it should be, and is believed
        *[(19900, 20.0, True), (20020, 20.02, False), (20040, 20.04, True)]
    ],
}


@pytest.mark.parametrize("answers", ANSWERS.values(), ids=ANSWERS)
def test_what_does_not_fit_the_time_is_doubted(answers):
    """Old answers never pass; a servo whose counter jumped is believed at its second one."""
    age = Freshness()
    assert [take(age, tick, asked) for tick, asked, _ in answers] == [new for *_, new in answers]


def test_answers_that_are_all_late_by_the_same_time():
    """They agree with each other, yet not one is taken; the first that is on time is."""
    age = Freshness()
    assert take(age, 20000, 20.0)
    for step in range(1, 20):
        assert not take(age, 20000 + 20 * (step - 1), 20.0 + 0.02 * step)
    assert take(age, 20400, 20.4)
