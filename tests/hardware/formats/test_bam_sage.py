"""Logs of BAM and SAGE are read like our own, and refused with the place of what is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

from hardware.convert import convert
from hardware.errors import LogError
from hardware.log import read_log, read_logs

COUNT = 2 * np.pi / 4096


def bam(folder: Path, **changes) -> Path:
    """Write a run of a bench, three entries."""
    entries = [
        {
            "position": 0.1 * i,
            "speed": 0.5,
            "load": 10 * i,
            "input_volts": 7.4,
            "temp": 28,
            "timestamp": 0.003 + 0.005 * i,
            "goal_position": 0.2 * i,
            "torque_enable": i < 2,
        }
        for i in range(3)
    ]
    table = {"mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "motor": "xl330"}
    path = folder / "run.json"
    path.write_text(json.dumps({**table, "entries": entries, **changes}), encoding="utf-8")
    return path


def sage(folder: Path, control: list[str] | None = None, state: list[str] | None = None) -> Path:
    """Write a motion of two joints, as three rows each."""
    folder.mkdir(parents=True, exist_ok=True)
    control = control or [f'CONTROL,{20000 * i},"[{0.1 * i}, 0.5]"' for i in range(3)]
    state = state or [
        f'STATE_MOTOR,{20000 * i},"[{0.05 * i}, 0.25]","[{50 * i}, 0]","[{i}, 7]"' for i in range(3)
    ]
    head = "type,timestamp,positions"
    (folder / "control.csv").write_text("\n".join([head, *control]), encoding="utf-8")
    head += ",velocities,torques"
    (folder / "state_motor.csv").write_text("\n".join([head, *state]), encoding="utf-8")
    (folder / "joint_list.txt").write_text("Pan\n Jaw\n", encoding="utf-8")
    return folder


def test_a_bench_run_becomes_a_log(tmp_path):
    """Commands, positions, PWM, supply and conditions come through; time starts at 0."""
    log = read_log(bam(tmp_path))
    np.testing.assert_allclose(log.time, [0, 0.005, 0.010])
    np.testing.assert_allclose(log.column("ctrl.hinge"), [0, 0.2, 0.4])
    np.testing.assert_allclose(log.column("qpos.hinge"), [0, 0.1, 0.2])
    assert list(log.column("torque.hinge")) == [1, 1, 0]
    assert list(log.column("sensor.pwm")) == [0, 10, 20]
    assert log.settings == {"hinge": {"position_p_gain": 100}}
    assert (log.meta["mass_kg"], log.meta["nominal_voltage"]) == (0.49, 7.4)
    assert read_logs(tmp_path)[0].path == log.path


def test_a_negative_pwm_is_negative(tmp_path):
    """A register's two's complement becomes a signed number."""
    entries = [
        {"timestamp": 0.1 * i, "position": 0, "goal_position": 0, "load": load}
        for i, load in enumerate((12, 65535, 64651))
    ]
    log = read_log(bam(tmp_path, entries=entries))
    assert list(log.column("sensor.pwm")) == [12, -1, -885]


def test_a_bench_run_with_one_interval_for_all_entries(tmp_path):
    """Entries without stamps are `dt` apart."""
    entries = [{"position": 0, "goal_position": 0}] * 3
    assert list(read_log(bam(tmp_path, dt=0.01, entries=entries)).time) == [0, 0.01, 0.02]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"entries": []}, "a list 'entries'"),
        ({"entries": [1]}, r"row 0: the entry is a int"),
        ({"entries": [{"timestamp": 0, "position": 0}]}, r"row 0.*no 'goal_position'"),
        (
            {"entries": [{"timestamp": 0, "position": "x", "goal_position": 0}]},
            r"row 0, column 'position': 'x' is not a number",
        ),
        (
            {"entries": [{"timestamp": 0, "position": 0, "goal_position": 0}] * 2},
            "row 1, column 'time': time repeats",
        ),
    ],
)
def test_a_damaged_bench_run_is_refused(tmp_path, changes, message):
    """File, row and column are named."""
    path = bam(tmp_path, **changes)
    with pytest.raises(LogError, match=message) as caught:
        read_log(path)
    assert str(path) in str(caught.value)


def test_an_arm_s_motion_becomes_a_log(tmp_path):
    """Counts become rad/s, microseconds seconds; joints have the names of the list."""
    log = read_log(sage(tmp_path / "wave"))
    assert log.joints == log.actuators == ["Pan", "Jaw"]
    np.testing.assert_allclose(log.time, [0, 0.02, 0.04])
    np.testing.assert_allclose(log.column("qvel.Pan"), [0, 50 * COUNT, 100 * COUNT])
    assert list(log.column("sensor.current_raw_Jaw")) == [7, 7, 7]
    assert "stamp.Pan" not in log.columns
    sage(tmp_path / "sweep")
    assert [log.path.name for log in read_logs(tmp_path) if log.path] == ["sweep", "wave"]


def test_names_scale_and_model_of_an_arm_s_motion(tmp_path):
    """log.json above the motions renames joints, scales them and names the model."""
    more = {"joints": ["pan", "jaw"], "scale": {"jaw": [-0.1, 2]}, "model": "arm.xml"}
    (tmp_path / "log.json").write_text(json.dumps(more))
    log = read_log(sage(tmp_path / "wave"))
    np.testing.assert_allclose(log.column("ctrl.jaw"), 0.9)
    np.testing.assert_allclose(log.column("qpos.jaw"), 0.4)
    assert log.model == tmp_path / "arm.xml"


def test_an_arm_s_states_read_at_other_times_carry_their_stamps(tmp_path):
    """A row's state is the latest one before its command, and says when it was read."""
    state = [f'S,{20000 * i - 5000},"[{i}, 0]","[0.1, 0]","[0, 0]"' for i in range(4)]
    log = read_log(sage(tmp_path / "wave", state=state))
    np.testing.assert_allclose(log.column("qpos.Pan"), [0, 1, 2, 3])
    np.testing.assert_allclose(log.column("ctrl.Pan"), [0, 0.1, 0.2, 0.2])
    np.testing.assert_allclose(log.column("stamp.Pan"), [-0.005, 0.015, 0.035, 0.055])
    np.testing.assert_allclose(log.column("qvel.Pan"), 0.1)


