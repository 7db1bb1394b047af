"""Logs of an exam: robots on stands, motions, and a nominal model that is honest."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.excite import ExcitationPlan
from hardware.log import Log
from sim2real.exam.logs import difference, drive, exam_robot, overall, plans
from sim2real.exam.measure import apart


@pytest.mark.parametrize("name", ["bench1", "hopper2", "quad8", "arm6"])
def test_a_robot_on_a_stand_has_its_driven_joints_alone(name: str, tmp_path: Path) -> None:
    """Nothing but servos moves it, nothing touches it, and it keeps the pose of `home`."""
    robot = exam_robot(name, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    assert model.nv == model.nu == len(robot.servos)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    before = mujoco.MjModel.from_xml_path(f"envs/assets/{name}.xml")
    assert data.qpos == pytest.approx(before.key("home").qpos[-model.nq :])


SLOW = pytest.param("quad8", 2.0e-3, marks=pytest.mark.slow)


@pytest.mark.parametrize(("name", "limit"), [("bench1", 2.5e-3), SLOW])
def test_the_nominal_model_is_right_where_nothing_is_hidden(name: str, limit, tmp_path) -> None:
    """Else a diagnosis would find a gap in the honest robot: it is about what noise makes."""
    robot = exam_robot(name, tmp_path)
    plan = _start(plans(robot, 5)["a"], 400)
    log, again = drive(robot, [], plan, 1), drive(robot, [], plan, 2)
    left = overall(apart(log, mujoco.MjSpec.from_file(str(robot.model))))
    assert 0.3e-3 < left < limit
    assert left < 2 * overall(difference(log, again))


@pytest.mark.slow
def test_the_true_effect_closes_the_gap(tmp_path: Path) -> None:
    """An effect of the emulator's own laws is the same effect in the simulator's."""
    from envs.effects import make

    robot = exam_robot("bench1", tmp_path)
    plan = _start(plans(robot, 5)["a"], 300)
    hidden = {"effect": "coulomb_friction", "where": "hinge", "value": 0.03}
    log = drive(robot, [hidden], plan, 1)
    spec = mujoco.MjSpec.from_file(str(robot.model))
    before = overall(apart(log, spec))
    after = overall(apart(log, spec, [(make("coulomb_friction", where="hinge"), (0.03,))]))
    assert before > 8e-3
    assert after < 2.5e-3


def test_an_arm_is_never_limp(tmp_path: Path) -> None:
    """Torque stays on in a robot that would fall, and goes off in one that hangs."""
    arm, bench = (exam_robot(name, tmp_path / name) for name in ("arm6", "bench1"))
    assert plans(arm, 0)["a"].torque.all()
    assert not plans(bench, 0)["a"].torque.all()


def test_the_repeat_is_the_beginning_of_the_first_motion(tmp_path: Path) -> None:
    """It is there for the noise alone; the second motion is another one."""
    made = plans(exam_robot("bench1", tmp_path), 3)
    rows = len(made["a_again"].angles)
    assert np.array_equal(made["a_again"].angles, made["a"].angles[:rows])
    assert not np.array_equal(made["a"].angles, made["b"].angles)


def _start(plan: ExcitationPlan, rows: int) -> ExcitationPlan:
    return ExcitationPlan(plan.angles[:rows], plan.torque[:rows])


@pytest.mark.slow
def test_where_a_robot_stood_is_no_gap(tmp_path: Path) -> None:
    """Logs that differ in their first second alone differ by nothing: a replay starts from it."""
    robot = exam_robot("bench1", tmp_path)
    log = drive(robot, [], _start(plans(robot, 5)["a"], 150), 1)
    position = log.column("qpos.hinge").copy()
    position[:49] += 0.3
    moved = Log({**log.columns, "qpos.hinge": position}, log.meta)
    assert overall(difference(log, moved)) == 0.0
    position[60:] += 0.1
    later = Log({**log.columns, "qpos.hinge": position}, log.meta)
    assert overall(difference(log, later)) == pytest.approx(0.1, rel=0.1)
