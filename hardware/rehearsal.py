"""Measure control steps and answers on this machine and port before torque is switched on.

    times, score = score_link(step, clock, robot, driver.counters, StopLimits())
    print(score)            # link score 0.62: go; one control step in 20 takes 3.8 ms of 10.0 ms

`step` asks the servos and writes nothing.

On a busy machine, behind a slow adapter or a virtual port, steps take longer than the wire does. A
robot that moves already would then be stopped by its guard, or by its servos' watchdogs.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from hardware.clock import Clock
from hardware.config import Robot
from hardware.counters import Counters
from hardware.link import LinkMonitor, LinkScore, LinkStatistics
from hardware.pace import FixedRate
from hardware.stop_limits import StopLimits

SPAN = 1.0  # s of one attempt: some of the machine's usual interruptions fall into it
ATTEMPTS = 3  # the first good one counts: other programs may just have started


class Margin(NamedTuple):
    """The used fraction of a limit of the link."""

    what: str  # in words
    used: float  # part of the limit; above 1 the robot is not armed
    refusal: str  # what is wrong and what helps, where it is above 1


class StepTimes(NamedTuple):
    """The durations of one attempt's steps [s], and the counts of its answers."""

    typical: float  # the median, from a step's deadline to its end
    slow: float  # exceeded by the part `slow_steps` of them
    pause: float  # the longest from the end of one step to the end of the next
    reply: float  # the longest that `step` itself took
    link: LinkStatistics

    def margins(self, robot: Robot, limits: StopLimits) -> list[Margin]:
        """Return how much of each limit is used.

        Args:
            robot: the robot; a watchdog of 0 is off.
            limits: of the link.
        """
        period, place = 1 / robot.rate, f"{robot.name} at {robot.port}"
        one_in = f"one control step in {1 / limits.slow_steps:.0f} takes"
        slow, pause = f"{self.slow * 1e3:.1f} ms", f"{self.pause * 1e3:.0f} ms"
        found = [
            Margin(
                f"{one_in} {slow} of {period * 1e3:.1f} ms",
                self.slow / period,
                f"{place}: {one_in} {slow} or more (half of them {self.typical * 1e3:.1f} ms), and "
                f"{robot.rate:g} steps per second leave {period * 1e3:.1f} ms; end other programs, "
                f"or give a rate of at most {np.floor(1 / max(self.slow, period)):.0f}",
            )
        ]
        if robot.watchdog > 0:
            silence = f"{robot.watchdog * 1e3:.0f} ms"
            found.append(
                Margin(
                    f"the longest pause is {pause}, the servos' watchdogs allow {silence}",
                    self.pause / (limits.longest_pause * robot.watchdog),
                    f"{place}: between two control steps {pause} went by, and the servos stop by "
                    f"themselves after {silence} without a command; end other programs, or raise "
                    f"watchdog to {1.25 * self.pause / limits.longest_pause:.2f}",
                )
            )
        for kind, remedy in (
            ("lost", "look at cable, supply and adapter"),
            ("stale", "look at the adapter, the hub, and other programs"),
        ):
            name, part = self.link.worst(kind)
            allowed = getattr(limits, kind)
            words = f"{part:.1%} of {name}'s answers are {kind}"
            refusal = f"{place}: {words}, and stops.{kind} allows {allowed:.1%}; {remedy}"
            found.append(Margin(f"{words}, of {allowed:.1%}", part / allowed, refusal))
        return found

    def score(self, robot: Robot, limits: StopLimits) -> LinkScore:
        """Return whether the robot may be armed, with the limit that is used most, or exceeded."""
        margins = self.margins(robot, limits)
        value = 1 - max(margin.used for margin in margins)
        worst = next((m for m in margins if m.used > 1), max(margins, key=lambda m: m.used))
        return LinkScore(value, worst.refusal if worst.used > 1 else worst.what)


def rehearse(
    step: Callable[[], object],
    clock: Clock,
    rate: float,
    counters: Mapping[str, Counters],
    limits: StopLimits,
) -> StepTimes:
    """Take steps at this rate for SPAN seconds, and return what they took."""
    pace, ends, late, took = FixedRate(clock, rate), [], [], []
    link = LinkMonitor(pace, counters)
    for _ in range(max(round(SPAN * rate), 10)):
        deadline = pace.wait()
        begin = clock.now()
        step()
        ends.append(clock.now())
        late.append(ends[-1] - deadline)
        took.append(ends[-1] - begin)
    slow = float(np.quantile(late, 1 - limits.slow_steps))
    pause = float(max(np.diff(ends)))
    return StepTimes(float(np.median(late)), slow, pause, max(took), link.statistics())


def score_link(
    step: Callable[[], object],
    clock: Clock,
    robot: Robot,
    counters: Mapping[str, Counters],
    limits: StopLimits,
) -> tuple[StepTimes, LinkScore]:
    """Rehearse until the score means go, at most ATTEMPTS times; return what was measured last."""
    for _ in range(ATTEMPTS):
        times = rehearse(step, clock, robot.rate, counters, limits)
        score = times.score(robot, limits)
        if score.go:
            break
    return times, score
