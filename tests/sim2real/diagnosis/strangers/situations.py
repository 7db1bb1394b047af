"""Situations that people report of their robots, each as a log and a model of a small robot.

    made = SITUATIONS["one_row_late"].make(tmp_path)
    diagnose(made.log, made.model)

Each function takes a folder, writes `log.csv` and `model.xml` into it, and returns their paths; the
expected answer stands beside it. A log's mistake is put into the log after the robot has moved, so
that what is hidden is exactly that. `sim2real.exam.log_mistakes` has the names of mistakes.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hardware.log import Log, write_log
from tests.sim2real.diagnosis.strangers.answers import Expected
from tests.sim2real.diagnosis.strangers.robots import ARM1, ARM2, ARM3, Robot, motion

RATE = 50.0  # rows a second


class Files(NamedTuple):
    """A log and the model that its user has."""

    log: Path
    model: Path


class Situation(NamedTuple):
    """How a situation is made, and what is to be said about it."""

    make: Callable[[Path], Files]
    expected: Expected


def written(folder: Path, log: Log, model: Robot) -> Files:
    """Write a situation's log and model."""
    path = folder / "model.xml"
    path.write_text(model.nominal(), encoding="utf-8")
    return Files(write_log(folder / "log.csv", log), path)


def moved(robot: Robot, seconds: float, seed: int, rate: float = RATE) -> Log:
    """Return the log of a robot along the usual motion."""
    return robot.drive(motion(robot, seconds, rate, seed), rate)


def with_columns(log: Log, **columns: np.ndarray) -> Log:
    """Return a log with other columns; `ctrl_elbow` is `ctrl.elbow`."""
    named = {name.replace("_", ".", 1): values for name, values in columns.items()}
    return replace(log, columns={**log.columns, **named})


def nothing(folder: Path) -> Files:
    """Nothing is wrong: the control."""
    return written(folder, moved(ARM2, 8.0, 1), ARM2)


def slow_servo(folder: Path) -> Files:
    """The servo tops out at 2.7 rad/s, the gait needs 5.2."""
    time = np.arange(round(8 * RATE)) / RATE
    gait = 0.5 * np.sin(2 * np.pi * 1.65 * time[:, None] + (0.0, 1.2))
    goals = np.where((time % 4 < 2.5)[:, None], gait, motion(ARM2, 8.0, RATE, 2, size=0.6))
    robot = ARM2
    for joint in ARM2.joints:
        robot = robot.change(joint, stall=3.0, no_load=2.7)
    return written(folder, robot.drive(goals, RATE), ARM2)


def zero_off(folder: Path) -> Files:
    """One joint's zero is 24° off after a power cycle."""
    return written(folder, moved(ARM3.change("lift", zero=np.radians(24.0)), 8.0, 3), ARM3)


def compensated_gravity(folder: Path) -> Files:
    """The robot's firmware compensates gravity, the model does not."""
    return written(folder, moved(replace(ARM2, compensated=True), 8.0, 4), ARM2)


def stiff_model(folder: Path) -> Files:
    """The model's gain is 998 N·m/rad, the servo's 17.8."""
    robot, model = ARM2, ARM2
    for joint in ARM2.joints:
        robot = robot.change(joint, kp=17.8, braking=0.6, rotor=0.028)
        model = model.change(joint, kp=998.0, braking=0.6, rotor=0.028)
    return written(folder, moved(robot, 8.0, 5), model)


def jump_by_a_turn(folder: Path) -> Files:
    """After a restart, from 12.02 s on, one joint reads a whole turn more."""
    log = moved(ARM2, 20.0, 6)
    after = log.time >= 12.02 - 1e-9
    return written(
        folder, with_columns(log, qpos_elbow=log.columns["qpos.elbow"] + 2 * np.pi * after), ARM2
    )


