"""What control steps take is measured before torque, and a rate that cannot be kept is refused."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.config import load_robot
from hardware.counters import Counters
from hardware.emulator.faults import Fault, Faults
from hardware.errors import ServoError
from hardware.link import AnswerCounts, LinkStatistics
from hardware.rehearsal import StepTimes, rehearse, score_link
from hardware.stop_limits import StopLimits

ROBOT = replace(load_robot("hopper2"), port="/dev/ttyUSB0")  # 100 steps a second, watchdog 0.1 s


LIMITS = StopLimits()


def stepping(clock, spans):
    """Return a step that takes these times [s], one after the other."""
    left = iter(spans)
    return lambda: clock.sleep_until(clock.now() + next(left))


def times(typical: float, slow: float, pause: float, reply: float, **answers: int) -> StepTimes:
    """Return what was measured: times of steps [s], and a knee's answers."""
    servos = {"hip": AnswerCounts(1000), "knee": AnswerCounts(1000, **answers)}
    return StepTimes(typical, slow, pause, reply, LinkStatistics(np.full(99, 0.01), 0, servos))


def counters() -> dict[str, Counters]:
    """Return the counters of a servo that is never asked."""
    return {"knee": Counters()}


def test_what_steps_took():
    """Median, slowest twentieth and longest pause of known times."""
    clock = VirtualClock()
    spans = np.full(100, 0.004)
    spans[50] = 0.043
    found = rehearse(stepping(clock, spans), clock, 100.0, counters(), LIMITS)
    assert found.typical == pytest.approx(0.004)
    assert found.slow == pytest.approx(0.004)
    assert found.pause == pytest.approx(0.049)  # 10 ms less the step before, and the long one
    assert found.reply == pytest.approx(0.043)
    # it ends 33 ms late, and then 3 ms are left
    assert (len(found.link.periods), found.link.overruns) == (99, 1)


def test_a_score_is_what_is_left_of_the_limit_that_is_used_most():
    """Steps take 38 % of their time, the pause 48 % of its; 3 % lost answers are 60 % of theirs."""
    found = times(0.003, 0.0038, 0.024, 0.004).score(ROBOT, LIMITS)
    assert (found.go, found.value) == (True, pytest.approx(1 - 0.48))
    assert str(found) == (
        "link score 0.52: go; the longest pause is 24 ms, the servos' watchdogs allow 100 ms"
    )
    found = times(0.003, 0.0038, 0.024, 0.004, lost=30).score(ROBOT, LIMITS)
    assert found.as_dict() == {
        "score": pytest.approx(0.4),
        "go": True,
        "reason": "3.0% of knee's answers are lost, of 5.0%",
    }


@pytest.mark.parametrize(
    ("seconds", "answers", "reason", "accepted"),
    [
        (
            (0.004, 0.012, 0.02, 0.012),
            {},
            "one control step in 20 takes 12.0 ms or more (half of them 4.0 ms), and 100 steps per "
            "second leave 10.0 ms; end other programs, or give a rate of at most 83",
            ({"rate": 80.0}, {}),
        ),
        (
            (0.004, 0.006, 0.072, 0.07),
            {},
            "between two control steps 72 ms went by, and the servos stop by themselves after "
            "100 ms without a command; end other programs, or raise watchdog to 0.18",
            ({"watchdog": 0.2}, {}),
        ),
        ((0.004, 0.006, 0.07, 0.07), {}, "between two control steps", ({"watchdog": 0.0}, {})),
        (
            (0.004, 0.004, 0.01, 0.004),
            {"lost": 60},
            "6.0% of knee's answers are lost, and stops.lost allows 5.0%; look at cable",
            ({}, {"lost": 0.1}),
        ),
        (
            (0.004, 0.004, 0.01, 0.004),
            {"stale": 251},
            "25.1% of knee's answers are stale, and stops.stale allows 5.0%; look at the adapter",
            ({}, {"stale": 0.3}),
        ),
    ],
)
def test_a_link_that_is_not_good_enough_is_refused(seconds, answers, reason, accepted):
    """Too slow, a pause that trips watchdogs, lost or stale answers: no-go, and what helps."""
    found = times(*seconds, **answers)
    score = found.score(ROBOT, LIMITS)
    assert not score.go and "no-go; hopper2 at /dev/ttyUSB0: " in str(score)
    assert reason in score.reason
    robot, limits = accepted
    assert found.score(replace(ROBOT, **robot), replace(LIMITS, **limits)).go


def test_one_bad_second_is_forgiven():
    """A machine that was busy at the start is measured again; one that stays so is refused."""
    clock = VirtualClock()
    busy, quiet = np.full(50, 0.02), np.full(100, 0.004)
    step = stepping(clock, [*busy, *busy, *quiet])
    found, score = score_link(step, clock, ROBOT, counters(), LIMITS)
    assert found.slow == pytest.approx(0.004) and score.go
    step = stepping(clock, np.full(300, 0.02))
    assert not score_link(step, clock, ROBOT, counters(), LIMITS)[1].go


def test_the_guard_measures_a_real_port_before_it_arms(rig, chain):
    """Arming asks the servos for a second at the robot's rate, once, and writes nothing by it."""
    r = rig()
    r.driver.robot = replace(r.driver.robot, port="/dev/ttyUSB0")
    before, memory = r.clock.now(), [bytes(s.memory.data[:120]) for s in r.world.servos]
    r.driver.measure_link(LIMITS)
    assert r.clock.now() - before == pytest.approx(1.0, abs=0.05)
    assert [bytes(s.memory.data[:120]) for s in r.world.servos] == memory
    r.driver.measure_link(LIMITS)
    assert r.clock.now() - before == pytest.approx(1.0, abs=0.05)
    r.driver.connect()
    r.world.faults = Faults([Fault("drop")], np.random.default_rng(0))
    with pytest.raises(ServoError, match=r"no-go; chain3 at /dev/ttyUSB0: one .* torque stays off"):
        r.guard.arm()
    assert r.powered == [False] * 3


def test_a_link_that_loses_answers_does_not_arm_unless_it_may(rig):
    """One answer in five is lost: no torque; with stops.lost=0.5 it goes on, and the score says."""
    r = rig()
    r.driver.robot = replace(r.driver.robot, port="/dev/ttyUSB0")
    r.world.faults = Faults([Fault("drop", probability=0.2)], np.random.default_rng(0))
    with pytest.raises(ServoError, match=r"of hinge2's answers are lost, .* torque stays off"):
        r.guard.arm()
    assert r.powered == [False] * 3
    r.guard.limits = replace(LIMITS, lost=0.5)
    r.guard.arm()
    assert r.powered == [True] * 3
    assert r.driver.score is not None and 0 < r.driver.score.value < 1
