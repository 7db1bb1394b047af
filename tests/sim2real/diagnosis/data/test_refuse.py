"""Logs that a diagnosis cannot use."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from envs.models import load_spec
from envs.plant import Plant
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.refuse import refuse_kinds
from sim2real.exam.thirdparty.robots import ASSETS
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm, motors

PENDULUM = ASSETS / "pendulum.xml"

WALKER = """
<mujoco><option timestep="0.002"/>
<worldbody><body name="torso" pos="0 0 1">{base}<geom type="box" size=".1 .1 .05" mass="1"/>
<body pos="0 0 .05"><joint name="hip" axis="0 1 0" armature="0.01" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass="0.2"/></body></body>
<body name="ball" pos="1 0 0"><freejoint name="toy"/><geom size=".1"/></body>
<geom type="plane" size="5 5 .1"/></worldbody>
<actuator><position name="hip" joint="hip" kp="5" kv="0.2"/></actuator></mujoco>
"""


def cut(folder: Path, base: str, **columns: float) -> Data:
    """Return the windows of a log of the hip, and of further columns."""
    path = folder / "walker.xml"
    path.write_text(WALKER.format(base=base), encoding="utf-8")
    time = np.arange(600) * 0.01
    own = {"episode": 0 * time, "time": time, "ctrl.hip": 0.5 * np.sin(5 * time)}
    more = {name.replace("__", "."): np.full(600, value) for name, value in columns.items()}
    return Data.of([Log({**own, "qpos.hip": 0.4 * np.sin(5 * time), **more})], path)


def test_a_free_base_without_its_pose_is_refused(tmp_path: Path) -> None:
    """By its name, or its body's; what is free and carries no joint does not matter."""
    with pytest.raises(Sim2RealError, match=r"base 'root' is free, and `qpos.root.0` is not"):
        cut(tmp_path, '<freejoint name="root"/>')
    with pytest.raises(Sim2RealError, match=r"`qpos.root.6` is not logged"):
        cut(tmp_path, '<freejoint name="root"/>', **{f"qpos__root__{k}": 0.5 for k in range(6)})
    pose = {f"qpos__root__{k}": 0.5 for k in range(7)}
    assert cut(tmp_path, '<freejoint name="root"/>', **pose).windows
    assert cut(tmp_path, "").windows


def test_commands_of_another_kind_are_refused() -> None:
    """Torques for servos, with how much closer they come as such; positions for motors."""
    with pytest.raises(Sim2RealError, match=r"servos at a, b.*act like torques.*closer"):
        refuse_kinds(motors.make_log(0.05, 6.0), arm.spec())
    with pytest.raises(Sim2RealError, match="follow the commands of a, b like desired positions"):
        refuse_kinds(arm.make_log(seconds=6.0), motors.spec())


def test_what_fits_passes() -> None:
    """Also where something else is wrong: a flipped sign, degrees, a joint that hardly follows."""
    log = arm.make_log(seconds=6.0)
    refuse_kinds(log, arm.spec())
    refuse_kinds(motors.make_log(0.05, 6.0), motors.spec())
    columns = dict(log.columns)
    for change in (-1.0, 180 / np.pi):
        wrong = {"ctrl.a": change * columns["ctrl.a"], "ctrl.b": change * columns["ctrl.b"]}
        refuse_kinds(Log({**columns, **wrong}), arm.spec())
    refuse_kinds(arm.make_log(("position_gain", {"where": "a"}, 0.1), seconds=6.0), arm.spec())


@pytest.mark.parametrize("limit", [0.5, 1.0, 2.0])
def test_a_servo_that_is_held_back_passes(limit: float) -> None:
    """A heavy joint much slower than commanded looks as if hardly anything moved it."""
    spec = load_spec(PENDULUM)
    plant = Plant(spec, fixed=[(make("profile_velocity", where="pivot"), (limit,))], threads=1)
    rng, row, rest = np.random.default_rng(0), np.zeros(1, int), np.zeros((1, 1))
    goals = rng.uniform(-1.0, 1.0, 40).repeat(50)
    plant.reset(row, rest, rest, np.zeros(1, np.uint64), rest)
    angle, steps = np.zeros(len(goals)), round(0.01 / plant.model.opt.timestep)
    for i, goal in enumerate(goals):
        angle[i] = plant.qpos[0, 0]
        plant.step(None, np.array([[goal]]), steps)
    time = 0.01 * np.arange(len(goals))
    columns = {"episode": 0 * time, "time": time, "ctrl.pivot": goals, "qpos.pivot": angle}
    refuse_kinds(Log(columns), spec)


def test_episodes_of_a_few_rows_pass() -> None:
    """Robots that fall at once: what is left after a delay of many rows is no evidence."""
    log = motors.make_log(0.05, 6.0)
    rows = np.arange(120)
    short = {name: column[:120] for name, column in log.columns.items()}
    short["episode"], short["time"] = rows // 6, log.column("time")[rows % 6]
    refuse_kinds(Log(short), motors.spec())
