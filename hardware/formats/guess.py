"""A first `columns.yaml` or `topics.yaml` for a log, from its header, for a person to read over.

    write_guess(Path("run.csv"), Path("columns.yaml"))

Names are matched against the words that such columns usually have. What was not recognized stands
in the file as a comment, so that nothing is lost without a word.
"""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from hardware.errors import LogError
from hardware.files import atomic_write
from hardware.formats import mapped, messages, parquet

WORDS = {  # column, and what others call it; the first that fits counts
    "time": r"t|time|timestamp|stamp|secs?|seconds",
    "episode": r"episode|episode_index|ep|run|trial|demo",
    "qvel": r"vel|velocity|velocities|speed|qvel|dq|qd|joint_vel",
    "current": r"current|amps?|curr",
    "voltage": r"voltage|volts?",
    "temperature": r"temp|temperature",
    "ctrl": r"cmd|command|commanded|goal|target|desired|des|setpoint|ref|reference|actions?|ctrl",
    "qpos": r"pos|position|positions|angle|q|qpos|actual|measured|meas|state|joint_pos",
}  # fmt: skip
UNIT = re.compile(
    r"[_\s\[(](deg|rad|ms|us|ns|s|ma|a|mv|v|rpm|rad/s|deg/s|°c)[\])]?$", re.IGNORECASE
)
SPELLED = {unit.lower(): unit for unit in ("mA", "A", "mV", "V", "°C")}
STATE = "sensor_msgs/msg/JointState"


def write_guess(log: Path, path: Path) -> Path:
    """Write a mapping for a log, whole or not at all, and return its path.

    Args:
        log: a CSV, Parquet, HDF5 or Zarr file, an MCAP file or a rosbag2 folder.
        path: where the mapping goes.

    Raises:
        LogError: there is a file already, or the log is of another kind.
    """
    if path.exists():
        raise LogError(f"{path}: there is such a file already; remove it, or name another")
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
    unit = UNIT.search(name)
    bare = UNIT.sub("", name) if unit else name
    parts = [part for part in re.split(r"[\s_./:\-\[\]()]+", bare.strip().lower()) if part]
    spelled = None if unit is None else SPELLED.get(unit[1].lower(), unit[1].lower())
    for column, words in WORDS.items():
        hits = [i for i, part in enumerate(parts) if re.fullmatch(words, part)]
        if not hits:
            continue
        joint = "_".join(p for p in parts if not re.fullmatch("|".join(WORDS.values()), p))
        if column in ("time", "episode"):
            if not joint:
                return column, spelled
            continue
        return f"{column}.{joint or 'joint'}", spelled
    return None


def _columns(log: Path) -> str:
    """Return a columns.yaml for a table or a file of arrays."""
    columns: dict[str, dict[str, object]] = {}
    rest = []
    for name, width in _names(log):
        found = guess(name)
        if found is None or (width == 1 and found[0] in columns):
            rest.append(f"{name} ({width} numbers)" if width > 1 else name)
            continue
        column, unit = found
        for i in range(width):
            entry: dict[str, object] = {"from": name, **({"unit": unit} if unit else {})}
            key = column if width == 1 else f"{column.partition('.')[0]}.joint{i}"
            columns[key] = entry | ({"index": i} if width > 1 else {})
    lines = [
        f"# which column of {log.name} is what; check names, units and signs (docs/logs.md)",
        *(f"# not recognized: {name}" for name in rest),
    ]
    tree: dict[str, object] = {"columns": columns}
    if "time" not in columns:
        tree["rate"] = 50
        lines.append("# no time was recognized: `rate` [Hz] is an example")
    return "\n".join(lines) + "\n" + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)


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
    lines = [f"# which topic of {log.name} is what; check them (docs/logs.md). It has:"]
    lines += [f"#   {topic}: {kind}" for topic, kind in sorted(there.items())]
    return "\n".join(lines) + "\n" + yaml.safe_dump({"channels": channels}, sort_keys=False)


def _channel(topic: str, field: str, to: str) -> dict[str, object]:
    return {"topic": topic, "field": field, "names": "name", "to": to}
