"""Rows of a log as recordings: where a replay starts, and what it is told."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.plant import Plant
from envs.replay import replay, switchable
from hardware.convert import convert
from hardware.errors import LogError
from hardware.log import Log, read_log, read_logs, write_log
from sim2real.diagnosis.data.recording import (
    check_log,
    load_model,
    shorten,
    to_recording,
)
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm

THROWN = """
<mujoco><option timestep="0.001"/>
<worldbody><body pos="0 0 1"><freejoint name="root"/><geom type="box" size=".1 .06 .04" mass="1"/>
<body pos="0.1 0 0"><joint name="leg" axis="0 1 0" armature="0.001"/>
<geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01" mass="0.1"/></body></body></worldbody>
<actuator><position name="leg" joint="leg" kp="2" kv="0.05"/></actuator></mujoco>
"""
SWING = """
<mujoco><option timestep="0.02" integrator="{integrator}"/><worldbody><body>
<joint name="a" axis="0 1 0"/><geom size="0.05" pos="0 0 -0.5" mass="1"/></body></worldbody>
<actuator><motor name="a" joint="a"/></actuator></mujoco>
"""
LIFT = """
<mujoco><worldbody><body><joint name="turn"/><geom size=".1"/>
<body pos=".3 0 0"><joint name="rise" type="slide"/><geom size=".1"/></body></body></worldbody>
<actuator><position name="turn" joint="turn"/><position name="up" joint="rise"/></actuator></mujoco>
"""
ROW = 57  # of a start in mid-motion


@pytest.fixture(scope="module")
def log() -> Log:
    """Four seconds of the arm."""
    return arm.make_log(seconds=4.0)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    """The arm."""
    return arm.spec().compile()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('timestep="0.001"', 'timestep="0"', "timestep=0 s is not between 1e-05 and 0.1"),
        ('timestep="0.001"', 'timestep="1e-9"', "timestep=1e-09 s is not between"),
        ('timestep="0.001"', 'timestep="-0.01"', "timestep=-0.01 s is not between"),
        ('timestep="0.001"', 'timestep="nan"', "timestep=nan s is not between"),
        ('<position name="leg" joint="leg" kp="2" kv="0.05"/>', "", "has no actuators"),
        (
            "<worldbody>",
            '<asset><mesh name="m" file="no.stl"/></asset>'
            '<worldbody><geom type="mesh" mesh="m" density="0"/>',
            "the mesh 'no.stl' is missing, and its geom touches other bodies",
        ),
        ('mass="1"', 'mass="0"', "mass and inertia"),
    ],
)
def test_a_model_that_cannot_be_simulated_is_named(old: str, new, words, log, tmp_path) -> None:
    """With its file: a time step, no actuators, a missing mesh, a body without mass."""
    path = tmp_path / "thrown.xml"
    path.write_text(THROWN.replace(old, new))
    with pytest.raises(Sim2RealError, match=words) as caught:
        load_model(log, path)
    assert str(path) in str(caught.value) and "model=PATH" not in str(caught.value)
    path.write_text(THROWN)
    assert load_model(log, path).actuators[0].name == "leg"


def test_the_clock_starts_with_the_first_row(log: Log, model: mujoco.MjModel) -> None:
    """A log whose time counts from another moment is the same recording."""
    later = Log({**log.columns, "time": log.time + 12.0, "stamp.a": log.time + 11.995})
    one, other = to_recording(log, model), to_recording(later, model)
    np.testing.assert_allclose(other.time, one.time, atol=1e-12)
    assert other.read is not None
    np.testing.assert_allclose(other.read, np.column_stack([one.time - 0.005, one.time]))
    assert np.array_equal(other.qpos, one.qpos)


def test_the_command_before_a_start_is_held(log: Log, model: mujoco.MjModel) -> None:
    """In mid-episode it is the row's before, at an episode's start the first one."""
    ctrl = np.column_stack([log.column(f"ctrl.{name}") for name in "ab"])
    part = log.rows(ROW, ROW + 50)
    inside = to_recording(log, model, ROW, ROW + 50)
    assert inside.held == pytest.approx(ctrl[ROW - 1])
    assert inside.since is not None and inside.past is not None
    rows = np.searchsorted(log.time, inside.since + log.time[ROW] + 1e-9) - 1
    np.testing.assert_allclose(inside.past, ctrl[rows])
    assert rows[-1] == ROW - 1 and len(rows) > 1
    assert to_recording(part, model).held == pytest.approx(ctrl[ROW])
    assert to_recording(part, model).past is None


def test_a_start_in_mid_episode_has_the_slope_of_the_positions(log: Log, model) -> None:
    """Where no speeds are logged; at the start of an episode the robot rests."""
    part = log.rows(ROW, ROW + 50)
    found = to_recording(log, model, ROW, ROW + 50).qvel
    around = np.column_stack([log.column(f"qpos.{name}")[ROW - 1 : ROW + 2] for name in "ab"])
    assert found == pytest.approx((around[2] - around[0]) * arm.RATE / 2, abs=0.05)
    assert np.abs(found).min() > 0.1
    assert not to_recording(part, model).qvel.any()


def test_a_start_has_the_speeds_that_were_logged(log: Log, model: mujoco.MjModel) -> None:
    """Anywhere in an episode."""
    speeds = {f"qvel.{name}": np.linspace(0, k, len(log)) for k, name in ((1.0, "a"), (-2.0, "b"))}
    told = Log({**log.columns, **speeds})
    for row in (0, ROW):
        found = to_recording(told, model, row, row + 50).qvel
        assert found.tolist() == [column[row] for column in speeds.values()]


@pytest.mark.parametrize("later", [-0.006, 0.006])
def test_a_start_is_where_the_joint_was_when_its_row_began(later: float) -> None:
    """Not where it was when it was read, 6 ms before or after: it moves up to 36 mrad meanwhile."""
    model = mujoco.MjModel.from_xml_string(SWING.format(integrator="RK4"))
    time, pulse = 0.02 * np.arange(100), 6.0
    for qvel in ({}, {"qvel.a": pulse * np.cos(pulse * (time + later))}):
        columns = {"episode": 0 * time, "time": time, "ctrl.a": 0 * time, "stamp.a": time + later}
        log = Log({**columns, "qpos.a": np.sin(pulse * (time + later)), **qvel})
        for row in range(20, 80):
            start = to_recording(log, model, row, 99)
            assert start.qpos[0] == pytest.approx(np.sin(pulse * time[row]), abs=1e-3)
            if not qvel:
                assert start.qvel[0] == pytest.approx(pulse * np.cos(pulse * time[row]), abs=0.15)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_start_s_speed_is_that_of_the_engine(integrator: str) -> None:
    """Half a step behind the motion, where positions move with a step's last velocity."""
    model = mujoco.MjModel.from_xml_string(SWING.format(integrator=integrator))
    data, states = mujoco.MjData(model), []
    data.qpos[0] = 1.5
    for _ in range(60):
        states.append((data.time, data.qpos[0], data.qvel[0]))
        mujoco.mj_step(model, data)
    time, position, speed = np.array(states).T
    log = Log({"episode": 0 * time, "time": time, "ctrl.a": 0 * time, "qpos.a": position})
    rows = range(5, 50)
    found = [to_recording(log, model, r, 60).qvel[0] for r in rows]
    off = np.abs(found - speed[list(rows)])  # half a step of the swing's acceleration: 0.18 rad/s
    assert off.max() < 0.04


