"""Tables whose columns arrive at moments of their own become rows of a log, as they were."""

from pathlib import Path

import numpy as np
import pytest

from hardware.errors import LogError
from hardware.formats.rates import align, merge, of_several_rates
from hardware.log import READING, Log, read_log


def moving(time: np.ndarray) -> np.ndarray:
    """Return where the joint is [rad]."""
    return 0.8 * np.sin(2 * time)


def table(
    folder: Path, sent: np.ndarray, read: np.ndarray, **more: tuple[np.ndarray, np.ndarray]
) -> Log:
    """Return the log that is read from a CSV with a row for each message."""
    series = {"ctrl.a": (sent, np.round(sent, 6)), "qpos.a": (read, moving(read))}
    columns = merge(series | {name.replace("_", "."): pair for name, pair in more.items()})
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    cells = [",".join("" if np.isnan(x) else repr(x) for x in row) for row in rows]
    path = folder / "log.csv"
    path.write_text("\n".join([",".join(columns), *cells]) + "\n")
    return read_log(path)


def every(step: float, count: int, late: float = 0.0) -> np.ndarray:
    """Return moments, (count,) [s]."""
    return np.round(late + step * np.arange(count), 6)


def test_messages_of_one_rate_become_rows_of_commands(tmp_path: Path) -> None:
    """A position that came before its command stands in its row, with its stamp."""
    sent, read = every(0.02, 50, 0.01), every(0.02, 50, 0.007)
    log = table(tmp_path, sent, read)
    assert np.array_equal(log.time, sent) and np.array_equal(log.column("stamp.a"), read)
    assert np.array_equal(log.column("qpos.a"), moving(read)) and log.fresh.all()
    assert log.meta[READING][0].startswith(
        "the columns arrive at moments of their own (ctrl.a, qpos.a at 50 of 100): "
    )
    assert log.meta[READING][1:] == ["1 row before the first ctrl.a is left out"]


def test_positions_that_come_more_often_keep_rows_of_their_own(tmp_path: Path) -> None:
    """Commands hold in them; none of the readings is lost."""
    sent, read = every(0.04, 25), every(0.01, 100)
    log = table(tmp_path, sent, read)
    assert np.array_equal(log.time, read) and "stamp.a" not in log.columns and log.fresh.all()
    assert np.array_equal(log.column("ctrl.a"), np.repeat(sent, 4))
    assert np.array_equal(log.column("qpos.a"), moving(read))


def test_positions_that_come_less_often_are_compared_once(tmp_path: Path) -> None:
    """Rows between two readings have a number between them and do not count."""
    sent, read = every(0.01, 100), every(0.05, 20)
    log = table(tmp_path, sent, read)
    assert np.array_equal(log.time, sent)
    assert np.array_equal(log.time[log.fresh], read)
    assert np.array_equal(log.column("qpos.a")[log.fresh], moving(read))
    assert np.abs(log.column("qpos.a") - moving(log.time))[:-5].max() < 2e-3
    assert "80 of 100 rows have no new reading (flag.fresh = 0)" in log.meta[READING]


def test_a_goal_that_is_sent_once_keeps_its_moment(tmp_path: Path) -> None:
    """However seldom commands come: a row for each, and all readings between."""
    sent, read = every(0.503, 4), every(0.01, 200)
    log = table(tmp_path, sent, read)
    assert set(sent) <= set(log.time) and int(log.fresh.sum()) == len(read)
    begin = [int(np.searchsorted(log.time, moment)) for moment in sent]
    assert [float(log.column("ctrl.a")[row]) for row in begin] == sent.tolist()
    assert float(log.column("ctrl.a")[begin[1] - 1]) == sent[0]


def test_joints_that_are_read_in_turn_are_one_reading(tmp_path: Path) -> None:
    """A row counts once every joint was read anew; each has its own stamp."""
    sent, a, b = every(0.02, 50, 0.01), every(0.04, 25), every(0.04, 25, 0.02)
    log = table(tmp_path, sent, a, qpos_b=(b, moving(b)), ctrl_b=(sent, sent))
    assert log.fresh.sum() == 25
    assert np.array_equal(log.column("stamp.a")[log.fresh], a)
    assert np.array_equal(log.column("stamp.b")[log.fresh], b)
    for joint in "ab":
        assert (np.diff(log.column(f"stamp.{joint}")) >= 0).all()
        read = log.column(f"stamp.{joint}")
        assert np.abs(log.column(f"qpos.{joint}") - moving(read)).max() < 2e-3


