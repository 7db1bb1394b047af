"""A servo robot's properties for a task, from the file that its driver reads, too.

    machine = read_machine("quad8", ["hip_fl", "knee_fl"])
    machine.rate, machine.low, machine.most_step

`conf/robot/NAME.yaml` explains every key. Only what decides how the robot moves is read here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from envs.errors import TaskError, did_you_mean

ROBOTS = Path(__file__).parents[3] / "conf" / "robot"


@dataclass(frozen=True)
class ServoRobotSpec:
    """A servo robot, its n servos in the order of the model's actuators."""

    name: str  # the robot's
    rate: float  # control steps a second [1/s]
    delay: float  # the time from writing a command to its effect [s]
    age: float  # the time from a servo's reading to writing the command computed from it [s]
    voltage: tuple[float, ...]  # the voltage of each servo's supply, without load [V]
    low: np.ndarray  # least angles that may be commanded [rad], (n,)
    high: np.ndarray  # largest angles, (n,)
    most_step: np.ndarray  # largest change of a command in one control step [rad], (n,)
    kinds: tuple[str, ...]  # the servos' types
    registers: tuple[Mapping[str, int], ...]  # what is written to each servo before it moves


def read_machine(robot: str | Mapping[str, Any], actuators: Sequence[str]) -> ServoRobotSpec:
    """Read a robot's file.

    Args:
        robot: a name in conf/robot, a path, or what such a file holds.
        actuators: the model's, each of which has one servo.

    Raises:
        TaskError: there is no such robot, or it lacks a key or a servo.
    """
    data = robot if isinstance(robot, Mapping) else _read(robot)
    try:
        servos = [{**(data.get("servo") or {}), **data["servos"][name]} for name in actuators]
        rate = float(data["rate"])
        speed = np.array([float(servo["velocity"]) for servo in servos])
        return ServoRobotSpec(
            name=str(data["name"]),
            rate=rate,
            delay=float(data["command_delay"]),
            age=float(data["reading_age"]),
            voltage=tuple(
                float((servo.get("supply") or data["supply"])["voltage"]) for servo in servos
            ),
            low=np.array([float(servo["position"][0]) for servo in servos]),
            high=np.array([float(servo["position"][1]) for servo in servos]),
            most_step=np.minimum(float(data["max_step"]), speed / rate),
            kinds=tuple(str(servo["model"]) for servo in servos),
            registers=tuple(
                {**data["registers"], **servo.get("registers", {})} for servo in servos
            ),
        )
    except KeyError as error:
        raise TaskError(
            f"the robot {data.get('name', robot)!r} lacks {error}; conf/robot/quad8.yaml shows what"
            " a robot's file holds"
        ) from None


def _read(robot: str) -> Mapping[str, Any]:
    path = Path(robot) if robot.endswith((".yaml", ".yml")) else ROBOTS / f"{robot}.yaml"
    if not path.is_file():
        known = sorted(file.stem for file in ROBOTS.glob("*.yaml"))
        hint = did_you_mean(robot, known)
        raise TaskError(f"unknown robot {robot!r}{hint}; choose one of: {', '.join(known)}")
    return yaml.safe_load(path.read_text(encoding="utf-8"))
