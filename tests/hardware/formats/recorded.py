"""One recorded run of two joints, written in every format that the project reads."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from hardware.log import Log, write_log

ROWS, STEP = 200, 0.02  # 50 Hz
JOINTS = ("pan", "lift")
LATE = 0.003  # s before a command at which the positions were read


def run(columns: bool = True) -> Log:
    """Return the run as this project's own log."""
    time = STEP * np.arange(ROWS)
    made = {"episode": np.zeros(ROWS), "time": time}
    for i, name in enumerate(JOINTS):
        made[f"ctrl.{name}"] = np.sin((1 + i) * time)
    for i, name in enumerate(JOINTS):
        made[f"qpos.{name}"] = 0.9 * np.sin((1 + i) * time - 0.1)
    for i, name in enumerate(JOINTS):
        made[f"qvel.{name}"] = 0.9 * (1 + i) * np.cos((1 + i) * time - 0.1)
    return Log(made | {f"stamp.{name}": time - LATE for name in JOINTS})


def own(folder: Path, log: Log) -> Path:
    """Write this project's CSV."""
    return write_log(folder / "run.csv", log)


def parquet(folder: Path, log: Log) -> Path:
    """Write this project's Parquet."""
    return write_log(folder / "run.parquet", log)


def renamed_csv(folder: Path, log: Log) -> Path:
    """Write a semicolon CSV in degrees and milliseconds, with its columns.yaml."""
    names = {"time": ("t", "ms", 1e3), "episode": ("run", "1", 1.0)}
    for column in log.columns:
        kind, _, joint = column.partition(".")
        if kind in ("ctrl", "qpos", "qvel"):
            unit = "deg/s" if kind == "qvel" else "deg"
            names[column] = (f"{joint} {kind}", unit, 180 / np.pi)
        elif kind == "stamp":
            names[column] = (f"{joint} read at", "ms", 1e3)
    table = np.column_stack([log.column(c) * factor for c, (_, _, factor) in names.items()])
    head = ";".join(name for name, _, _ in names.values())
    rows = [";".join(f"{x:.17g}" for x in row) for row in table]
    (folder / "run.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    mapping = {c: {"from": name, "unit": unit} for c, (name, unit, _) in names.items()}
    (folder / "columns.yaml").write_text(
        yaml.safe_dump({"columns": mapping}, sort_keys=False), encoding="utf-8"
    )
    return folder / "run.csv"


def _arrays(log: Log) -> tuple[dict[str, np.ndarray], dict]:
    arrays = {
        kind: np.column_stack([log.column(f"{kind}.{name}") for name in log.joints])
        for kind in ("ctrl", "qpos", "qvel", "stamp")
    }
    mapping: dict = {"time": "demo_0/obs/time"}
    for kind in arrays:
        for i, name in enumerate(log.joints):
            mapping[f"{kind}.{name}"] = {"from": f"/demo_0/obs/{kind}", "index": i}
    return {"time": log.time, **arrays}, {"columns": mapping}


def hdf5(folder: Path, log: Log) -> Path:
    """Write HDF5 with a columns.yaml."""
    import h5py

    arrays, mapping = _arrays(log)
    with h5py.File(folder / "run.h5", "w") as file:
        for name, values in arrays.items():
            file[f"demo_0/obs/{name}"] = values
    (folder / "columns.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False), encoding="utf-8")
    return folder / "run.h5"


def zarr(folder: Path, log: Log) -> Path:
    """Write Zarr with a columns.yaml."""
    import zarr as library

    arrays, mapping = _arrays(log)
    root = library.open_group(str(folder / "run.zarr"), mode="w")
    for name, values in arrays.items():
        root.create_array(f"demo_0/obs/{name}", data=values)
    (folder / "columns.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False), encoding="utf-8")
    return folder / "run.zarr"


def lerobot(folder: Path, log: Log) -> Path:
    """Write a LeRobot v3 data set in degrees, without speeds and stamps, which it cannot hold."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = [f"{name}.pos" for name in log.joints]
    pair = {
        key: np.rad2deg(np.column_stack([log.column(f"{kind}.{n}") for n in log.joints])).tolist()
        for key, kind in (("action", "ctrl"), ("observation.state", "qpos"))
    }
    index = {
        "timestamp": log.time,
        "frame_index": np.arange(len(log)),
        "episode_index": log.episode,
    }
    path = folder / "data" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.table({**pair, **index}), path)
    features = {key: {"dtype": "float32", "shape": [len(names)], "names": names} for key in pair}
    info = {"codebase_version": "v3.0", "fps": 50, "features": features}
    (folder / "meta").mkdir()
    (folder / "meta" / "info.json").write_text(json.dumps(info), encoding="utf-8")
    (folder / "log.json").write_text(json.dumps({"unit": "degrees"}), encoding="utf-8")
    return folder


EPOCH = 1_700_000_000 * 10**9  # ns


def _topics(log: Log) -> str:
    """Return the topics.yaml of the recordings of messages."""
    channels = [
        {"topic": "/commands", "field": "data", "names": list(log.joints), "to": "ctrl"},
        {"topic": "/joint_states", "field": "position", "names": "name", "to": "qpos"},
        {"topic": "/joint_states", "field": "velocity", "names": "name", "to": "qvel"},
    ]
    return yaml.safe_dump({"channels": channels, "stamp": "header"})


def _messages(log: Log) -> list[tuple[str, int, dict]]:
    """Return topic, stamp [ns] and content, in the order of the stamps."""
    made: list[tuple[str, int, dict]] = []
    for row in range(len(log)):
        read = {
            "name": list(log.joints),
            "position": [float(log.column(f"qpos.{n}")[row]) for n in log.joints],
            "velocity": [float(log.column(f"qvel.{n}")[row]) for n in log.joints],
        }
        sent = {"data": [float(log.column(f"ctrl.{n}")[row]) for n in log.joints]}
        made.append(("/joint_states", _nanos(log.column(f"stamp.{log.joints[0]}")[row]), read))
        made.append(("/commands", _nanos(log.time[row]), sent))
    return made


def _nanos(seconds: float) -> int:
    return EPOCH + round(float(seconds) * 1e9)


def mcap(folder: Path, log: Log) -> Path:
    """Write MCAP with ROS 2 messages and JSON commands, and a topics.yaml."""
    from mcap_ros2.writer import Writer

    state = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    state += f"float64[] effort\n{80 * '='}\n"
    state += "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    state += f"{80 * '='}\n"
    state += "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    with (folder / "run.mcap").open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", state)
        numbers = writer.register_msgdef("std_msgs/msg/Float64MultiArray", "float64[] data\n")
        for topic, nanos, content in _messages(log):
            if topic == "/joint_states":
                at = {"sec": nanos // 10**9, "nanosec": nanos % 10**9}
                content = content | {"effort": [], "header": {"stamp": at, "frame_id": ""}}
            kind = schema if topic == "/joint_states" else numbers
            writer.write_message(topic, kind, content, log_time=nanos, publish_time=nanos)
        writer.finish()
    (folder / "topics.yaml").write_text(_topics(log), encoding="utf-8")
    return folder / "run.mcap"


def rosbag2(folder: Path, log: Log) -> Path:
    """Write a rosbag2 folder (SQLite) and a topics.yaml."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        kinds = {"/joint_states": "sensor_msgs/msg/JointState"}
        kinds["/commands"] = "std_msgs/msg/Float64MultiArray"
        made = {t: writer.add_connection(t, kind, typestore=store) for t, kind in kinds.items()}
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        for topic, nanos, content in _messages(log):
            if topic == "/joint_states":
                time = types["builtin_interfaces/msg/Time"](nanos // 10**9, nanos % 10**9)
                message = types[kinds[topic]](
                    header=types["std_msgs/msg/Header"](stamp=time, frame_id=""),
                    name=content["name"],
                    position=np.array(content["position"]),
                    velocity=np.array(content["velocity"]),
                    effort=np.array([]),
                )
            else:
                message = types[kinds[topic]](layout=layout, data=np.array(content["data"]))
            raw = store.serialize_cdr(message, kinds[topic])
            writer.write(made[topic], nanos, raw)
    (folder / "bag" / "topics.yaml").write_text(_topics(log), encoding="utf-8")
    return folder / "bag"


FORMATS: dict[str, Callable[[Path, Log], Path]] = {
    f.__name__: f for f in (own, parquet, renamed_csv, hdf5, zarr, lerobot, mcap, rosbag2)
}
