"""What a reader mends: any clock, lost readings, angles that wrap; and what it refuses to guess."""

import datetime
from pathlib import Path

import numpy as np
import pytest

from hardware.errors import LogError
from hardware.log import READING, Log, read_log, write_log

TIME = np.arange(200) * 0.02
SWING = 1.2 + 0.6 * np.sin(2 * TIME)
NOW = 1768472890.5  # s since 1970


def csv(
    folder: Path, time: list | np.ndarray, q: list | np.ndarray = SWING, **more: list | None
) -> Path:
    """Write a log of one joint whose cells are written as they are given."""
    columns = {"episode": [0] * 200, "time": time, "ctrl.a": SWING, "qpos.a": q, **more}
    columns = {name: values for name, values in columns.items() if values is not None}
    rows = zip(*(list(values) for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def iso(number: float) -> str:
    """Return a moment as ISO 8601."""
    moment = datetime.datetime.fromtimestamp(NOW, datetime.UTC)
    return (moment + datetime.timedelta(seconds=float(number))).isoformat()


@pytest.mark.parametrize(
    ("time", "told"),
    [
        (TIME + 3.5, None),
        (TIME + NOW, None),
        (1e3 * (TIME + NOW), "milliseconds"),
        (np.round(1e6 * (TIME + NOW)), "microseconds"),
        (np.round(1e9 * TIME) + 1e18, "nanoseconds"),
        (1e3 * TIME, "milliseconds"),
        ([iso(t) for t in TIME], None),
        ([iso(t).replace("T", " ").removesuffix("+00:00") for t in TIME], None),
        ([iso(t).replace("+00:00", "Z") for t in TIME], None),
    ],
    ids=["later", "unix", "ms", "us", "ns", "ms from 0", "iso", "pandas", "zulu"],
)
def test_time_may_have_any_origin_and_unit(tmp_path, time: list | np.ndarray, told) -> None:
    """It counts seconds from the episode's start; what was guessed is said."""
    log = read_log(csv(tmp_path, time))
    assert log.time == pytest.approx(TIME, abs=2e-6)
    assert (READING in log.meta) == (told is not None)
    assert told is None or told in log.meta[READING][0]


def test_a_log_that_begins_shortly_after_its_episode_is_left_alone(tmp_path: Path) -> None:
    """The first row of a robot's own log is written a moment after the episode's start."""
    assert read_log(csv(tmp_path, TIME + 0.0203)).time[0] == 0.0203


def test_rows_without_a_column_of_episodes_are_one(tmp_path: Path) -> None:
    """With a note; a column whose name comes near is asked about instead."""
    log = read_log(csv(tmp_path, TIME, episode=None))
    assert (log.episode == 0).all() and "one episode" in log.meta[READING][0]
    with pytest.raises(LogError, match="did you mean 'episodes'"):
        read_log(csv(tmp_path, TIME, episode=None, episodes=[0] * 200))


def test_each_episode_has_its_own_start(tmp_path: Path) -> None:
    """Stamps move with the time."""
    episode = np.repeat([0, 1], 100)
    columns = {"episode": episode, "time": TIME + NOW, "stamp.a": TIME + NOW - 0.005}
    path = write_log(
        tmp_path / "log.csv", Log({**columns, "ctrl.a": SWING, "qpos.a": SWING}, {"robot": "r"})
    )
    for part in read_log(path).episodes():
        assert part.time == pytest.approx(TIME[:100], abs=1e-6)
        assert part.column("stamp.a") == pytest.approx(TIME[:100] - 0.005, abs=1e-6)


def test_seconds_and_nanoseconds_are_one_clock(tmp_path: Path) -> None:
    """As ROS 2 messages have them; without the nanoseconds rows would repeat."""
    whole = TIME + 0.77
    sec = [int(t) + 1768472890 for t in whole]
    nanosec = [round(1e9 * (t % 1)) for t in whole]
    path = csv(tmp_path, None, sec=sec, nanosec=nanosec)  # type: ignore[arg-type]
    assert read_log(path).time == pytest.approx(TIME, abs=1e-9)


@pytest.mark.parametrize("word", ["", "nan", "NaN", "null", "NA"])
def test_a_lost_reading_is_left_out_of_comparisons(tmp_path: Path, word: str) -> None:
    """It gets a number between its neighbours, its row is not fresh, and it is counted."""
    q: list = SWING.tolist()
    q[50] = q[51] = word
    log = read_log(csv(tmp_path, TIME, q))
    assert np.flatnonzero(log.column("flag.fresh") == 0).tolist() == [50, 51]
    assert log.column("qpos.a") == pytest.approx(SWING, abs=1e-3)
    assert log.meta[READING] == [
        "qpos.a: 2 readings are missing",
        "2 of 200 rows are left out of comparisons (flag.fresh = 0)",
    ]


def test_other_lost_readings_leave_the_row_as_it_is(tmp_path: Path) -> None:
    """A speed or a current that is missing takes no position out."""
    current: list = [0.5] * 200
    current[3] = ""
    log = read_log(csv(tmp_path, TIME, **{"current.a": current}))
    assert "flag.fresh" not in log.columns
    assert log.column("current.a")[3] == 0.5


@pytest.mark.parametrize(
    ("column", "cells", "sentence"),
    [
        ("ctrl.a", {7: ""}, r"row 7 \(line 9\), column 'ctrl.a': a command is missing"),
        ("time", {7: ""}, r"row 7 \(line 9\), column 'time': the time is missing"),
        ("qpos.a", dict.fromkeys(range(200), ""), r"column 'qpos.a': no number in it"),
        ("qpos.a", dict.fromkeys(range(0, 200, 1), "x"), r"row 0 .*'x' is not a number"),
    ],
)
def test_what_cannot_be_left_out_is_refused(tmp_path, column: str, cells, sentence) -> None:
    """With row, column and what to do."""
    columns: dict[str, list] = {"time": TIME.tolist(), "qpos.a": SWING.tolist()}
    columns["ctrl.a"] = SWING.tolist()
    for row, cell in cells.items():
        columns[column][row] = cell
    given = {"ctrl.a": columns["ctrl.a"]}
    with pytest.raises(LogError, match=sentence):
        read_log(csv(tmp_path, columns["time"], columns["qpos.a"], **given))


@pytest.mark.parametrize("value", [0.0, 2.0**32, -1.0e6, 65535.0])
@pytest.mark.parametrize("first", [0, 60, 192], ids=["begin", "middle", "end"])
def test_a_constant_of_a_silent_bus_is_no_position(tmp_path, value: float, first: int) -> None:
    """Eight rows of it are left out, wherever they stand."""
    q = SWING.copy()
    q[first : first + 8] = value
    log = read_log(csv(tmp_path, TIME, q))
    assert np.flatnonzero(log.column("flag.fresh") == 0).tolist() == [*range(first, first + 8)]
    assert log.column("qpos.a") == pytest.approx(SWING, abs=0.2)
    assert "8 readings are constant where it jumps" in log.meta[READING][0]


def test_a_frozen_reading_is_left_out(tmp_path: Path) -> None:
    """The joint swings by 0.9 rad meanwhile, which it cannot do in one row."""
    q = SWING.copy()
    q[70:95] = q[70]
    log = read_log(csv(tmp_path, TIME, q))
    assert np.flatnonzero(log.column("flag.fresh") == 0).tolist() == [*range(71, 95)]


def test_motions_of_a_robot_are_left_alone(tmp_path: Path) -> None:
    """Steps, rests, stick and slip, noise, and a turn that stays."""
    rng = np.random.default_rng(0)
    steps = np.cumsum(rng.integers(0, 2, 200) * (rng.random(200) < 0.1)) * 0.25
    slip = np.round(0.3 * np.sin(TIME) / 0.05) * 0.05
    jump = SWING + 2 * np.pi * (TIME >= 2)
    for q in (steps, slip, jump, 0.01 * rng.normal(size=200), np.zeros(200)):
        log = read_log(csv(tmp_path, TIME, q))
        assert "flag.fresh" not in log.columns
        assert np.array_equal(log.column("qpos.a"), q)


def test_a_wrapped_angle_is_made_continuous(tmp_path: Path) -> None:
    """With the command of the joint."""
    turning = 3.0 + 0.8 * np.sin(2 * TIME)
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    log = read_log(csv(tmp_path, TIME, wrapped, **{"ctrl.a": wrapped.tolist()}))
    for name in ("qpos.a", "ctrl.a"):
        assert log.column(name) == pytest.approx(turning)
    assert log.meta[READING] == ["qpos.a: the angle is wrapped to one turn and was made continuous"]


def test_named_episodes_are_counted(tmp_path: Path) -> None:
    """`ep_0` is the first one."""
    path = csv(tmp_path, np.tile(TIME[:100], 2))
    text = path.read_text().split("\n")
    lines = [text[0], *(f"ep_{i // 100}{line[1:]}" for i, line in enumerate(text[1:201]))]
    path.write_text("\n".join(lines) + "\n")
    assert read_log(path).episode.tolist() == [0] * 100 + [1] * 100


def test_parquet_has_dates_and_gaps_too(tmp_path: Path) -> None:
    """As pandas writes them."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    start = datetime.datetime(2026, 1, 15, 10)
    time = [start + datetime.timedelta(seconds=float(t)) for t in TIME]
    q: list = SWING.tolist()
    q[9] = None
    pq.write_table(
        pa.table({"episode": [0] * 200, "time": time, "ctrl.a": SWING, "qpos.a": q}),
        tmp_path / "log.parquet",
    )
    log = read_log(tmp_path / "log.parquet")
    assert log.time == pytest.approx(TIME, abs=1e-6)
    assert log.column("flag.fresh")[9] == 0
