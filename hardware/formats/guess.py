"""A first `columns.yaml` or `topics.yaml` for a log, from its header, for a person to read over.

    write_guess(Path("run.csv"), Path("columns.yaml"))

Names are matched against the words that such columns usually have. What was not recognized stands
in the file as a comment, so that nothing is lost without a word.
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import yaml

from hardware.errors import LogError
from hardware.files import atomic_write
from hardware.formats import cells, mapped, messages, parquet
from hardware.formats.units import ASKED, PER_SECOND, TAKES, TURN, UNITS

WORDS = {  # column, and what others call it; the first that fits counts
    "time": r"t|time|timestamp|stamp|secs?|seconds",
    "episode": r"episode|episode_index|ep|run|trial|demo",
    "ctrl": r"cmd|commands?|commanded|goal|target|desired|des|setpoint|ref|reference|actions?|ctrl",
    "qvel": r"vel|velocity|velocities|speed|qvel|dq|qd|joint_vel",
    "current": r"current|amps?|curr",
    "voltage": r"voltage|volts?",
    "temperature": r"temp|temperature",
    "qpos": r"pos|position|positions|angle|q|qpos|actual|measured|meas|state|joint_pos",
}  # fmt: skip
NANOSEC = r"nanosec|nanosecs|nsecs?|nanoseconds"
EFFORT = r"effort|torque|tau|load|pwm|duty"
SAID = r"present|states|observation|header|kp|kd"  # words that name no joint
EVERY = "|".join((*WORDS.values(), EFFORT, SAID))
SPELLINGS = {  # of units in names, as the words of one
    "rad s": "rad/s",
    "rad per s": "rad/s",
    "rad per sec": "rad/s",
    "radps": "rad/s",
    "deg s": "deg/s",
    "deg per s": "deg/s",
    "deg per sec": "deg/s",
    "degps": "deg/s",
    "dps": "deg/s",
    "m s": "m/s",
    "mm s": "mm/s",
    "degrees": "deg",
    "degree": "deg",
    "radians": "rad",
    "sec": "s",
    "msec": "ms",
    "usec": "us",
    "nsec": "ns",
    "ticks": ASKED,
    "raw": ASKED,
    "counts": ASKED,
    "pct": ASKED,
    "percent": ASKED,
}
SPELLINGS |= {" ".join(re.split(r"[/\s]", u.lower())): u for d in UNITS.values() for u in d}
KINDS = ("ctrl", "qpos")  # that every log has
LONGEST = 3  # words of a unit
COUNTED = 10.0  # whole numbers up to more than this are counts
QUICK = 40.0  # rad/s: faster is another unit
STATE = "sensor_msgs/msg/JointState"


def write_guess(log: Path, path: Path) -> Path:
    """Write a mapping for a log atomically, and return its path.

    Args:
        log: a CSV, Parquet, HDF5 or Zarr file, an MCAP file or a rosbag2 folder.
        path: where the mapping goes.

    Raises:
        LogError: there is a file already, or the log is of another kind.
    """
    if path.exists():
        raise LogError(f"{path}: the file exists; remove it, or choose another name")
    if messages.is_log(log):
        text = _topics(log)
    elif log.suffix.lower() in (*mapped.TABLES, *mapped.ARRAYS):
        text = _columns(log)
    else:
        raise LogError(f"{log}: only tables, arrays and recordings of messages need a mapping")
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def guess(name: str) -> tuple[str, str | None] | None:
    """Return the column that a source's name means, and its unit if the name says it; or None."""
    parts = _words(name)
    topic = name.startswith("/") and name.count("/") > 2  # /joint_states/elbow/position
    for size in range(min(LONGEST, len(parts) - 1), -1, -1):
        unit = SPELLINGS.get(" ".join(parts[len(parts) - size :]).lower()) if size else None
        if size and unit is None:
            continue
        column = _column(parts[: len(parts) - size])
        if column is None:
            continue
        if not _fits(unit, column):
            unit = f"{unit}{PER_SECOND}"  # `vel_deg`
            if not _fits(unit, column):
                continue
        if column in ("time", "episode"):
            return column, unit
        left = _words(name.split("/")[-2]) if topic else parts[: len(parts) - size]
        joint = "_".join(part for part in left if not re.fullmatch(EVERY, part.lower()))
        return f"{column}.{'joint' + joint if joint.isdigit() or not joint else joint}", unit
    return None


