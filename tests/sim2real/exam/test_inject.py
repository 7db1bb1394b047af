"""Known effects in real logs: what is made wrong, and what undoes it."""

import json
import os
from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.effects import load_effects
from hardware.log import Log, read_log
from sim2real.exam.cases import KEY
from sim2real.exam.inject import BASES, RealExam, inject, keep_joints, shortened
from sim2real.runs.errors import Sim2RealError

DATA = os.environ.get("SIM2REAL_DATA")
BENCH = BASES["xl330_p200"]
real = pytest.mark.skipif(DATA is None, reason="SIM2REAL_DATA names no folder of real logs")
TIME = np.arange(100) * 0.01


@pytest.fixture
def model() -> mujoco.MjModel:
    """A pendulum of the names of the real bench."""
    return mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="arm"><joint name="hinge"/>'
        '<geom size="0.1" mass="2"/></body></worldbody></mujoco>'
    )


def swing() -> Log:
    """Return a sine."""
    wave = np.sin(5 * TIME)
    columns = {"ctrl.hinge": wave, "qpos.hinge": wave, "qvel.hinge": 5 * np.cos(5 * TIME)}
    return Log({"episode": np.zeros(100), "time": TIME, **columns})


def test_a_delay_makes_positions_late_and_leaves_commands(model: mujoco.MjModel) -> None:
    """What is measured at t is what was there 50 ms before."""
    lie = inject("observation_delay", None, -0.05, BENCH, model)
    log = lie.change(swing())
    late = np.sin(5 * (TIME - 0.05))
    assert lie.value == 0.05
    assert log.column("qpos.hinge")[5:] == pytest.approx(late[5:], abs=1e-9)
    assert np.array_equal(log.column("ctrl.hinge"), np.sin(5 * TIME))


def test_a_wrong_zero_shifts_commands_and_positions(model: mujoco.MjModel) -> None:
    """A servo closes its loop on the encoder that is wrong."""
    log = inject("encoder_offset", "hinge", 0.2, BENCH, model).change(swing())
    for name in ("qpos.hinge", "ctrl.hinge"):
        assert log.column(name) == pytest.approx(np.sin(5 * TIME) + 0.2)


def test_lies_to_the_simulator_are_undone_by_the_truth(model: mujoco.MjModel) -> None:
    """A gain told too high by a factor needs one below 1; a mass told too high a negative one."""
    gain = inject("position_gain", "hinge", 0.5, BENCH, model)
    told_gain = {name: value for name, _, value in gain.known}["position_gain"]
    assert told_gain * gain.value == pytest.approx(0.5)
    mass = inject("link_mass", "arm", 0.5, BENCH, model)
    assert mass.mass is not None
    assert mass.mass[1] + mass.value == 0
    assert 2 + mass.mass[1] == pytest.approx(2 * np.exp(0.5))


def test_what_cannot_be_injected_is_refused(model: mujoco.MjModel) -> None:
    """With what can."""
    with pytest.raises(Sim2RealError, match="observation_delay"):
        inject("cogging", "hinge", 0.1, BENCH, model)


def test_joints_that_are_not_compared_are_fixed(tmp_path: Path) -> None:
    """Neither the model nor the log has them."""
    path = Path("envs/assets/arm6.xml")
    joints = ["base", "shoulder"]
    assert keep_joints(path, joints).compile().nu == 2
    columns = {f"{k}.{j}": TIME for k in ("ctrl", "qpos") for j in (*joints, "gripper")}
    log = shortened(Log({"episode": 0 * TIME, "time": 100 * TIME, **columns}), joints)
    assert log.joints == joints
    assert log.time[-1] == 30.0


def test_an_exam_without_logs_is_refused(tmp_path: Path) -> None:
    """It says what to set."""
    with pytest.raises(Sim2RealError, match=r"data=None has no xl330_bench.*SIM2REAL_DATA"):
        RealExam(None, 1, longest=60.0, block=4).draw(0)
    with pytest.raises(Sim2RealError, match=r"has no xl330_bench.*SIM2REAL_DATA"):
        RealExam(str(tmp_path), 1, longest=60.0, block=4).draw(0)
    with pytest.raises(Sim2RealError, match="each=0"):
        RealExam(None, 0, longest=60.0, block=4)


@real
def test_a_real_case_keeps_its_secret_and_opens_a_gap(tmp_path: Path) -> None:
    """The lie is in logs and model; the key alone says which it is."""
    exam = RealExam(DATA, 1, longest=60.0, block=4)
    outline = next(o for o in exam.draw(0) if o.effects == ("encoder_offset",))
    logs, key = tmp_path / "logs", tmp_path / "key"
    assert exam.make(outline, logs, key)
    case = json.loads((key / KEY).read_text())
    assert case["gap"] > 1.3 * case["residue"]
    assert sorted(p.name for p in logs.glob("*.csv")) == ["a.csv", "b.csv", "c.csv"]
    assert {e.name for e, _ in load_effects(logs / "known.yaml")}.isdisjoint({"encoder_offset"})
    assert read_log(key / "held.csv").model.is_file()  # type: ignore[union-attr]
