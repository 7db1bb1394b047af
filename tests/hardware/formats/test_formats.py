"""One recorded run is the same log in every format, and what is damaged or unsaid is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hardware.config import load_robot
from hardware.errors import LogError
from hardware.formats import FORMATS as KNOWN
from hardware.formats import Format, register
from hardware.formats.guess import guess, write_guess
from hardware.log import Log, read_log, read_logs
from tests.hardware.formats.recorded import FORMATS, JOINTS, LATE, mcap, renamed_csv, run

ABSENT = {"lerobot": ("qvel", "stamp")}  # what a format cannot hold


@pytest.mark.parametrize("name", FORMATS)
def test_one_run_is_one_log(name: str, tmp_path: Path) -> None:
    """Each format gives the same columns; a recording of messages keeps its nanoseconds."""
    wanted = run()
    (log,) = read_logs(FORMATS[name](tmp_path, wanted))
    columns = [c for c in wanted.columns if c.partition(".")[0] not in ABSENT.get(name, ())]
    assert set(log.columns) == set(columns)
    assert log.joints == list(JOINTS)
    for column in columns:
        tolerance = {"mcap": 1e-9, "rosbag2": 1e-9, "lerobot": 1e-6}.get(name, 1e-12)
        np.testing.assert_allclose(log.column(column), wanted.column(column), atol=tolerance)


def test_channels_keep_their_own_clocks(tmp_path: Path) -> None:
    """A position's stamp is when it was measured, not when the command was sent."""
    log = read_log(mcap(tmp_path, run()))
    np.testing.assert_allclose(log.column("stamp.pan"), log.time - LATE, atol=1e-6)


def test_a_pause_between_commands_starts_an_episode(tmp_path: Path) -> None:
    """Motions that were recorded into one file are episodes, each from 0 s."""
    whole = run()
    time = whole.time + np.where(np.arange(len(whole)) >= 120, 5.0, 0.0)
    moved = {
        c: v + time - whole.time if c.startswith("stamp.") else v for c, v in whole.columns.items()
    }
    log = read_log(mcap(tmp_path, Log({**moved, "time": time})))
    assert [len(part) for part in log.episodes()] == [120, 80]
    assert all(part.time[0] == 0 for part in log.episodes())


def test_a_recording_without_a_mapping_says_what_it_holds(tmp_path: Path) -> None:
    """The topics and their types are listed, with the command that writes a first mapping."""
    path = mcap(tmp_path, run())
    (tmp_path / "topics.yaml").unlink()
    with pytest.raises(LogError, match=r"/joint_states \(sensor_msgs/msg/JointState\)") as caught:
        read_log(path)
    assert "columns=topics.yaml" in str(caught.value)
    text = write_guess(path, tmp_path / "topics.yaml").read_text(encoding="utf-8")
    made = yaml.safe_load(text)["channels"]
    assert {"topic": "/joint_states", "field": "velocity", "names": "name", "to": "qvel"} in made
    with pytest.raises(LogError, match="the file exists"):
        write_guess(path, tmp_path / "topics.yaml")


@pytest.mark.parametrize(
    ("place", "change", "sentence"),
    [
        (0, {"topic": "/comands"}, r"no message of '/comands'.*did you mean '/commands'"),
        (0, {"field": "dat"}, r"topic /commands: its messages have no field 'dat'"),
        (0, {"names": ["pan"]}, r"'data' has 2 numbers, 1 names"),
        (0, {"to": "control"}, "unknown column 'control'"),
        (0, {"unit": "degree"}, "unit 'degree' is not known"),
        ("qpos.pan", {"from": "pan pos"}, "no 'pan pos'"),
        ("qpos.pan", {"form": "x"}, "`from` .* is missing"),
        ("position.pan", "pan qpos", "unknown column 'position.pan'"),
        ("qpos.pan", {"from": "pan qpos", "unit": "grad"}, "unit 'grad' is not known"),
        ("qpos.pan", "lift qpos", "'qpos.lift' and 'qpos.pan' are both read from 'lift qpos'"),
        ("qpos.pan", "pan ctrl", "'ctrl.pan' and 'qpos.pan' are both read from 'pan ctrl'"),
        (0, {"topic": "/joint_states", "field": "position"}, "both read from '/joint_states, pos"),
    ],
)
def test_a_wrong_mapping_is_named(tmp_path, place: int | str, change: Any, sentence: str) -> None:
    """File, topic or column, and what there is or the nearest name stand in the sentence."""
    of_topics = isinstance(place, int)
    path = (mcap if of_topics else renamed_csv)(tmp_path, run())
    file = tmp_path / ("topics.yaml" if of_topics else "columns.yaml")
    tree = yaml.safe_load(file.read_text())
    if of_topics:
        tree["channels"][place] |= change
    else:
        tree["columns"][place] = change
    file.write_text(yaml.safe_dump(tree))
    with pytest.raises(LogError, match=sentence):
        read_log(path)