def _words(name: str) -> list[str]:
    """Return the words of a name; `dq1` is `dq` and `1`."""
    found: list[str] = []
    for part in re.split(r"[\s_./:\-\[\]()]+", name.strip()):
        word = re.fullmatch(rf"({EVERY})(\d+)", part, re.IGNORECASE)
        found += word.groups()[:1] + word.groups()[-1:] if word else [part]
    return [part for part in found if part]


def _column(parts: list[str]) -> str | None:
    """Return the kind of column that words mean; None where there is none, or they are unclear."""
    parts = [part.lower() for part in parts]
    kinds = [k for k, words in WORDS.items() if any(re.fullmatch(words, part) for part in parts)]
    if any(re.fullmatch(EFFORT, part) for part in parts):
        return None
    if kinds[:1] in (["time"], ["episode"]):
        whole = all(re.fullmatch(EVERY, part) for part in parts)
        return kinds[0] if whole and len(kinds) == 1 else _column_of(kinds[1:])
    return _column_of(kinds)


def _column_of(kinds: list[str]) -> str | None:
    """Return the first of kinds; a command of a speed is none that one can be sure of."""
    return None if not kinds or {"ctrl", "qvel"} <= set(kinds) else kinds[0]


def _fits(unit: str | None, column: str) -> bool:
    """Return whether a column's kind takes a unit."""
    if unit in (None, ASKED):
        return unit is None or column in ("ctrl", "qpos", "qvel")
    dimensions = {name for name, units in UNITS.items() if unit in units}
    return not dimensions.isdisjoint(TAKES.get(column, ()))


def _columns(log: Path) -> str:
    """Return a columns.yaml for a table or a file of arrays."""
    columns: dict[str, dict[str, object]] = {}
    rest, words = [], []
    for name, width in _names(log):
        found = guess(name)
        if re.fullmatch(NANOSEC, (_words(name) or [""])[-1].lower()) and "time" in columns:
            columns["time"]["nanosec"] = name
            continue
        if found is None or (width == 1 and found[0] in columns):
            rest.append(f"{name} ({width} numbers)" if width > 1 else name)
            continue
        column, unit = found
        for i in range(width):
            entry: dict[str, object] = {"from": name, **({"unit": unit} if unit else {})}
            key = column if width == 1 else f"{column.partition('.')[0]}.joint{i}"
            columns[key] = entry | ({"index": i} if width > 1 else {})
    words += _ask_units(columns, _values(log))
    lines = [
        f"# columns of {log.name}: check names, units and signs (docs/how-to/prepare_logs.md)",
        *(f"# not recognized: {name}" for name in rest),
        *(f"# {text}" for text in (*words, *_missing(columns))),
    ]
    tree: dict[str, object] = {"columns": columns}
    if "time" not in columns:
        tree["rate"] = ASKED
        lines.append("# no time was recognized: map `time`, or give the `rate` [Hz] of the rows")
    return "\n".join(lines) + "\n" + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)