@pytest.fixture(scope="module")
def thrown() -> tuple[mujoco.MjModel, Log]:
    """A body that was thrown and spins, with a leg that a servo moves: 0.6 s at 100 Hz."""
    model = mujoco.MjSpec.from_string(THROWN).compile()
    data = mujoco.MjData(model)
    data.qvel[:6] = [1.0, -0.5, 2.0, 3.0, -2.0, 4.0]
    names = [f"qpos.root.{k}" for k in range(7)] + ["qpos.leg"]
    names += [f"qvel.root.{k}" for k in range(6)] + ["qvel.leg"]
    time, states, ctrl = 0.01 * np.arange(60), [], 0.5 * np.sin(0.2 * np.arange(60))
    for goal in ctrl:
        states.append(np.concatenate([data.qpos, data.qvel]))
        data.ctrl[:] = goal
        mujoco.mj_step(model, data, 10)
    columns = {"episode": 0 * time, "time": time, "ctrl.leg": ctrl}
    return model, Log(columns | dict(zip(names, np.array(states).T, strict=True)))


@pytest.mark.parametrize("speeds", ["logged", "slopes"])
def test_a_base_goes_on_from_where_it_was_in_mid_flight(thrown, speeds) -> None:
    """Its pose and speed are the log's: a replay from there follows the flight."""
    model, log = thrown
    if speeds == "slopes":
        log = Log({n: c for n, c in log.columns.items() if not n.startswith("qvel.root")})
    start = to_recording(log, model, 30, 60)
    truth = thrown[1]
    qvel = [truth.column(f"qvel.root.{k}")[30] for k in range(6)]
    exact = speeds == "logged"
    assert start.qvel[:6] == pytest.approx(qvel, abs=1e-12 if exact else 0.05)
    (path,) = replay(Plant(switchable(mujoco.MjSpec.from_string(THROWN))), [start])
    flown = np.column_stack([log.column(f"qpos.root.{k}")[30:] for k in range(7)])
    np.testing.assert_allclose(path[:, :7], flown, atol=1e-7 if exact else 0.02)
    assert np.ptp(flown, axis=0).max() > 0.3


