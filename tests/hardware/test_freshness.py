"""Old and doubled answers do not fit the time; a servo that starts anew is believed again."""

from __future__ import annotations

import numpy as np

from hardware.freshness import Freshness


def test_regular_answers_are_new_through_the_wrap():
    """Answers at any pace are new while counter and time agree, also across 32768."""
    rng = np.random.default_rng(0)
    age, time = Freshness(), 30.0
    assert not age.known
    for _ in range(5000):
        assert age.accept(int(1000 * time * 1.005) % 32768, time + rng.uniform(-1, 1) * 1e-3)
        time += rng.uniform(0.004, 0.5)
    assert age.known


def test_doubled_and_late_answers_are_old():
    """The same counter again, or one from 5 ms before, is not new."""
    age = Freshness()
    assert age.accept(1000, 1.0)
    assert not age.accept(1000, 1.02)
    assert not age.accept(1000, 1.001)
    assert age.accept(1040, 1.04)
    assert not age.accept(1050, 1.06)
    assert age.accept(1080, 1.08)


def test_a_servo_that_started_anew():
    """After a reboot the first answer is doubted, the second that agrees with it is taken."""
    age = Freshness()
    assert age.accept(20000, 20.0)
    assert not age.accept(120, 20.3)
    assert age.accept(140, 20.32)
    assert age.accept(160, 20.34)


def test_answers_that_are_all_late_by_the_same_time():
    """They agree with each other, yet not one is taken; the first that is on time is."""
    age = Freshness()
    assert age.accept(20000, 20.0)
    for step in range(1, 20):
        assert not age.accept(20000 + 20 * (step - 1), 20.0 + 0.02 * step)
    assert age.accept(20400, 20.4)


def test_a_first_answer_that_was_late():
    """What comes afterwards is newer than it should be, twice, and is believed."""
    age = Freshness()
    assert age.accept(19900, 20.0)
    assert not age.accept(20020, 20.02)
    assert age.accept(20040, 20.04)