def _ask_units(
    columns: dict[str, dict[str, object]], values: Mapping[str, np.ndarray]
) -> Iterator[str]:
    """Put `?` where numbers can be in no SI unit, and yield what they look like."""
    for column, entry in columns.items():
        kind = column.partition(".")[0]
        numbers = values.get(str(entry["from"]), np.zeros(0))
        if kind not in ("ctrl", "qpos", "qvel") or entry.get("unit", ASKED) != ASKED:
            continue
        if not numbers.size:
            continue
        low, high = float(numbers.min()), float(numbers.max())
        most, whole = max(abs(low), abs(high)), bool((numbers == np.round(numbers)).all())
        spread = f"{column}: the numbers of {entry['from']} run from {low:.6g} to {high:.6g}"
        if whole and most > COUNTED:
            entry["unit"] = ASKED
            size = 2 ** max(math.ceil(math.log2(most + 1)), 10)
            yield f"{spread}, all whole: counts? then `unit: counts/{size}`, and `zero` in counts"
        elif most > (QUICK if kind == "qvel" else TURN):
            entry["unit"] = ASKED
            yield f"{spread}: deg, counts, or per cent of a range? give `unit`, or a `scale` to SI"
        elif entry.get("unit") == ASKED:
            yield f"{spread}: in which unit?"


def _missing(columns: Mapping[str, object]) -> Iterator[str]:
    """Yield what a log still needs."""
    for kind, what in (("ctrl", "the command"), ("qpos", "the position")):
        if not any(name.startswith(f"{kind}.") for name in columns):
            yield f"missing: {what} of a joint, `{kind}.<joint>`"
    joints = {kind: {n[5:] for n in columns if n.startswith(f"{kind}.")} for kind in KINDS}
    for kind, other in (KINDS, KINDS[::-1]):
        for joint in sorted(joints[other] - joints[kind] if joints[kind] else ()):
            yield f"missing: `{kind}.{joint}` for `{other}.{joint}`, or the names differ"


def _values(log: Path) -> dict[str, np.ndarray]:
    """Return the numbers of a table's columns, (T,); those of columns of text are left out."""
    if log.suffix.lower() == ".csv":
        table: Mapping[str, list] = mapped.csv_columns(log)
    elif log.suffix.lower() == ".parquet":
        arrow = parquet.read_table(log)
        table = {name: arrow[name].to_pylist() for name in arrow.column_names}
    else:
        return {}
    found = {}
    for name, column in table.items():
        try:
            numbers = cells.numbers(column, name)
        except LogError:
            continue
        found[name] = numbers[np.isfinite(numbers)]
    return found


def _names(log: Path) -> list[tuple[str, int]]:
    """Return the names in a file, and how many numbers a row each has."""
    if log.suffix.lower() == ".csv":
        return [(name, 1) for name in mapped.header(log)]
    if log.suffix.lower() == ".parquet":
        table = parquet.read_table(log)
        first = {name: table[name][0].as_py() for name in table.column_names if table.num_rows}
        return [(n, len(value) if isinstance(value, list) else 1) for n, value in first.items()]
    shapes = mapped.arrays_of(log, None)
    return [(name, shape[1] if len(shape) == 2 else 1) for name, shape in shapes if len(shape) <= 2]


def _topics(log: Path) -> str:
    """Return a topics.yaml for a recording of messages."""
    there = messages.topics(log)
    channels: list[dict[str, object]] = []
    for topic, kind in sorted(there.items()):
        if kind != STATE:
            continue
        if re.search(WORDS["ctrl"].replace("|", "|.*"), topic.rpartition("/")[2]):
            channels.insert(0, _channel(topic, "position", "ctrl"))
        else:
            channels += [_channel(topic, "position", "qpos"), _channel(topic, "velocity", "qvel")]
    if not any(channel["to"] == "ctrl" for channel in channels):
        example = {"topic": "/joint_commands", "field": "data", "names": ["joint"], "to": "ctrl"}
        channels.insert(0, example)
    lines = [f"# topics of {log.name}: check them (docs/how-to/prepare_logs.md). It has:"]
    lines += [f"#   {topic}: {kind}" for topic, kind in sorted(there.items())]
    return "\n".join(lines) + "\n" + yaml.safe_dump({"channels": channels}, sort_keys=False)


def _channel(topic: str, field: str, to: str) -> dict[str, object]:
    return {"topic": topic, "field": field, "names": "name", "to": to}