def test_a_base_without_a_whole_pose_rests_at_home(thrown: tuple[mujoco.MjModel, Log]) -> None:
    """What was not logged is the model's: nothing is guessed from a part of it."""
    model, log = thrown
    left = {n: c for n, c in log.columns.items() if ".root." not in n}
    start = to_recording(Log(left), model, 30, 60)
    assert start.qpos[:7].tolist() == model.qpos0[:7].tolist()
    assert not start.qvel[:6].any()


def test_a_model_beside_the_log_is_found(tmp_path: Path) -> None:
    """A log that was moved with its model to another folder, whose path was relative to the old."""
    (tmp_path / "arm.xml").write_text(arm.XML)
    path = write_log(tmp_path / "arm.csv", arm.make_log(seconds=1.0))
    path.with_suffix(".json").write_text('{"model": "../../models/arm.xml"}')
    (moved,) = read_logs(path)
    assert moved.model == tmp_path / "arm.xml"
    assert load_model(moved, None).actuators
    (tmp_path / "arm.xml").unlink()
    with pytest.raises(Sim2RealError, match=r"models/arm.xml"):
        load_model(moved, None)


def test_shorter_steps_wait_as_long() -> None:
    """A delayed actuator keeps its delay, and as much memory of commands as that takes."""
    spec = arm.spec()
    for actuator in spec.actuators:
        actuator.delay, actuator.nsample = 0.01, 7
    shorten(spec, 5)
    model = spec.compile()
    assert model.opt.timestep == pytest.approx(arm.STEP / 5)
    assert all(actuator.delay == 0.01 for actuator in spec.actuators)
    assert all(actuator.nsample * model.opt.timestep > 0.01 for actuator in spec.actuators)


@pytest.mark.parametrize(
    ("column", "entry", "words"),
    [
        ("qpos.turn", "unit: mm", "'mm' is a unit of length, but its joint is a hinge.*'rad'"),
        ("ctrl.up", "unit: deg", "'deg' is a unit of angle, but its joint is a slide.*'m', 'mm'"),
        ("qvel.rise", "unit: rpm", "'rpm' is a unit of angular speed.*'m/s', 'mm/s'"),
        ("qpos.rise", "unit: counts/4096", "'counts/4096' is a unit of angle"),
        ("qpos.rise", "unit: counts/4096, scale: 0.01", None),  # m/rad: a rack on a pinion
        ("qpos.rise", "unit: mm, scale: -1", None),
        ("ctrl.up", "unit: mm", None),
        ("qvel.turn", "unit: deg/s", None),
    ],
)
def test_units_are_those_of_the_joint(tmp_path, column: str, entry: str, words: str | None) -> None:
    """A length is refused for a hinge, an angle for a slide, also once the log was converted."""
    names = ["qpos.turn", "qpos.rise", "ctrl.turn", "ctrl.up"]
    lines = {"time": "{from: t}", **{name: f"{{from: {name}}}" for name in names}}
    lines[column] = f"{{from: {'v' if 'qvel' in column else column}, {entry}}}"
    text = "".join(f"  {name}: {line}\n" for name, line in lines.items())
    (tmp_path / "columns.yaml").write_text(f"columns:\n{text}", encoding="utf-8")
    rows = "".join(f"{0.1 * i},{i},0,1,{i},2\n" for i in range(5))
    (tmp_path / "run.csv").write_text(f"t,{','.join(names)},v\n{rows}", encoding="utf-8")
    (made,) = convert(tmp_path / "run.csv", tmp_path / "made")
    model = mujoco.MjModel.from_xml_string(LIFT)
    for path in (tmp_path / "run.csv", made):
        if words is None:
            check_log(read_log(path), model)
            continue
        with pytest.raises(LogError, match=f"{column}.*{words}.*correct `unit`"):
            check_log(read_log(path), model)