def test_other_columns_are_the_latest_and_speeds_those_of_the_reading(tmp_path: Path) -> None:
    """A temperature once a second, a speed on a clock of its own."""
    sent, read, warm = every(0.02, 100, 0.01), every(0.02, 100, 0.005), every(1.0, 2)
    speed = (every(0.004, 500), 1.6 * np.cos(2 * every(0.004, 500)))
    log = table(tmp_path, sent, read, temperature_a=(warm, warm + 30), qvel_a=speed)
    assert set(log.column("temperature.a")) == {30.0, 31.0}
    assert log.column("qvel.a") == pytest.approx(1.6 * np.cos(2 * log.column("stamp.a")), abs=1e-4)


def test_readings_that_wrap_between_messages_are_continuous(tmp_path: Path) -> None:
    """Before anything is put between them."""
    sent, read = every(0.01, 300), every(0.03, 100)
    series = {"ctrl.a": (sent, sent), "qpos.a": (read, (read + 2 + np.pi) % (2 * np.pi) - np.pi)}
    columns = merge(series)
    lines = zip(*(values.tolist() for values in columns.values()), strict=True)
    cells = [",".join(map(repr, row)) for row in lines]
    (tmp_path / "log.csv").write_text("\n".join([",".join(columns), *cells]) + "\n")
    assert read_log(tmp_path / "log.csv").column("qpos.a")[:-2] == pytest.approx(sent[:-2] + 2)


@pytest.mark.parametrize("faster", [2, 3, 5, 7])
@pytest.mark.parametrize("slower", [1, 2, 3, 4])
def test_any_two_rates_are_told_from_lost_readings(faster: int, slower: int) -> None:
    """The slower of two is missing in half of the rows, where stamps coincide and where not."""
    if faster <= slower:
        return
    for late in (0.0, 0.001):
        fast, slow = every(0.1 / faster, 40 * faster), every(0.1 / slower, 40 * slower, late)
        for sent, read in ((fast, slow), (slow, fast)):
            assert of_several_rates(merge({"ctrl.a": (sent, sent), "qpos.a": (read, read)}))
    lost = np.arange(100) % 3 == 0
    q = np.where(lost, np.nan, 1.0)
    assert not of_several_rates({"ctrl.a": np.ones(100), "qpos.a": q})


@pytest.mark.parametrize(
    ("cells", "sentence"),
    [
        (["0,0,1,", "0,0.1,,1", "0,0,1,", "0,0.1,,1"], r"row 2 \(line 4\), column 'ctrl.a': time "),
        (
            ["0,0,1,", "0,0.1,,1", "0,0.2,,1", "1,0,1,", "1,1,1,"],
            r"'qpos.a': episode 1 has no number in it; remove the episode",
        ),
        (["0,0,1,", "0,0.1,,1"], r"episode 0 has 1 commands and readings after"),
    ],
)
def test_what_cannot_be_told_is_refused(tmp_path: Path, cells: list, sentence: str) -> None:
    """Two recordings one after the other, an episode without positions, one that is too short."""
    (tmp_path / "log.csv").write_text("\n".join(["episode,time,ctrl.a,qpos.a", *cells]) + "\n")
    with pytest.raises(LogError, match=sentence):
        read_log(tmp_path / "log.csv")


def test_ten_minutes_at_a_thousand_a_second_take_a_moment() -> None:
    """Joints that are read at moments of their own are the slow case."""
    sent = every(0.001, 100_000)
    series = {f"qpos.{i}": (sent + 1e-4 * i, sent) for i in range(3)}
    columns, _ = align(merge(series | {"ctrl.0": (sent, sent)}), "log.csv")
    assert len(columns["time"]) >= 99_999
