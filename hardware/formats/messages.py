"""Recordings of messages as logs: MCAP files and rosbag2 folders, each channel on its own clock.

    # topics.yaml, next to the recording (or in it, for a folder; or NAME.topics.yaml)
    channels:
      - {topic: /joint_commands, field: data, names: [pan, lift], to: ctrl}
      - {topic: /joint_states, field: position, names: name, to: qpos}
      - {topic: /joint_states, field: velocity, names: name, to: qvel}
    joints: {pan_joint: pan}     # names in the messages, and in the model
    stamp: header                # `header` (header.stamp, the default) or `log` (the recorder's)
    gap: 1.0                     # s without a command after which another episode begins
    meta: {model: arm.xml}

`field` is the list of numbers in a message (or one number), with dots into nested messages;
`names` its joints, a list or the field that holds them; `to` the column's kind. A row is a message
of a `ctrl` channel, or a reading between two of them (`hardware.formats.rates`).

Needs the extra `ros` (mcap, mcap-ros2-support, rosbags).
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hardware.errors import LogError, did_you_mean, format_names
from hardware.formats.names import KINDS, READING, SOURCE_UNITS, check_sources
from hardware.formats.rates import Series, align, merge
from hardware.formats.sidecar import read_meta
from hardware.formats.units import PLAIN, factor

NAME = "topics.yaml"
KEYS = ("channels", "joints", "stamp", "gap", "meta")
CHANNEL = ("topic", "field", "names", "to", "unit", "scale")
GAP = 1.0  # s: commands of one motion come more often; a person needs longer to start the next
NANOS = 10**9  # in a second


def is_log(path: Path) -> bool:
    """Say whether a path is an MCAP file, or a folder that rosbag2 wrote."""
    return path.suffix == ".mcap" or (path.is_dir() and (path / "metadata.yaml").is_file())


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns of a recording, (T,) each, and its metadata.

    Raises:
        LogError: no topics.yaml, or one that does not fit; the message lists the topics.
    """
    file = topics_file(path)
    if file is None:
        there = "; ".join(f"{t} ({kind})" for t, kind in sorted(topics(path).items())) or "none"
        raise LogError(
            f"{path}: a {NAME} next to it must map its topics "
            f"(`sim2real convert {path.name} columns={NAME}` writes one); it has: {there}"
        )
    tree = _checked(file)
    series, units = _series(path, file, tree)
    columns, notes = _rows(path, file, tree, series)
    meta = {**tree.get("meta", {}), **read_meta(path.with_suffix(".json"))}
    meta |= {SOURCE_UNITS: units} if units else {}
    return columns, {"source": "messages", READING: notes, **meta}


def topics_file(path: Path) -> Path | None:
    """Return the topics.yaml that goes with a recording."""
    places = (path.with_name(f"{path.stem}.{NAME}"), path / NAME, path.parent / NAME)
    return next((place for place in places if place.is_file()), None)


def topics(path: Path) -> dict[str, str]:
    """Return the topics of a recording and their messages' types."""
    if path.is_dir():
        with _bag(path) as bag:
            return {c.topic: str(c.msgtype) for c in bag.connections}
    reader = _mcap(path)
    with path.open("rb") as stream:
        summary = reader(stream).get_summary()
        channels = summary.channels.values() if summary else []
        names = {c.topic: summary.schemas.get(c.schema_id) for c in channels} if summary else {}
    return {topic: schema.name if schema else "?" for topic, schema in names.items()}


