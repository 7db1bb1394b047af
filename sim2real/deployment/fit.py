"""Whether a policy fits a robot: the interface it was trained for against the robot's file.

    check_interface(trained, robot)         # says what differs; raises where that cannot be meant

A robot may have other limits: they hold, whatever the policy asks for. Everything else (names and
order of observations and actions, rate, units, servos, gains) must be as in training.
"""

import logging
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from hardware.config import Robot
from sim2real.learning.interface import Block, interface, read_interface
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)
FREE = ".limits."  # what may differ


class Difference(NamedTuple):
    """One entry that is not the same on both sides; None: it is not there."""

    name: str
    trained: Any
    robot: Any

    @property
    def refused(self) -> bool:
        """Whether it cannot be meant."""
        return FREE not in self.name


def check_interface(trained: TrainedPolicy, robot: Robot) -> None:
    """Compare the interface that a policy was trained for with a robot, and say what differs.

    Raises:
        Sim2RealError: a difference that cannot be meant, with both sides' values; or a policy
            without an interface, with the command that adds it.
    """
    now = interface(trained.environment)
    if now is None:
        return
    then = now if trained.source is None else read_interface(trained.source)
    found = differences(then, of_robot(now, robot))
    if not found:
        return
    if any(one.refused for one in found):
        raise Sim2RealError(
            f"the policy's training interface differs from that of {robot.name}:\n"
            f"{side_by_side(found)}\nonly limits may differ; deploy a policy that was trained for "
            "this robot, or correct the robot's file"
        )
    words = "the limits of %s differ from those in training:\n%s"
    log_.warning(words, robot.name, side_by_side(found))


def of_robot(block: Block, robot: Robot) -> Block:
    """Return an interface with what the file of a robot says in place of what a task's does."""
    servos = {
        servo.name: {
            "model": servo.model,
            "gains": {**robot.registers, **servo.registers},
            "limits": {
                "position": [float(angle) for angle in servo.position],
                "step": min(robot.max_step, servo.velocity / robot.rate),
            },
        }
        for servo in robot.servos
    }
    return {**block, "robot": robot.name, "rate": robot.rate, "servos": servos}


def differences(trained: Mapping[str, Any], robot: Mapping[str, Any]) -> list[Difference]:
    """Return where two interfaces differ, entry by entry."""
    sides = dict(_flat(trained, "")), dict(_flat(robot, ""))
    names = dict.fromkeys([*sides[0], *sides[1]])
    rows = [Difference(name, sides[0].get(name), sides[1].get(name)) for name in names]
    return [row for row in rows if row.trained != row.robot]


def side_by_side(found: list[Difference]) -> str:
    """Return differences as a table of text."""
    rows = [("", "in training", "on the robot"), *((d.name, *map(_cell, d[1:])) for d in found)]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(f"  {line.rstrip()}" for line in lines)


def _cell(value: Any) -> str:
    return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the entries of nested tables and lists with their places, `servos.hip.model`."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _flat(part, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple):
        for i, part in enumerate(value):
            yield from _flat(part, f"{name}.{i}")
    else:
        yield name, float(value) if isinstance(value, int) else value
