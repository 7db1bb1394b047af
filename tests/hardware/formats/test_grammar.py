"""Logs as anybody writes them, drawn from a grammar: each is read right, or refused in a sentence.

A drawing chooses a motion and then how it is written: names, units, the clock's origin and unit,
lost readings, the columns' rates, what separates cells, how numbers are encoded. Names that others
use are mapped by what `convert` writes for them. Where nothing was chosen that only a person can
know, the log has to be read; whatever is refused names a row or a column, and a remedy.
"""

from __future__ import annotations

import datetime
import tempfile
import time
import tracemalloc
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hardware.errors import LogError
from hardware.formats.guess import write_guess
from hardware.log import Log, read_log

ROWS, STEP = 60, 0.02
TIME = np.arange(ROWS) * STEP
EARLY, LATE = 0.007, 0.01  # s into a step: a state, then the command
ORIGIN = 1768472890  # s since 1970
SECONDS, BYTES = 10.0, 2**30  # that a log may take
MOMENT = "sensor.moment"  # a column that tells the true time of a row
KINDS = ("ctrl", "qpos", "qvel")
UNITS = {"rad": 1.0, "deg": 180 / np.pi, "counts/4096": 4096 / (2 * np.pi)}
CLOCKS = ("s", "unix", "ms", "us", "ns", "iso", "sec,nanosec")
NAMES = {  # of a command, a position and a speed, as others write them
    "words": ("{joint}_cmd{unit}", "{joint}_pos{unit}", "{joint}_vel{unit}"),
    "letters": ("q_des_{joint}{unit}", "q_{joint}{unit}", "dq_{joint}{unit}"),
    "servos": ("goal_position_{number}", "present_position_{number}", "present_speed_{number}"),
    "topics": (
        "/joint_commands/{joint}/position",
        "/joint_states/{joint}/position",
        "/joint_states/{joint}/velocity",
    ),
    "data set": ("action.{joint}.pos", "observation.state.{joint}.pos", "{joint}.vel"),
}
SUFFIXES = {
    "rad": ("", "_rad"),
    "deg": ("", "_deg", " [deg]", "(degrees)"),
    "counts/4096": ("", "_raw", "_ticks"),
}
REMEDIES = (
    "write",
    "remove",
    "give",
    "repair",
    "correct",
    "map",
    "log it",
    "available",
    "choose one of",
    "expected",
    "needed",
)


