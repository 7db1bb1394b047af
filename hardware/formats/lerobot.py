"""Episodes of a LeRobot data set (v2 and v3), in radians; needs pyarrow (the extra `data`).

    columns, meta = read(Path("my_dataset/data/chunk-000/episode_000000.parquet"))

`action` becomes `ctrl.<joint>`, `observation.state` `qpos.<joint>`; the joints' names are those of
`meta/info.json`, without their `.pos`. What a data set does not contain is read from a file
`log.json` in its folder (or next to the episode, under the episode's name):

    {"unit": "normalized", "calibration": "so101.json", "joints": {"shoulder_pan": "pan"},
     "scale": {"gripper": [-0.1745, 1.0]}, "model": "so101.xml"}

* `unit`: `degrees`, `radians`, or `normalized`, LeRobot's -100 to 100 (a gripper: 0 to 100) over
  the range of `calibration`, the robot's own file (`hardware/calibration.py` says what its fields
  mean). An angle is measured from the middle of the range, a gripper's from its lower end, as
  LeRobot's own `degrees` are.
* `scale`: offset [rad] and factor that turn such an angle into the model's.
* `resolution`: counts a turn of the servos, 4096 unless said.

LeRobot writes times that it never measured, frame / fps; `clock: nominal` in the metadata says so.
Source: lerobot/motors/motors_bus.py, `_unnormalize`; lerobot/datasets/utils.py.
"""

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError, did_you_mean, format_names
from hardware.formats.parquet import column_names, numbers, read_table
from hardware.formats.sidecar import read_meta

_logger = logging.getLogger(__name__)
NEEDED = ("observation.state", "action", "timestamp", "episode_index")
OWN = ("unit", "calibration", "joints", "scale", "resolution")  # of log.json; the rest is passed on
UNITS = ("degrees", "radians", "normalized")
RESOLUTION = 4096  # counts a turn
NOMINAL = 1e-4  # s, of a time from frame / fps: it is then computed, not measured
TURN = 1.05 * 2 * np.pi  # rad: numbers within it may be radians
FULL = 100.5  # numbers within it may be normalized
ABOVE = 4  # folders above an episode in which the data set's files are looked for


