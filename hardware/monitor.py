"""Live readings and link quality of servos: torque stays as it is, nothing is written.

monitor(robot, seconds=10.0)        # the link's score, then a table a second

Servos are asked as in a run, at the robot's rate and one of them in turn for its state, so that
periods and answers are those that a run would have.
"""

from collections.abc import Callable
from itertools import cycle

from hardware.config import Robot
from hardware.connect import make_driver
from hardware.driver import Driver
from hardware.errors import format_names
from hardware.link import LinkMonitor, LinkStatistics
from hardware.pace import FixedRate
from hardware.readings import Health, Reading
from hardware.stop_limits import StopLimits

SHOWN_EVERY = 1.0  # s


def monitor(robot: Robot, seconds: float, say: Callable[[str], object] = print) -> None:
    """Show a robot's servos and its link until the time is over.

    Args:
        robot: the robot, calibration applied.
        seconds: for how long.
        say: takes each line.

    Raises:
        HardwareError: a robot that is not as its file says, or whose bus is gone.
    """
    driver = make_driver(robot)
    try:
        driver.connect()
        score = driver.measure_link(StopLimits())
        if score is not None:
            say(str(score))
        _watch(driver, seconds, say)
    finally:
        driver.close()


def _watch(driver: Driver, seconds: float, say: Callable[[str], object]) -> None:
    clock, turns = driver.clock, cycle(range(len(driver)))
    health = [driver.health(i) for i in range(len(driver))]
    pace = FixedRate(clock, driver.robot.rate)
    link = LinkMonitor(pace, driver.counters)
    begin, shown = clock.now(), 0
    while pace.wait() < begin + seconds:
        reading, i = driver.read(), next(turns)
        health[i] = driver.health(i) or health[i]
        if clock.now() >= begin + shown * SHOWN_EVERY:
            shown += 1
            for line in _lines(driver, reading, health, link.statistics()):
                say(line)


def _lines(
    driver: Driver, reading: Reading, health: list[Health | None], link: LinkStatistics
) -> list[str]:
    """Return a line for each servo, and one of the link."""
    lines = []
    for i, servo in enumerate(driver.robot.servos):
        name, answers, effort = servo.name, link.servos[servo.name], reading.effort[i]
        drawn = f"load {100 * effort:4.0f} %" if servo.type.current is None else f"{effort:7.3f} A"
        lines.append(
            f"{name:>16} {reading.position[i]:8.4f} rad {reading.velocity[i]:7.2f} rad/s "
            f"{drawn}  {_state(health[i])}; of {answers.asked} answers "
            f"{answers.lost} lost, {answers.late} late, {answers.stale} stale"
        )
    return [*lines, str(link)]


def _state(health: Health | None) -> str:
    """Return supply, temperature, torque and errors of one servo in words."""
    if health is None:
        return "no answer"
    errors = format_names(health.errors) if health.errors else "no errors"
    torque = "on" if health.torque else "off"
    return f"{health.voltage:4.1f} V {health.temperature:3.0f} °C torque {torque}, {errors}"