def messages(path: Path, wanted: Iterable[str]) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time of recording [ns] and message, in the order in which they were recorded."""
    wanted = set(wanted)
    if path.is_dir():
        with _bag(path) as bag:
            chosen = [c for c in bag.connections if c.topic in wanted]
            for connection, stamp, raw in bag.messages(connections=chosen):
                message = bag.deserialize(raw, connection.msgtype)
                yield connection.topic, stamp, message
        return
    from mcap.exceptions import McapError
    from mcap_ros2.decoder import DecoderFactory

    from hardware.formats.json_messages import JsonFactory

    reader = _mcap(path)
    with path.open("rb") as stream:
        made = reader(stream, decoder_factories=[DecoderFactory(), JsonFactory()])
        try:
            for _, channel, record, message in made.iter_decoded_messages(topics=list(wanted)):
                yield channel.topic, record.log_time, message
        except McapError as error:
            raise LogError(f"{path}: cannot be read as MCAP: {error}") from None


def _mcap(path: Path) -> Any:
    if find_spec("mcap") is None or find_spec("mcap_ros2") is None:
        raise LogError(f"{path}: MCAP needs mcap and mcap-ros2-support; install the extra 'ros'")
    from mcap.reader import make_reader

    return make_reader


def _bag(path: Path) -> Any:
    if find_spec("rosbags") is None:
        raise LogError(f"{path}: rosbag2 needs rosbags; install the extra 'ros'")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def _checked(file: Path) -> dict[str, Any]:
    """Return a topics.yaml, checked."""
    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise LogError(f"{file}: cannot be read as YAML: {error}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("channels"), list):
        raise LogError(f"{file}: expected a list `channels`")
    for key in tree:
        if key not in KEYS:
            raise LogError(f"{file}: unknown key {key!r}{did_you_mean(key, KEYS)}")
    for number, channel in enumerate(tree["channels"]):
        place = f"{file}, channels[{number}]"
        lacks = [key for key in ("topic", "field", "names", "to") if key not in channel]
        wrong = [key for key in channel if key not in CHANNEL]
        if lacks or wrong:
            what = f"{lacks[0]!r} is missing" if lacks else f"there is no key {wrong[0]!r}"
            raise LogError(f"{place}: {what}; a channel has {format_names(CHANNEL)}")
        if channel["to"] not in KINDS:
            hint = did_you_mean(channel["to"], KINDS)
            raise LogError(
                f"{place}: unknown column {channel['to']!r}{hint}; {format_names(KINDS)}"
            )
    if not any(channel["to"] == "ctrl" for channel in tree["channels"]):
        raise LogError(f"{file}: no channel with commands; add one (`to: ctrl`)")
    if tree.get("stamp", "header") not in ("header", "log"):
        raise LogError(f"{file}: stamp={tree['stamp']!r} can be 'header' or 'log'")
    return tree


def _series(
    path: Path, file: Path, tree: Mapping[str, Any]
) -> tuple[dict[str, Series], dict[str, str]]:
    """Return every signal by its column, in the order of the channels, and the unit of some."""
    by_topic: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for channel in tree["channels"]:
        by_topic[channel["topic"]].append(channel)
    samples: dict[str, list[tuple[int, float]]] = defaultdict(list)
    renamed, seen, sources = tree.get("joints", {}), set(), dict[str, str]()
    units = dict[str, str]()
    for topic, logged, message in messages(path, by_topic):
        seen.add(topic)
        stamp = logged if tree.get("stamp", "header") == "log" else _stamp(message, logged)
        for channel in by_topic[topic]:
            place = f"{path}, topic {topic}"
            values = np.atleast_1d(_field(message, channel["field"], place))
            names = channel["names"]
            if isinstance(names, str):
                names = _field(message, names, place)
            if len(values) == 0:
                continue  # such as a JointState without velocities
            if len(names) != len(values):
                raise LogError(
                    f"{place}: {channel['field']!r} has {len(values)} numbers, {len(names)} names"
                )
            own, unit = float(channel.get("scale", 1.0)), str(channel.get("unit", PLAIN))
            scale = own * factor(unit, f"{file}, {topic}", str(channel["to"]))
            for i, (name, value) in enumerate(zip(names, values, strict=True)):
                column = f"{channel['to']}.{renamed.get(name, name)}"
                sources[column] = f"{topic}, {channel['field']}[{i}]"
                units |= {column: unit} if abs(own) == 1.0 and unit != PLAIN else {}
                samples[column].append((stamp, scale * float(value)))
    check_sources(sources, str(file))
    missing = [topic for topic in by_topic if topic not in seen]
    if missing:
        there = topics(path)
        raise LogError(
            f"{path}: no message of {missing[0]!r}{did_you_mean(missing[0], there)}; "
            f"it has {format_names(there)}"
        )
    first = min(stamp for pairs in samples.values() for stamp, _ in pairs) if samples else 0
    return {name: _sorted(pairs, first) for name, pairs in samples.items()}, units


def _sorted(pairs: Sequence[tuple[int, float]], first: int) -> Series:
    """Return samples in order of time; of several at one moment the last.

    Times are seconds from a first stamp: since 1970 a float knows them to 0.2 µs only, and a
    command that is late by that acts a simulation step later.
    """
    time = np.array([stamp - first for stamp, _ in pairs]) / NANOS
    value = np.array([value for _, value in pairs])
    order = np.argsort(time, kind="stable")
    time, value = time[order], value[order]
    last = np.r_[np.diff(time) > 0, True]
    return Series(time[last], value[last])


def _stamp(message: Any, logged: int) -> int:
    """Return a message's own stamp [ns], the recorder's where it has none or 0."""
    header = _get(message, "header")
    stamp = None if header is None else _get(header, "stamp")
    if stamp is None:
        return logged
    whole = _get(stamp, "sec")
    part = _get(stamp, "nanosec")
    nanos = round(NANOS * (whole or 0)) + round(part or 0)
    return nanos if nanos > 0 else logged


def _get(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def _field(message: Any, dotted: str, place: str) -> Any:
    """Return the value of a dotted name in a message; numbers index lists."""
    found = message
    for part in dotted.split("."):
        before, found = found, found[int(part)] if part.isdigit() else _get(found, part)
        if found is None:
            slots = before if isinstance(before, Mapping) else getattr(before, "__slots__", None)
            has = format_names(slots or getattr(before, "__dict__", {}))
            raise LogError(f"{place}: its messages have no field {dotted!r}; they have {has}")
    return found


def _rows(
    path: Path, file: Path, tree: Mapping[str, Any], series: Mapping[str, Series]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return columns with a row for each command and reading, and what was done to them."""
    if not any(name.startswith("qpos.") for name in series):
        raise LogError(f"{file}: no channel with measured positions; add one (`to: qpos`)")
    columns, notes = align(merge(series), str(path))
    time, gap = columns["time"], float(tree.get("gap", GAP))
    sent = np.unique(np.concatenate([s.time for n, s in series.items() if n.startswith("ctrl.")]))
    sent = sent[np.searchsorted(sent, time[0], side="right") - 1 :]
    motion = np.r_[0, np.cumsum(np.diff(sent) > gap)]  # of each command
    last = np.searchsorted(sent, time, side="right") - 1
    columns["episode"] = motion[last].astype(float)
    moving = np.bincount(motion)[motion[last]] >= 2  # a single command between pauses is no motion
    kept = moving & (time - sent[last] <= gap)
    columns = {name: values[kept] for name, values in columns.items()}
    starts = np.r_[True, np.diff(columns["episode"]) > 0]
    origin = columns["time"][starts][np.cumsum(starts) - 1]
    clocks = [name for name in columns if name == "time" or name.startswith("stamp.")]
    return columns | {name: columns[name] - origin for name in clocks}, notes
