"""Periods, overruns and answers of a run, in virtual time, where every figure is exact."""

import logging

import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.counters import Counters
from hardware.emulator.faults import Fault
from hardware.link import AnswerCounts, LinkMonitor, LinkScore, LinkStatistics, format_link
from hardware.monitor import _lines, monitor
from hardware.pace import FixedRate
from hardware.record import Recording
from tests.hardware.rig import START


def test_periods_and_overruns():
    """Of steps of 4 ms at 100 Hz one takes 13 and one 27 ms.

    The step after the first begins 3 ms late. The one after the second loses a deadline, begins
    7 ms after the next and so ends 1 ms after that which follows.
    """
    clock = VirtualClock(5.0)
    pace = FixedRate(clock, 100.0)
    link = LinkMonitor(pace, {})
    for step in range(11):
        pace.wait()
        clock.sleep_until(clock.now() + {3: 0.013, 7: 0.027}.get(step, 0.004))
    found = link.statistics()
    periods = [10, 10, 10, 13, 7, 10, 10, 27, 4, 9]
    assert 1e3 * found.periods == pytest.approx(periods)
    assert (found.overruns, pace.missed) == (3, 1)
    wanted = dict(zip(("p50", "p90", "p99"), np.percentile(periods, (50, 90, 99)), strict=True))
    assert {k: 1e3 * v for k, v in found.percentiles.items()} == pytest.approx(wanted)


def test_a_step_that_begins_too_late_waits_for_the_next_deadline():
    """Half a period after its deadline there is no time left: it is one overrun, and one period."""
    clock = VirtualClock()
    pace = FixedRate(clock, 100.0)
    for span in (0.004, 0.016, 0.004):
        pace.wait(latest=0.005)
        clock.sleep_until(clock.now() + span)
    assert np.diff(pace.starts) == pytest.approx([0.01, 0.02])
    assert (pace.overruns, pace.jitter) == (1, [0.0, 0.0, 0.0])


def test_what_came_before_does_not_count():
    """A monitor counts from where it was made; of two runs the sum is that of both."""
    clock, counters = VirtualClock(), {"hip": Counters(asked=7, timeout=3), "knee": Counters()}
    pace = FixedRate(clock, 50.0)
    pace.wait()
    first = LinkMonitor(pace, counters, LinkScore(0.4, "why"))
    counters["hip"].asked, counters["hip"].stale = 9, 1
    pace.wait()
    pace.wait()
    assert first.statistics().servos["hip"] == AnswerCounts(asked=2, stale=1)
    second = LinkMonitor(pace, counters)
    counters["hip"].asked, counters["hip"].timeout, counters["knee"].late = 19, 5, 4
    whole = first.statistics() + second.statistics()
    assert whole.servos["hip"] == AnswerCounts(asked=12 + 10, lost=2 + 2, stale=1)
    assert whole.servos["knee"] == AnswerCounts(late=4 + 4)
    assert whole.total == AnswerCounts(asked=22, lost=4, late=8, stale=1)
    assert (len(whole.periods), whole.score) == (1, LinkScore(0.4, "why"))


def test_lost_and_late_answers_are_told_apart(rig):
    """Of servo 1 three answers are lost, and four come 2.5 ms late.

    Lost are two answers of the whole group, and one when it was asked again. Late are three of the
    group, which is one packet, and one of servo 1's state: the adapter may hold bytes for 1 ms and
    the program waits for 2 ms more, so that they are taken 1.5 ms after the wire explains them.
    """
    r = rig(
        Fault("drop", start=START, count=3, servo=1),
        Fault("late", start=START + 1.0, count=4, servo=1, value=0.0025),
    )
    r.run(1)
    link = LinkMonitor(FixedRate(r.clock, 50.0), r.driver.counters)
    r.run(100)
    servos = link.statistics().servos
    assert {name: (c.lost, c.late, c.stale) for name, c in servos.items()} == {
        "hinge1": (3, 4, 0),
        "hinge2": (2, 3, 0),
        "hinge3": (2, 3, 0),
    }


def test_one_line():
    """The line has periods in milliseconds, all answers, and who was worst."""
    servos = {"hip": AnswerCounts(100, lost=1), "knee": AnswerCounts(100, lost=2, late=3, stale=4)}
    link = LinkStatistics(np.array([0.01, 0.01, 0.012]), 5, servos)
    assert str(link) == (
        "link: period 10.0/11.6/12.0 ms (p50/p90/p99), 5 overruns in 3 periods; of 200 answers "
        "3 lost, 3 late, 4 stale, most of them knee's"
    )
    assert format_link(link.as_dict()) == str(link)
    assert "nan/nan/nan" in str(LinkStatistics(np.zeros(0), 0, servos))


def test_a_recording_tells_its_link_while_it_runs_and_in_its_log(rig, caplog):
    """12 s at 50 Hz: a line after 5 and after 10 s; the log's metadata have what was counted."""
    r = rig(Fault("drop", start=START + 2.0, count=1, servo=2))
    r.guard.arm()
    recording = Recording(r.guard)
    with caplog.at_level(logging.INFO, logger="hardware.record"):
        recording.drive(np.zeros((600, 3)))
    lines = [record.getMessage() for record in caplog.records]
    assert [line.split("; ")[0] for line in lines] == [
        f"link: period 20.0/20.0/20.0 ms (p50/p90/p99), 0 overruns in {n} periods"
        for n in (251, 501)
    ]
    told = recording.log().meta["link"]
    assert (told["periods"], told["overruns"], told["score"]) == (599, 0, None)
    assert told["period"] == pytest.approx({"p50": 0.02, "p90": 0.02, "p99": 0.02})
    assert {name: counts["lost"] for name, counts in told["servos"].items()} == {
        "hinge1": 0,
        "hinge2": 1,
        "hinge3": 0,
    }


def test_the_monitor_asks_as_a_run_does(chain):
    """Each second a line a servo and one of the link: 50 reads of all, and of each its share."""
    lines: list[str] = []
    monitor(chain(2), 2.5, lines.append)
    assert len(lines) == 3 * 3
    assert lines[7].startswith("          hinge2")
    assert lines[7].endswith("torque off, no errors; of 151 answers 0 lost, 0 late, 0 stale")
    assert lines[8] == (
        "link: period 20.0/20.0/20.0 ms (p50/p90/p99), 0 overruns in 100 periods; of 303 answers "
        "0 lost, 0 late, 0 stale"
    )


def test_the_monitor_shows_the_load_where_no_current_is_measured(rig, chain):
    """Of an XL430 at its work: what its register says, in percent, and no current."""
    shared = {"model": "xl430-w250", "supply": {"voltage": 11.1}}
    robot = chain(3, servo=shared, registers={"position_p_gain": 800})
    r = rig(robot=robot)
    r.run(30, 1.0)
    reading = r.driver.read()
    link = LinkMonitor(FixedRate(r.clock, robot.rate), r.driver.counters).statistics()
    lines = _lines(r.driver, reading, r.guard.health, link)
    for line, servo in zip(lines, r.world.servos, strict=False):
        percent = servo.memory["present_load"] / 10
        assert abs(percent) > 5
        assert f"rad/s load {percent:4.0f} %  " in line and " A " not in line
