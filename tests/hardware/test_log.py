"""The trajectory log reads back what was written, and refuses what is no log."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from hardware.errors import LogError
from hardware.log import Log, check_names, read_log, read_logs, write_log

HEADER = "episode,time,ctrl.hinge,qpos.hinge\n"


def make_log(**more) -> Log:
    """Return a log of two episodes, with metadata."""
    rng = np.random.default_rng(0)
    columns = {
        "episode": [3, 3, 3, 7, 7],
        "time": [0, 0.02, 0.0401, 0, 0.019],
        "ctrl.hinge": rng.normal(size=5),
        "qpos.hinge": rng.normal(size=5) / 3,
        "torque.hinge": [1, 1, 0, 0, 1],
    }
    meta = {"robot": "bench1", "model": "m.xml", "settings": {"hinge": {"p": 400}}}
    return Log(columns, meta | more)


def write_text(tmp_path: Path, text: str) -> Path:
    """Write a CSV by hand."""
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_round_trip(tmp_path, ending):
    """Every bit of the numbers and all metadata come back, from CSV and from Parquet."""
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    log = make_log(note="Ω")
    path = write_log(tmp_path / f"a.{ending}", log)
    back = read_log(path)
    assert back.meta == log.meta
    assert list(back.columns) == list(log.columns)
    for name, values in log.columns.items():
        np.testing.assert_array_equal(back.column(name), values)
        assert back.column(name).dtype == values.dtype
    assert back.model == tmp_path / "m.xml"
    assert back.settings == {"hinge": {"p": 400}}
    assert {p.name for p in tmp_path.iterdir()} <= {"a.csv", "a.json", "a.parquet"}


def test_views():
    """Actuators, joints and episodes are what the columns say; a free joint is one joint."""
    log = make_log()
    assert log.actuators == ["hinge"]
    assert log.joints == ["hinge"]
    assert [list(part.time) for part in log.episodes()] == [[0, 0.02, 0.0401], [0, 0.019]]
    part = log.rows(1, 3)
    assert list(part.time) == [0.02, 0.0401] and len(log) == 5
    assert (part.meta, part.path) == (log.meta, log.path)
    free = dict(log.columns) | {f"qpos.root.{i}": np.zeros(5) for i in range(7)}
    assert Log(free).joints == ["hinge", "root"]
    with pytest.raises(LogError, match=r"no column 'qpos.hing' \(did you mean 'qpos.hinge'"):
        log.column("qpos.hing")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("episode,time,ctrl.a\n0,0,1\n0,1,1\n", r"'qpos.<joint>' is missing"),
        ("episode,time,qpos.a\n0,0,1\n0,1,1\n", r"'ctrl.<actuator>' is missing"),
        ("episod,time,ctrl.a,qpos.a\n0,0,1,1\n", r"'episode' is missing \(did you mean 'episod"),
        (
            HEADER + "0,0,1,1\n0,1,nan,1\n0,2,1,1\n",
            r"row 1 \(line 3\), column 'ctrl.hinge': a command is m",
        ),
        (HEADER + "0,0,1,inf\n0,1,1,1\n", r"row 0 \(line 2\), column 'qpos.hinge': inf"),
        (
            HEADER + "0,0,1,1\n0,1,,1\n0,2,1,1\n",
            r"row 1 \(line 3\), column 'ctrl.hinge': a command is m",
        ),
        (HEADER + "0,0,1,1\n0,1,1\n", r"row 1 \(line 3\): 3 cells, but the header names 4"),
        (HEADER + "0,0,1\n0,1,1\n", r"row 0 \(line 2\): 3 cells"),
        (
            HEADER + "0,0,1,1\n0,1,1,1\n0,0.5,1,1\n",
            r"row 2 \(line 4\), column 'time': time runs.*another `episode`",
        ),
        (HEADER + "0,0,1,1\n0,1,1,1\n0,1,1,1\n", r"row 2 \(line 4\).*time repeats.*remove the row"),
        (HEADER + "0,0,1,1\n0,1,1,1\n1,0,1,1\n", r"row 2 \(line 4\).*episode 1 has 1 row"),
        (
            HEADER + "0,0,1,1\n0,1,1,1\n1,0,1,1\n1,1,1,1\n0,2,1,1\n0,3,1,1\n",
            r"row 4.*0 occurs again",
        ),
        (HEADER + "0.5,0,1,1\n0.5,1,1,1\n", r"column 'episode': 0.5 is not a whole number"),
        (HEADER + "0,0,1,1e300\n0,1,1,1\n", r"\(line 2\), column 'qpos.hinge': 1e\+300 is no"),
        (
            "ep,t,cmd,pos\n0,0,1,1\n",
            r"'episode' and 'time' and 'ctrl.<actuator>' and 'qpos.<joint>'",
        ),
        ("ep,t,cmd,pos\n0,0,1,1\n", r"are missing.*sim2real convert LOG columns=columns.yaml"),
        (HEADER.replace(",", ";") + "0;0;1,5;1\n0;1;1;1\n", "'1,5' is not a number; write decimal"),
        ("a" * 300_000 + "\n1\n", "the first line names no columns"),
        ("x," * 600_000 + "\n1\n", "the first line has 1,000,000 characters or more"),
        ("x," * 200_000 + "y\n1\n", "column 'x' occurs 200000 times"),
        (HEADER, r"has no rows"),
        (HEADER + "-,s,rad,rad\n0,0,1,1\n0,1,1,1\n", r"row 0 \(line 2\): no number in it"),
        ("0,0,1,1\n0,1,1,1\n", "the first line contains numbers, not names; write episode,time"),
        ("", r"the file is empty"),
        ("episode,time,time,ctrl.a,qpos.a\n", r"'time' occurs 2 times"),
    ],
)
def test_refuses(tmp_path, text, message):
    """What breaks a rule is refused with the file, the row and the column."""
    path = write_text(tmp_path, text)
    with pytest.raises(LogError, match=message) as caught:
        read_log(path)
    assert str(path) in str(caught.value)


def test_time_may_start_again_with_an_episode(tmp_path):
    """A new episode starts its own time, which is no step back."""
    assert len(read_log(write_text(tmp_path, HEADER + "0,0,1,1\n0,1,1,1\n1,0,1,1\n1,1,1,1\n"))) == 4


def test_semicolons_separate_too(tmp_path):
    """Spreadsheets of many countries write them, and tabs; the file may end in .CSV."""
    text = HEADER + "0,0,1,1.5\n0,1,1,2\n"
    for separator, name in ((";", "a.csv"), ("\t", "b.CSV")):
        path = tmp_path / name
        path.write_text(text.replace(",", separator))
        assert list(read_log(path).column("qpos.hinge")) == [1.5, 2]


def test_bad_files(tmp_path):
    """A missing file, another ending and damage are each one sentence."""
    write_log(tmp_path / "swing.csv", make_log())
    with pytest.raises(LogError, match=r"no such log \(did you mean 'swing.csv'"):
        read_log(tmp_path / "swin.csv")
    (tmp_path / "x.txt").write_text("")
    with pytest.raises(LogError, match=r"not \.txt|this is \.txt"):
        read_log(tmp_path / "x.txt")
    (tmp_path / "swing.json").write_text("{")
    with pytest.raises(LogError, match=r"swing.json.*cannot be read as JSON"):
        read_log(tmp_path / "swing.csv")
    (tmp_path / "swing.json").write_text("[1]")
    with pytest.raises(LogError, match="is a list, not a table"):
        read_log(tmp_path / "swing.csv")
    pytest.importorskip("pyarrow")
    (tmp_path / "y.parquet").write_bytes(b"PAR1 but not really")
    with pytest.raises(LogError, match="cannot be read as Parquet"):
        read_log(tmp_path / "y.parquet")


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        ('{"model": 5}', "a.json: 'model' is 5; it is the path of an MJCF or URDF"),
        ('{"settings": 3}', "a.json: 'settings' is 3; it is a table"),
        ("[1]", "a.json: the metadata is a list, not a table"),
        ('{"model": ', "a.json: the log's metadata cannot be read as JSON"),
    ],
)
def test_metadata_of_another_kind_is_refused(tmp_path, meta, message):
    """The file beside the log, with the key and what it should be."""
    (tmp_path / "a.csv").write_text(HEADER + "0,0,1,1\n0,1,1,1\n")
    (tmp_path / "a.json").write_text(meta)
    with pytest.raises(LogError, match=message):
        read_log(tmp_path / "a.csv")


def test_unknown_columns_are_left_out_with_a_warning(tmp_path, caplog):
    """A column of another name is no part of the log, and the user hears of it."""
    path = write_text(tmp_path, "episode,time,ctrl.a,qpos.a,qvl.a\n0,0,1,1,9\n0,1,1,1,9\n")
    assert "qvl.a" not in read_log(path).columns
    assert "did you mean 'qvel'" in caplog.text
    path = write_text(tmp_path, 'episode,note,time,ctrl.a,qpos.a\n0,"a, b",0,1,5\n0,,1,1,6\n')
    assert list(read_log(path).column("qpos.a")) == [5, 6]


def test_files_folders_and_lists(tmp_path):
    """A folder is read in the order of its names, a list in its own; empty ones are refused."""
    for name in ("b", "a"):
        write_log(tmp_path / f"{name}.csv", make_log(name=name))
    assert [log.meta["name"] for log in read_logs(tmp_path)] == ["a", "b"]
    both = read_logs([tmp_path / "b.csv", tmp_path])
    assert [log.meta["name"] for log in both] == ["b", "a", "b"]
    with pytest.raises(LogError, match="empty list"):
        read_logs([])
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match="contains no log"):
        read_logs(tmp_path / "empty")


def test_writing_is_whole_or_nothing(tmp_path, monkeypatch):
    """A write that fails leaves the earlier log untouched and no litter beside it."""
    path = write_log(tmp_path / "a.csv", make_log())
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="no space"):
        write_log(path, make_log(name="new"))
    assert path.read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "a.json"}


def test_writing_without_metadata_removes_an_older_sidecar(tmp_path):
    """Metadata of an earlier log of that name never describes the new one."""
    path = write_log(tmp_path / "a.csv", make_log())
    write_log(path, Log(make_log().columns))
    assert read_log(path).meta == {}


def test_check_names():
    """Names that the model lacks are refused, and a driven joint must be logged."""
    log = make_log()
    check_names(log, ["hinge"], ["hinge"], driven=["hinge"])
    with pytest.raises(
        LogError, match=r"'ctrl.hinge'.*no actuator 'hinge' \(did you mean 'hinge1'"
    ):
        check_names(log, ["hinge"], ["hinge1"])
    with pytest.raises(LogError, match=r"'qpos.hinge'.*no joint 'hinge'.*it has 'knee'"):
        check_names(log, ["knee"], ["hinge"])
    with pytest.raises(LogError, match=r"'qpos.knee' is missing"):
        check_names(log, ["hinge", "knee"], ["hinge"], driven=["hinge", "knee"])


def test_lerobot_episode(tmp_path):
    """A LeRobot data set is read with its joints' names; degrees become radians if it says so."""
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    file = tmp_path / "data" / "chunk-000" / "episode_000000.parquet"
    file.parent.mkdir(parents=True)
    (tmp_path / "meta").mkdir()
    names = {"names": ["pan.pos", "lift.pos"]}
    info = {"features": {"action": names, "observation.state": names}, "unit": "degrees"}
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    table = {
        "action": [[180.0, 0.0], [90.0, 0.0]],
        "observation.state": [[0.0, 45.0], [0.0, 90.0]],
        "timestamp": [0.0, 1 / 30],
        "episode_index": [4, 4],
        "frame_index": [0, 1],
    }
    pq.write_table(pa.table(table), file)
    (log,) = read_logs(tmp_path)
    assert log.joints == log.actuators == ["pan", "lift"]
    np.testing.assert_allclose(log.column("ctrl.pan"), [np.pi, np.pi / 2])
    np.testing.assert_allclose(log.column("qpos.lift"), [np.pi / 4, np.pi / 2])
    assert list(log.episode) == [4, 4]


REAL = os.environ.get("SIM2REAL_DATA")


@pytest.mark.skipif(not REAL, reason="SIM2REAL_DATA does not name the folder of real logs")
def test_real_logs():
    """All real logs are read, with their models and their servo's settings."""
    bench = read_logs(Path(str(REAL)) / "xl330_bench")
    assert len(bench) == 12
    assert {log.settings["hinge"]["position_p_gain"] for log in bench} == {100, 200, 800}
    assert all(log.model is not None and log.model.is_file() for log in bench)
    arm = read_logs(Path(str(REAL)) / "so101")
    assert len(arm) == 14
    assert arm[0].joints == arm[0].actuators
    assert len(arm[0].joints) == 6
