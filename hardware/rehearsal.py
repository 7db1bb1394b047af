"""What control steps take on this machine and port, measured before torque goes on.

    times = rehearse(step, clock, rate=100.0)       # `step` asks the servos and writes nothing
    check(times, robot)                             # raises if the robot's rate cannot be kept

On a busy machine, behind a slow adapter or a virtual port, steps take longer than the wire does. A
robot that moves already would then be stopped by its guard, or by its servos' watchdogs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hardware.clock import Clock
from hardware.config import Robot
from hardware.errors import ServoError
from hardware.pace import FixedRate

SPAN = 1.0  # s of one attempt: some of the machine's usual interruptions fall into it
ATTEMPTS = 3  # the first good one counts: other programs may just have started
LATE_PART = 0.05  # of the steps, that may be late
WATCHDOG_PART = 0.5  # of the watchdog's time, that the longest pause between steps may take


class StepTimes(NamedTuple):
    """What the steps of one attempt took [s]."""

    typical: float  # the median, from a step's deadline to its end
    slow: float  # exceeded by a part of LATE_PART
    pause: float  # the longest from the end of one step to the end of the next
    reply: float  # the longest that `step` itself took


def rehearse(step: Callable[[], object], clock: Clock, rate: float) -> StepTimes:
    """Take steps at this rate for SPAN seconds, and return what they took."""
    pace, ends, late, took = FixedRate(clock, rate), [], [], []
    for _ in range(max(round(SPAN * rate), 10)):
        deadline = pace.wait()
        begin = clock.now()
        step()
        ends.append(clock.now())
        late.append(ends[-1] - deadline)
        took.append(ends[-1] - begin)
    slow = float(np.quantile(late, 1 - LATE_PART))
    return StepTimes(float(np.median(late)), slow, max(np.diff(ends)), max(took))


def problem(times: StepTimes, robot: Robot) -> str | None:
    """Return why the robot's rate or watchdog cannot be kept, or None.

    Args:
        times: what the steps took.
        robot: the robot; a watchdog of 0 is off.
    """
    period, place = 1 / robot.rate, f"{robot.name} at {robot.port}"
    if times.slow > period:
        return (
            f"{place}: one control step in {1 / LATE_PART:.0f} takes {times.slow * 1e3:.1f} ms or "
            f"more (half of them {times.typical * 1e3:.1f} ms), and {robot.rate:g} steps a second "
            f"leave {period * 1e3:.1f} ms; end other programs, or give a rate of at most "
            f"{np.floor(1 / times.slow):.0f}"
        )
    if 0 < robot.watchdog * WATCHDOG_PART < times.pause:
        return (
            f"{place}: between two control steps {times.pause * 1e3:.0f} ms went by, and the "
            f"servos stop by themselves after {robot.watchdog * 1e3:.0f} ms without a command; "
            f"end other programs, or raise watchdog to {2.5 * times.pause:.2f}"
        )
    return None


def check(step: Callable[[], object], clock: Clock, robot: Robot) -> StepTimes:
    """Measure until the steps are quick enough, at most ATTEMPTS times, and return what they took.

    Raises:
        ServoError: the robot's rate or watchdog cannot be kept; with what was measured.
    """
    for _ in range(ATTEMPTS):
        times = rehearse(step, clock, robot.rate)
        found = problem(times, robot)
        if found is None:
            return times
    raise ServoError(f"{found}; torque stays off")