def turn_on_both(folder: Path) -> Files:
    """Command and reading of one joint are both a turn off."""
    log = moved(ARM2, 8.0, 7)
    off = {f"{kind}_elbow": log.columns[f"{kind}.elbow"] + 2 * np.pi for kind in ("ctrl", "qpos")}
    return written(folder, with_columns(log, **off), ARM2)


def one_row_late(folder: Path) -> Files:
    """The column of commands stands one row late: the robot moves before its command."""
    log = moved(ARM2, 8.0, 8)
    rows = np.maximum(np.arange(len(log)) - 1, 0)
    late = {f"ctrl_{joint}": log.columns[f"ctrl.{joint}"][rows] for joint in ARM2.joints}
    return written(folder, with_columns(log, **late), ARM2)


def reversed_joint(folder: Path) -> Files:
    """A client's drive mode: one joint is reversed in command and reading."""
    log = moved(ARM3, 8.0, 9)
    back = {f"{kind}_lift": -log.columns[f"{kind}.lift"] for kind in ("ctrl", "qpos")}
    return written(folder, with_columns(log, **back), ARM3)


def policy_outputs(folder: Path) -> Files:
    """Commands are a policy's outputs: 0.25 × (target - default pose)."""
    log, default = moved(ARM2, 8.0, 10), {"shoulder": 0.3, "elbow": -0.5}
    outputs = {
        f"ctrl_{joint}": 0.25 * (log.columns[f"ctrl.{joint}"] - pose)
        for joint, pose in default.items()
    }
    return written(folder, with_columns(log, **outputs), ARM2)


def slow_clock(folder: Path) -> Files:
    """Steps take 86 ms, `time` counts 67 ms each."""
    log = moved(ARM1, 24.0, 11, rate=1 / 0.086)
    return written(folder, with_columns(log, time=log.time * (67 / 86)), ARM1)


def angle_from_the_ground(folder: Path) -> Files:
    """A parallel linkage: the elbow's angle is measured from the ground, not from the upper arm."""
    log = moved(ARM2, 8.0, 12)
    ground = log.columns["qpos.shoulder"] + log.columns["qpos.elbow"]
    return written(folder, with_columns(log, qpos_elbow=ground), ARM2)


SITUATIONS = {
    "slow_servo": Situation(
        slow_servo,
        Expected("robot", {"torque_speed_knee", "supply_voltage"}, {None, "shoulder", "elbow"}),
    ),
    "zero_off": Situation(
        zero_off,
        Expected("robot", {"encoder_offset"}, {"lift"}, near=(0.419, 0.03)),
    ),
    "compensated_gravity": Situation(
        compensated_gravity,
        Expected("world", {"gravity_compensation"}, {None}),
    ),
    "stiff_model": Situation(
        stiff_model,
        Expected("robot", {"position_gain"}, {None}, factor=(17.8 / 998, 1.25)),
    ),
    "jump_by_a_turn": Situation(
        jump_by_a_turn,
        Expected("log", {"turn"}, {"elbow"}, near=(1.0, 0.01), at=(12.02, 0.05)),
    ),
    "turn_on_both": Situation(
        turn_on_both,
        Expected("log", {"turn"}, {"elbow"}, near=(1.0, 0.01)),
    ),
    "one_row_late": Situation(
        one_row_late,
        Expected("log", {"row_shift"}, {None}, near=(1.0, 0.01), columns=("ctrl",)),
    ),
    "reversed_joint": Situation(
        reversed_joint,
        Expected("log", {"reversal"}, {"lift"}),
    ),
    "policy_outputs": Situation(
        policy_outputs,
        Expected("log", {"scale"}, {None, "shoulder", "elbow"}, factor=(0.25, 1.1)),
    ),
    "slow_clock": Situation(
        slow_clock,
        Expected("log", {"clock"}, {None}, factor=(67 / 86, 1.03)),
    ),
    "angle_from_the_ground": Situation(
        angle_from_the_ground,
        Expected("log", {"column_map"}, {"elbow"}),
    ),
}
