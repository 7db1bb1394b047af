"""One recorded run is the same log in every format, and what is damaged or unsaid is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

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
    with pytest.raises(LogError, match="such a file already"):
        write_guess(path, tmp_path / "topics.yaml")


@pytest.mark.parametrize(
    ("place", "change", "sentence"),
    [
        (0, {"topic": "/comands"}, r"no message of '/comands'.*did you mean '/commands'"),
        (0, {"field": "dat"}, r"topic /commands: its messages have no field 'dat'"),
        (0, {"names": ["pan"]}, r"'data' has 2 numbers, 1 names"),
        (0, {"to": "control"}, "no column 'control'"),
        (0, {"unit": "degree"}, "unit 'degree' is not known"),
        ("qpos.pan", {"from": "pan pos"}, "there is no 'pan pos'"),
        ("qpos.pan", {"form": "x"}, "`from` is needed"),
        ("position.pan", "pan qpos", "a log has no column 'position.pan'"),
        ("qpos.pan", {"from": "pan qpos", "unit": "grad"}, "unit 'grad' is not known"),
    ],
)
def test_a_wrong_mapping_is_named(
    tmp_path: Path, place: int | str, change: Any, sentence: str
) -> None:
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
    with pytest.raises(LogError, match=r"so101.json is not there"):
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
    with pytest.raises(LogError, match=r"needs a columns.yaml beside it"):
        read_log(tmp_path / "run.h5")
