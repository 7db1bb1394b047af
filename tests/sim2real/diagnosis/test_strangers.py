"""Robots that nobody here made: Gymnasium's, with friction hidden in one joint."""

from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.diagnose import diagnose

ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
RATE, STEP = 100, 0.0005  # rows a second; s
COUNT = 1e-4  # rad or m between two readings


def record(model: Path, joint: str, friction: float, seconds: float, effort: float) -> Log:
    """Write a model whose actuators have names, and return a log of it with friction in a joint."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / model.name))
    for actuator in spec.actuators:
        actuator.name = actuator.target
    spec.compile()
    model.write_text(spec.to_xml())
    spec.joint(joint).frictionloss = friction
    spec.option.timestep = STEP
    robot = spec.compile()
    data, rng = mujoco.MjData(robot), np.random.default_rng(0)
    time = np.arange(round(seconds * RATE)) / RATE
    tones, phases = rng.uniform(0.2, 1.5, (3, robot.nu)), rng.uniform(-3, 3, (3, robot.nu))
    waves = np.sin(2 * np.pi * tones * time[:, None, None] + phases).sum(axis=1)
    ctrl = 0.5 * effort * waves  # (T, nu)
    states = np.zeros((len(time), robot.nq))
    for row in range(len(time)):
        data.ctrl[:], states[row] = ctrl[row], data.qpos
        mujoco.mj_step(robot, data, round(1 / RATE / STEP))
    columns = {"episode": np.zeros(len(time)), "time": time}
    columns |= {f"ctrl.{robot.actuator(i).name}": ctrl[:, i] for i in range(robot.nu)}
    states = np.round(states / COUNT) * COUNT
    columns |= {f"qpos.{robot.joint(i).name}": states[:, i] for i in range(robot.njnt)}
    return Log(columns)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "joint", "friction", "seconds", "effort"),
    [("reacher", "joint1", 3.0, 12.0, 0.05), ("half_cheetah", "bthigh", 3.0, 8.0, 0.3)],
)
def test_a_strangers_friction_is_named(
    name: str, joint: str, friction: float, seconds: float, effort: float, tmp_path: Path
) -> None:
    """Motors with gears, contacts and joints that nothing drives: first, and near its value."""
    model = tmp_path / f"{name}.xml"
    report = diagnose(record(model, joint, friction, seconds, effort), model)
    first = report.causes[0]
    assert (first.effect, first.where) == ("coulomb_friction", joint)
    assert first.value == pytest.approx(friction, rel=0.1)