class Drawn(NamedTuple):
    """How a log is written.

    Args:
        joints: names of its joints.
        clock: origin and unit of its time.
        unit: of commands and positions.
        names: "ours"; "any" that a columns.yaml tells; or a way of others (`NAMES`).
        suffix: what of the unit a name says.
        speeds: whether speeds are logged, too.
        headers: lines of names; other than one only where a columns.yaml tells them.
        separator: of cells.
        lost: rows whose first position is missing.
        word: what stands there.
        hole: a row whose command is missing; None for none.
        rates: every how many rows commands come, and positions; (1, 1): all in all rows.
        apart: whether commands and positions have rows of their own.
    """

    joints: tuple[str, ...]
    clock: str
    unit: str
    names: str
    suffix: str
    speeds: bool
    headers: int
    separator: str
    lost: frozenset[int]
    word: str
    hole: int | None
    rates: tuple[int, int]
    apart: bool

    def table(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the moments of the rows (T,) [s], and in which commands and positions come."""
        row = np.arange(ROWS)
        sent, read = (row % every == 0 for every in self.rates)
        if not self.apart:
            return TIME, sent, read
        no = np.zeros(ROWS, bool)
        time = np.ravel([TIME + EARLY, TIME + LATE], "F")  # first a state, then a command
        return time, np.ravel([no, sent], "F"), np.ravel([read, no], "F")

    def readings(self) -> np.ndarray:
        """Return in which rows the first joint was read, (T,) bool."""
        read = self.table()[2].copy()
        read[list(self.lost)] = False
        return read

    def called(self, number: int) -> str:
        """Return the name of a joint in the log that is read."""
        return f"joint{number}" if self.names == "servos" else self.joints[number]

    def columns(self, number: int) -> dict[str, str]:
        """Return what the command, position and speed of a joint are called here, by our names."""
        joint = self.joints[number]
        ours = [f"{kind}.{self.called(number)}" for kind in KINDS]
        if self.names not in NAMES:
            return dict(zip(ours, ours, strict=True))
        unit = self.suffix + "_s" * (self.suffix in ("_rad", "_deg"))
        own = [
            name.format(joint=joint, number=number, unit=unit if kind == "qvel" else self.suffix)
            for kind, name in zip(KINDS, NAMES[self.names], strict=True)
        ]
        return dict(zip(ours, own, strict=True))


@st.composite
def logs(draw: Any) -> Drawn:
    """Draw a way to write a log."""
    names, apart = draw(st.sampled_from(("ours", "any", *NAMES))), draw(st.booleans())
    unit = "rad" if names == "ours" else draw(st.sampled_from(list(UNITS)))
    rates = draw(st.one_of(st.just((1, 1)), st.tuples(st.integers(1, 5), st.integers(1, 5))))
    whole = rates == (1, 1) and not apart  # else a missing command is one that is held
    return Drawn(
        tuple(draw(st.lists(st.sampled_from("abcdef"), min_size=1, max_size=3, unique=True))),
        draw(st.sampled_from(CLOCKS)),
        unit,
        names,
        draw(st.sampled_from(SUFFIXES[unit])),
        draw(st.booleans()),
        draw(st.sampled_from((0, 1, 2))) if names == "any" else 1,
        draw(st.sampled_from(",;\t")),
        draw(st.frozensets(st.integers(0, ROWS - 1), max_size=ROWS // 3)),
        draw(st.sampled_from(("", "nan", "null", "NA"))),
        draw(st.one_of(st.none(), st.integers(0, ROWS - 1))) if whole else None,
        rates,
        apart,
    )


def motions(joint: str, time: np.ndarray = TIME) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return commands, positions [rad] and speeds [rad/s] of a joint at some moments, (T,) each."""
    phase = ord(joint)
    late = 3 * time + phase - 0.1
    return np.sin(3 * time + phase), 0.9 * np.sin(late), 2.7 * np.cos(late)


def clock(kind: str, time: np.ndarray = TIME) -> dict[str, list[Any]]:
    """Return the columns that tell the time."""
    whole = time + ORIGIN
    match kind:
        case "s":
            return {"time": time.tolist()}
        case "unix":
            return {"time": [f"{t:.6f}" for t in whole]}
        case "ms" | "us" | "ns":
            power = {"ms": 3, "us": 6, "ns": 9}[kind]
            return {"time": [round(t * 10**3) * 10 ** (power - 3) for t in whole.tolist()]}
        case "iso":
            start = datetime.datetime.fromtimestamp(ORIGIN, datetime.UTC)
            return {"time": [(start + datetime.timedelta(seconds=t)).isoformat() for t in time]}
    nanos = [round(1e9 * float(t)) for t in time]
    return {
        "sec": [ORIGIN + n // 10**9 for n in nanos],
        "nanosec": [n % 10**9 for n in nanos],
    }


def write(drawn: Drawn, folder: Path) -> Path:
    """Write a log, and its columns.yaml where nobody could guess it."""
    time, sent, read = drawn.table()
    columns: dict[str, list[Any]] = {"episode": [0] * len(time), **clock(drawn.clock, time)}
    columns[MOMENT] = time.tolist()
    units = {}
    for number, joint in enumerate(drawn.joints):
        first = number == 0
        holes = sent & (np.arange(len(time)) != drawn.hole) if first else sent
        readings = drawn.readings() if first else read
        for name, values, there in zip(
            drawn.columns(number), motions(joint, time), (holes, readings, readings), strict=True
        ):
            if name.startswith("qvel.") and not drawn.speeds:
                continue
            values = UNITS[drawn.unit] * values
            values = np.round(values) if drawn.unit.startswith("counts") else values
            columns[name] = np.where(there, values.astype(object), drawn.word).tolist()
            units[name] = drawn.unit + "/s" * name.startswith("qvel.")
    called = {k: v for number in range(len(drawn.joints)) for k, v in drawn.columns(number).items()}
    names = [called.get(name, name) for name in columns]
    heads = [names]
    if drawn.names == "any":
        sources = [f"x{i}" if drawn.headers else str(i) for i in range(len(names))]
        heads = [[], [sources], [["x"] * len(names), sources]][drawn.headers]
        sources = [f"x {name}" for name in sources] if drawn.headers == 2 else sources
        entries: dict[str, dict[str, Any]] = {
            name: {"from": source, **({"unit": units[name]} if name in units else {})}
            for name, source in zip(columns, sources, strict=True)
        }
        if "sec" in entries:
            entries["time"] = entries.pop("sec") | {"nanosec": entries.pop("nanosec")["from"]}
        (folder / "columns.yaml").write_text(yaml.safe_dump({"columns": entries}))
    rows = [*heads, *zip(*columns.values(), strict=True)]
    path = folder / "log.csv"
    path.write_text("\n".join(drawn.separator.join(map(str, row)) for row in rows) + "\n")
    return path


def let_guess(drawn: Drawn, path: Path) -> None:
    """Write the columns.yaml that a log is refused without; answer what it asks for."""
    with pytest.raises(LogError, match=r"convert LOG columns=columns\.yaml"):
        read_log(path)
    file = write_guess(path, path.with_name("columns.yaml"))
    tree = yaml.safe_load(file.read_text())
    asked = {name: e for name, e in tree["columns"].items() if e.get("unit") == "?"}
    if asked:
        assert drawn.unit != "rad"
        with pytest.raises(LogError, match=f"{next(iter(asked))}: the unit is not filled in yet"):
            read_log(path)
    for name, entry in asked.items():
        entry["unit"] = drawn.unit + "/s" * name.startswith("qvel.")
    tree["columns"][MOMENT] = {"from": MOMENT}
    file.write_text(yaml.safe_dump(tree))


def check(drawn: Drawn, log: Log) -> None:
    """Hold a log that was read against the motion that was written."""
    time, sent, _ = drawn.table()
    moment = log.column(MOMENT)
    assert np.allclose(log.time - log.time[0], moment - moment[0], atol=1e-6)
    assert set(time[sent & (time >= moment[0])].round(6)) <= set(moment.round(6))
    count = 2 * np.pi / 4096 if drawn.unit.startswith("counts") else 1e-5  # of stamps in µs
    called = [drawn.called(number) for number in range(len(drawn.joints))]
    assert set(log.joints) == set(called)
    for joint, name in zip(drawn.joints, called, strict=True):
        latest = time[sent][np.searchsorted(time[sent], moment + 1e-6) - 1]
        assert np.allclose(log.column(f"ctrl.{name}"), motions(joint, latest)[0], atol=count)
        stamp = moment + log.columns.get(f"stamp.{name}", log.time) - log.time
        for kind, right in zip(KINDS[1:], motions(joint, stamp)[1:], strict=True):
            if kind == "qpos" or drawn.speeds:
                read = log.column(f"{kind}.{name}")
                assert np.allclose(read[log.fresh], right[log.fresh], atol=count)
                assert np.isfinite(read).all()
    stamp = moment + log.columns.get(f"stamp.{called[0]}", log.time) - log.time
    stamps, there = set(stamp[log.fresh].round(4)), time[drawn.readings()].round(4)
    assert len(stamps) == log.fresh.sum()  # each reading in one row
    assert set(there[there >= moment[0].round(4)]) <= stamps <= set(there)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(logs())
def test_a_log_is_read_right_or_refused_in_a_sentence(drawn: Drawn) -> None:
    """Read where nothing is missing that nobody can guess; else row, column and remedy."""
    with tempfile.TemporaryDirectory() as folder:
        path = write(drawn, Path(folder))
        tracemalloc.start()
        began = time.monotonic()
        try:
            if drawn.names in NAMES:
                let_guess(drawn, path)
            log = read_log(path)
        except LogError as error:
            sentence = str(error)
            assert drawn.hole is not None
            assert f"row {drawn.hole}" in sentence and "column 'ctrl." in sentence
            assert any(word in sentence for word in REMEDIES) and "\n" not in sentence
        else:
            assert drawn.hole is None
            check(drawn, log)
        finally:
            assert time.monotonic() - began < SECONDS
            assert tracemalloc.get_traced_memory()[1] < BYTES
            tracemalloc.stop()