def test_what_may_share_a_source(tmp_path: Path) -> None:
    """One command of two actuators, a time that is a stamp, an observation of a position."""
    path = renamed_csv(tmp_path, run())
    file = tmp_path / "columns.yaml"
    tree = yaml.safe_load(file.read_text())
    shared = {"ctrl.lift": "ctrl.pan", "stamp.lift": "time", "obs.0": "qpos.pan"}
    tree["columns"] |= {name: tree["columns"][other] for name, other in shared.items()}
    file.write_text(yaml.safe_dump(tree, sort_keys=False))
    log = read_log(path)
    np.testing.assert_array_equal(log.column("ctrl.lift"), log.column("ctrl.pan"))
    np.testing.assert_array_equal(log.column("obs.0"), log.column("qpos.pan"))


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("time_ms", ("time", "ms")),
        ("Timestamp [s]", ("time", "s")),
        ("cmd_elbow_deg", ("ctrl.elbow", "deg")),
        ("elbow/position", ("qpos.elbow", None)),
        ("left_hip_velocity", ("qvel.left_hip", None)),
        ("current_elbow(mA)", ("current.elbow", "mA")),
        ("wheel_color", None),
        ("dq_rad_s", ("qvel.joint", "rad/s")),
        ("elbow_speed_deg_per_s", ("qvel.elbow", "deg/s")),
        ("dq_elbow (rad/s)", ("qvel.elbow", "rad/s")),
        ("elbow_vel_deg", ("qvel.elbow", "deg/s")),
        ("velocity (rad)", ("qvel.joint", "rad/s")),
        ("velocity_s", ("qvel.s", None)),
        ("shoulder.vel", ("qvel.shoulder", None)),
        ("q1", ("qpos.joint1", None)),
        ("dq1", ("qvel.joint1", None)),
        ("present_position_1", ("qpos.joint1", None)),
        ("goal_position_1", ("ctrl.joint1", None)),
        ("actual_qd_0", ("qvel.joint0", None)),
        ("/joint_states/elbow/position", ("qpos.elbow", None)),
        ("/joint_commands/elbow/position", ("ctrl.elbow", None)),
        ("__time", ("time", None)),
        ("observation.state.shoulder_pan.pos", ("qpos.shoulder_pan", None)),
        ("elbow_pos_raw", ("qpos.elbow", "?")),
        ("target_velocity_1", None),
        ("elbow_torque", None),
        ("FL_hip_Pos", ("qpos.FL_hip", None)),
    ],
)
def test_headers_are_guessed(name: str, meant: object) -> None:
    """Common words for time, command, position, speed and current are recognized, with units."""
    assert guess(name) == meant


def test_the_guessed_mapping_reads_the_log(tmp_path: Path) -> None:
    """What is written for a header is a mapping that works as it is."""
    (tmp_path / "a.csv").write_text("t,cmd_pan,pos_pan,note\n0,1,0.5,7\n0.1,1,0.6,7\n")
    path = write_guess(tmp_path / "a.csv", tmp_path / "columns.yaml")
    assert "not recognized: note" in path.read_text(encoding="utf-8")
    log = read_log(tmp_path / "a.csv")
    assert log.joints == ["pan"]
    assert list(log.column("qpos.pan")) == [0.5, 0.6]


def guessed(folder: Path, text: str) -> tuple[str, dict]:
    """Return the mapping that is written for a CSV, as text and as a table."""
    (folder / "a.csv").write_text(text)
    (folder / "columns.yaml").unlink(missing_ok=True)
    words = write_guess(folder / "a.csv", folder / "columns.yaml").read_text(encoding="utf-8")
    return words, yaml.safe_load(words)


def test_a_guess_says_what_is_missing(tmp_path: Path) -> None:
    """No command, a joint without a position, no time: each is a line, and nothing is made up."""
    words, tree = guessed(tmp_path, "q1,dq1,q2\n0.1,1,0.2\n0.2,1,0.3\n")
    assert "missing: the command of a joint, `ctrl.<joint>`" in words
    assert tree["rate"] == "?"
    with pytest.raises(LogError, match=r"`ctrl.<joint>: \{from: NAME\}` is missing"):
        read_log(tmp_path / "a.csv")
    words, _ = guessed(tmp_path, "t,q1,cmd1,q2\n0,0.1,0.1,0.2\n0.1,0.2,0.1,0.3\n")
    assert "missing: `ctrl.joint2` for `qpos.joint2`" in words