@pytest.mark.parametrize(
    ("control", "message"),
    [
        (['C,0,"[0, 0]"', 'C,1,"[0]"'], r"row 1 \(line 3\), column 'positions': 1 numbers"),
        (['C,0,"[0, 0]"', 'C,1,"[0, x]"'], r"row 1 \(line 3\), column 'positions'.*not a list"),
        (['C,0,"[0, 0]"', 'C,a,"[0, 0]"'], r"row 1 \(line 3\), column 'timestamp'.*not a number"),
        (['C,0,"[0, 0]"', 'C,0,"[0, 0]"'], r"row 1 \(line 3\), column 'timestamp': time runs back"),
        (['C,0,"[0]"', 'C,1,"[0]"'], "must name 1 different joints"),
    ],
)
def test_a_damaged_motion_is_refused(tmp_path, control, message):
    """File, row, line and column are named."""
    with pytest.raises(LogError, match=message):
        read_log(sage(tmp_path / "wave", control=control))


def test_conversion_renames_and_names_the_model(tmp_path):
    """A CSV comes out that reads back with new names, settings and the model."""
    bam(tmp_path)
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    (file,) = convert(tmp_path / "run.json", tmp_path / "out", ["elbow"], tmp_path / "arm.xml")
    log = read_log(file)
    assert log.joints == log.actuators == ["elbow"]
    assert log.settings == {"elbow": {"position_p_gain": 100}}
    assert log.model is not None
    assert log.model.resolve() == tmp_path / "arm.xml"
    with pytest.raises(LogError, match="2 names cannot replace them"):
        convert(tmp_path / "run.json", tmp_path, joints=["a", "b"])


def test_conversion_renames_a_joint_whose_name_ends_like_another_s(tmp_path):
    """Wrist_Pitch is not the Wrist of Pitch."""
    folder = sage(tmp_path / "wave")
    (folder / "joint_list.txt").write_text("Pitch\nWrist_Pitch\n")
    (file,) = convert(folder, tmp_path / "out", joints=["lift", "flex"])
    log = read_log(file)
    assert "sensor.current_raw_flex" in log.columns
    assert list(log.column("sensor.current_raw_lift")) == [0, 1, 2]
