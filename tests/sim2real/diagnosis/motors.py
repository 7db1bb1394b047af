"""The arm with motors that declare no limit, moved by a controller whose torques are logged."""

from pathlib import Path

import mujoco
import numpy as np

from envs.effects import make
from envs.plant import Plant
from hardware.log import Log
from tests.sim2real.diagnosis import arm

RATE = 100.0  # Hz
GAINS, DAMPING = np.array([8.0, 6.0]), np.array([0.4, 0.3])  # of the controller, N·m/rad, N·m·s/rad


def spec() -> mujoco.MjSpec:
    """Return the arm with a motor at each joint."""
    head, _ = arm.XML.split("<actuator>")
    motors = "".join(f'<motor name="{joint}" joint="{joint}"/>' for joint in "ab")
    return mujoco.MjSpec.from_string(f"{head}<actuator>{motors}</actuator></mujoco>")


def model(folder: Path) -> str:
    """Write the arm's file; return its path."""
    path = folder / "motors.xml"
    path.write_text(spec().to_xml(), encoding="utf-8")
    return str(path)


def make_log(friction: float, seconds: float) -> Log:
    """Return sweeps of the arm, whose second joint has Coulomb friction [N·m]."""
    plant = Plant(spec(), fixed=[(make("coulomb_friction", where="b"), (friction,))], threads=1)
    time = np.arange(round(seconds * RATE)) / RATE
    goals = 0.6 * np.sin(2 * np.pi * np.outer(time, (0.37, 0.61)) + (0.3, 1.1))
    row, rest = np.zeros(1, int), np.zeros((1, 2))
    plant.reset(row, rest, rest, np.zeros(1, np.uint64), rest)
    rows = []
    for goal in goals:
        torque = GAINS * (goal - plant.qpos[0]) - DAMPING * plant.qvel[0]
        rows.append((*torque, *plant.qpos[0]))
        plant.step(None, torque[None], round(1 / RATE / arm.STEP))
    names = ("ctrl.a", "ctrl.b", "qpos.a", "qpos.b")
    columns = {"episode": np.zeros(len(time)), "time": time}
    return Log(columns | dict(zip(names, np.array(rows).T, strict=True)))