def test_a_unit_that_no_name_tells_is_asked(tmp_path: Path) -> None:
    """Counts and degrees are recognized, and the log is refused until somebody says so."""
    text = "time,goal_position_1,present_position_1\n0,2048,2040\n0.02,3071,2950\n0.04,12,80\n"
    words, tree = guessed(tmp_path, text)
    assert "run from 80 to 2950, all whole: counts? then `unit: counts/4096`" in words
    with pytest.raises(LogError, match=r"the unit is not filled in yet"):
        read_log(tmp_path / "a.csv")
    for column in ("ctrl.joint1", "qpos.joint1"):
        tree["columns"][column] |= {"unit": "counts/4096", "zero": 2048}
    (tmp_path / "columns.yaml").write_text(yaml.safe_dump(tree))
    log = read_log(tmp_path / "a.csv")
    np.testing.assert_allclose(log.column("ctrl.joint1")[1], 1023 * 2 * np.pi / 4096)
    words, _ = guessed(tmp_path, "time,cmd_a,pos_a\n0,31.5,30.2\n0.02,45.5,40.1\n")
    assert "deg, counts, or per cent of a range?" in words


def test_negative_counts_that_were_read_as_large_ones_get_their_sign(tmp_path: Path) -> None:
    """Registers of 32 bits, and of 16."""
    for bits in (32, 16):
        rows = [(0.02 * i, 10 - 5 * i, (10 - 5 * i) % 2**bits) for i in range(6)]
        lines = ["t,cmd,pos", *(",".join(map(str, row)) for row in rows)]
        (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
        (tmp_path / "columns.yaml").write_text(
            "columns:\n  time: t\n  ctrl.a: {from: cmd, unit: counts/4096}\n"
            "  qpos.a: {from: pos, unit: counts/4096}\n"
        )
        log = read_log(tmp_path / "a.csv")
        np.testing.assert_allclose(log.column("qpos.a"), log.column("ctrl.a"))


def test_counts_may_be_those_of_a_robot_s_file(tmp_path: Path) -> None:
    """Turn, zero and direction of its servo; without a robot it is asked."""
    servo = load_robot("bench1").servos[0]
    angles = [0.0, 0.5, -0.25]
    counts = [servo.count(angle) for angle in angles]
    rows = [f"{0.02 * i},{count},{count}" for i, count in enumerate(counts)]
    (tmp_path / "a.csv").write_text("\n".join(["t,cmd,pos", *rows]) + "\n")
    columns = {"time": "t", f"ctrl.{servo.name}": {"from": "cmd", "unit": "counts"}}
    columns[f"qpos.{servo.name}"] = {"from": "pos", "unit": "counts"}
    tree = {"columns": columns, "meta": {"robot": "bench1"}}
    (tmp_path / "columns.yaml").write_text(yaml.safe_dump(tree))
    found = read_log(tmp_path / "a.csv").column(f"qpos.{servo.name}")
    np.testing.assert_allclose(found, angles, atol=servo.type.units.angle)
    (tmp_path / "columns.yaml").write_text(yaml.safe_dump({"columns": columns}))
    with pytest.raises(LogError, match=r"`meta: \{robot: NAME\}` names; else write `counts/4096`"):
        read_log(tmp_path / "a.csv")


@pytest.mark.parametrize("lines", [0, 2])
def test_a_table_without_a_line_of_names_or_with_two_is_mapped(tmp_path: Path, lines: int) -> None:
    """Columns go by their numbers, or by both names."""
    head = ["t,elbow,elbow", "s,cmd,pos"][:lines]
    rows = [*head, "0,1,0.5", "0.02,1,", "0.04,1,0.7", "0.06,1,0.8"]
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n")
    names = ("t s", "elbow cmd", "elbow pos") if lines else (0, 1, 2)
    columns = dict(zip(("time", "ctrl.elbow", "qpos.elbow"), names, strict=True))
    (tmp_path / "columns.yaml").write_text(yaml.safe_dump({"columns": columns}))
    log = read_log(tmp_path / "a.csv")
    np.testing.assert_allclose(log.column("qpos.elbow"), [0.5, 0.6, 0.7, 0.8])
    assert log.column("flag.fresh").tolist() == [1, 0, 1, 1]


def test_the_nanoseconds_of_a_stamp_are_added(tmp_path: Path) -> None:
    """The guess takes both columns."""
    text = "header.stamp.sec,header.stamp.nanosec,cmd_a,pos_a\n"
    text += "".join(f"1768472890,{20000000 * i},0.1,0.1\n" for i in range(5))
    _, tree = guessed(tmp_path, text)
    assert tree["columns"]["time"]["nanosec"] == "header.stamp.nanosec"
    np.testing.assert_allclose(read_log(tmp_path / "a.csv").time, 0.02 * np.arange(5), atol=1e-9)


@pytest.mark.parametrize(
    ("column", "unit", "sentence"),
    [
        ("qvel.a", "s", "'s' is a unit of time, and `qvel` is a column of angular speed or speed"),
        ("qpos.a", "deg/s", "'deg/s' is a unit of angular speed, and `qpos` is a column of angle"),
        ("time", "rad", "'rad' is a unit of angle, and `time` is a column of time"),
        ("current.a", "V", "its units are 'A', 'mA'"),
        ("qpos.a", "%", "a percentage of a range becomes rad by `scale`"),
        ("qpos.a", "counts/many", "does not give the counts per turn; write `counts/4096`"),
    ],
)
def test_a_unit_of_another_dimension_is_refused(tmp_path, column: str, unit: str, sentence) -> None:
    """With the units that the column takes."""
    (tmp_path / "a.csv").write_text("t,c,q,x\n0,1,1,1\n0.1,1,1,1\n")
    columns = {"time": "t", "ctrl.a": "c", "qpos.a": "q"} | {column: {"from": "x", "unit": unit}}
    (tmp_path / "columns.yaml").write_text(yaml.safe_dump({"columns": columns}))
    with pytest.raises(LogError, match=sentence):
        read_log(tmp_path / "a.csv")


def test_lerobot_s_normalized_units_are_angles_about_the_middle(tmp_path: Path) -> None:
    """100 is the upper end of the calibrated range, -100 the lower; a gripper counts from 0."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = ["pan.pos", "gripper.pos"]
    state = [[-100.0, 0.0], [0.0, 50.0], [100.0, 100.0]]
    columns = {"observation.state": state, "action": state, "timestamp": [0.0, 1 / 30, 2 / 30]}
    pq.write_table(pa.table({**columns, "episode_index": [0, 0, 0]}), tmp_path / "episode.parquet")
    features = {key: {"names": names} for key in ("action", "observation.state")}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"fps": 30, "features": features}))
    with pytest.raises(LogError, match="degrees or LeRobot's normalized units"):
        read_log(tmp_path / "episode.parquet")
    told = {"unit": "normalized", "calibration": "so101.json"}
    (tmp_path / "log.json").write_text(json.dumps(told))
    with pytest.raises(LogError, match=r"so101.json does not exist"):
        read_log(tmp_path / "episode.parquet")
    ranges = {"pan": (1024, 3072), "gripper": (2000, 3024)}  # counts: half a turn, a quarter
    joints = {
        name: {"id": 1, "drive_mode": 0, "homing_offset": 5, "range_min": low, "range_max": high}
        for name, (low, high) in ranges.items()
    }
    (tmp_path / "so101.json").write_text(json.dumps(joints))
    log = read_log(tmp_path / "episode.parquet")
    np.testing.assert_allclose(log.column("qpos.pan"), [-np.pi / 2, 0, np.pi / 2])
    np.testing.assert_allclose(log.column("qpos.gripper"), [0, np.pi / 4, np.pi / 2])
    assert log.meta["clock"] == "nominal"
    joints["pan"]["drive_mode"] = 1
    (tmp_path / "so101.json").write_text(json.dumps(joints))
    log = read_log(tmp_path / "episode.parquet")
    np.testing.assert_allclose(log.column("qpos.pan"), [np.pi / 2, 0, -np.pi / 2])


def test_a_format_of_one_s_own_is_read(tmp_path: Path) -> None:
    """A registered format is asked first, by every function that reads logs."""
    mine = Format("mine", lambda p: p.suffix == ".mine", lambda p: (dict(run().columns), {}))
    register(mine)
    try:
        (tmp_path / "a.mine").touch()
        assert read_log(tmp_path / "a.mine").joints == list(JOINTS)
        assert len(read_logs(tmp_path)) == 1
    finally:
        KNOWN.remove(mine)


def test_arrays_without_a_mapping_are_refused(tmp_path: Path) -> None:
    """An HDF5 file says nothing of its columns; the sentence says what to write."""
    (tmp_path / "run.h5").touch()
    with pytest.raises(LogError, match=r"needs a columns.yaml next to it"):
        read_log(tmp_path / "run.h5")