def is_log(path: Path) -> bool:
    """Say whether a path is such an episode, or several."""
    return path.suffix == ".parquet" and "observation.state" in column_names(path)


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns of the episodes in a file, (T,) each, and their metadata.

    Raises:
        LogError: a column is missing, the unit is unknown, or the calibration does not fit.
    """
    table = read_table(path)
    missing = [name for name in NEEDED if name not in table.column_names]
    if missing:
        raise LogError(f"{path}: the column {missing[0]!r} of a LeRobot episode is missing")
    data = {name: numbers(path, name, table[name]) for name in NEEDED}
    folder, info = _info(path)
    extra = {**read_meta(folder / "log.json"), **read_meta(path.with_suffix(".json"))}
    names = _names(path, info, "observation.state", data["observation.state"])
    commanded = _names(path, info, "action", data["action"])
    angles = _angles(path, folder, extra, info, data)
    renamed = extra.get("joints", {})
    scale = extra.get("scale", {})
    columns = {"episode": data["episode_index"], "time": data["timestamp"]}
    for kind, joints, feature in (
        ("ctrl", commanded, "action"),
        ("qpos", names, "observation.state"),
    ):
        for i, name in enumerate(joints):
            offset, factor = scale.get(name, (0.0, 1.0))
            values = angles(name, data[feature][:, i])
            columns[f"{kind}.{renamed.get(name, name)}"] = offset + factor * values
    meta = {key: value for key, value in extra.items() if key not in OWN}
    if "model" in meta:
        meta["model"] = str((folder / meta["model"]).resolve())
    return columns, {"source": "lerobot", **_clock(data, info), **meta}


def _angles(
    path: Path,
    folder: Path,
    extra: Mapping[str, Any],
    info: Mapping[str, Any],
    data: Mapping[str, np.ndarray],
) -> Any:
    """Return a function of joint name and numbers (T,) to angles [rad]."""
    unit = extra.get("unit", info.get("unit")) or _guess(path, folder, data)
    if unit not in UNITS:
        raise LogError(f"{path}: the unit is {unit!r}; expected {format_names(UNITS)}")
    if unit == "degrees":
        return lambda name, values: np.deg2rad(values)
    if unit == "radians":
        return lambda name, values: values
    ranges = _ranges(path, folder, extra)
    turn = 2 * np.pi / float(extra.get("resolution", RESOLUTION))

    def angle(name: str, values: np.ndarray) -> np.ndarray:
        if name not in ranges:
            raise LogError(
                f"{path}: the calibration has no joint {name!r}{did_you_mean(name, ranges)}; "
                f"it has {format_names(ranges)}"
            )
        joint = ranges[name]
        span = (joint["range_max"] - joint["range_min"]) * turn  # rad
        sign = -1.0 if joint.get("drive_mode") else 1.0
        if "gripper" in name:
            return span * (values if sign > 0 else 100.0 - values) / 100
        return sign * span / 2 * values / 100

    return angle


def _guess(path: Path, folder: Path, data: Mapping[str, np.ndarray]) -> str:
    """Return the unit that the numbers can only have; raise LogError where several can be."""
    most = max(np.abs(data["observation.state"]).max(), np.abs(data["action"]).max())
    place = f'"unit" in {folder / "log.json"}'
    if most > FULL:
        _logger.warning(
            "%s: angles up to %.0f are taken as degrees; else set %s", path, most, place
        )
        return "degrees"
    if most > TURN:
        raise LogError(
            f"{path}: numbers up to {most:.0f} may be degrees or LeRobot's normalized units; set "
            f"{place} to 'degrees', or to 'normalized' with a 'calibration'"
        )
    _logger.warning("%s: no unit is given; radians are assumed. If not, set %s", path, place)
    return "radians"


def _ranges(path: Path, folder: Path, extra: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the joints of a LeRobot calibration."""
    if "calibration" not in extra:
        raise LogError(
            f"{path}: normalized units need the robot's calibration; name its file as "
            f'"calibration" in {folder / "log.json"}'
        )
    file = folder / str(extra["calibration"])
    if not file.is_file():
        raise LogError(f"{path}: the calibration {file} does not exist")
    table = read_meta(file)
    joints = table.get("joints", table)  # this project's files hold LeRobot's fields under `joints`
    for name, joint in joints.items():
        lacks = [k for k in ("range_min", "range_max") if not isinstance(joint.get(k), int | float)]
        if lacks or joint["range_min"] >= joint["range_max"]:
            raise LogError(f"{file}: {name!r} needs a range_min below its range_max")
    return joints


def _clock(data: Mapping[str, np.ndarray], info: Mapping[str, Any]) -> dict[str, str]:
    """Say that times were computed from the frame's number, where they were."""
    fps = info.get("fps")
    starts = np.r_[True, np.diff(data["episode_index"]) != 0]
    first = np.maximum.accumulate(np.where(starts, np.arange(len(starts)), 0))
    frame = np.arange(len(starts)) - first
    computed = fps and np.abs(data["timestamp"] - frame / fps).max() < NOMINAL
    return {"clock": "nominal"} if computed else {}


def _info(path: Path) -> tuple[Path, dict[str, Any]]:
    """Return the data set's folder, the episode's own where there is none, and its info.json."""
    for folder in path.parents[:ABOVE]:
        file = folder / "meta" / "info.json"
        if file.is_file():
            return folder, json.loads(file.read_text(encoding="utf-8"))
    return path.parent, {}


def _names(path: Path, info: Mapping[str, Any], feature: str, values: np.ndarray) -> list[str]:
    names = info.get("features", {}).get(feature, {}).get("names")
    if isinstance(names, dict):
        names = next(iter(names.values()))
    if names is None:
        names = [f"joint{i}" for i in range(values.shape[1])]
    if values.ndim != 2 or values.shape[1] != len(names):
        shape = values.shape[1:]
        raise LogError(
            f"{path}: {feature!r} has {shape} numbers, meta/info.json {len(names)} names"
        )
    return [str(name).removesuffix(".pos") for name in names]
