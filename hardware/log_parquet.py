"""A trajectory log as Parquet, and LeRobot episodes; needs pyarrow (the extra `data`).

A LeRobot episode (`observation.state`, `action`, `timestamp`, `episode_index`) becomes
`qpos.<joint>`, `ctrl.<joint>`, `time` and `episode`; the joints' names come from the data set's
`meta/info.json`, without their `.pos`. Such numbers are taken as radians, unless the episode's or
the data set's JSON says `"unit": "degrees"`.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError
from hardware.files import whole_file
from hardware.log_columns import INTEGER_KINDS
from hardware.log_csv import keep_known

_logger = logging.getLogger(__name__)
_FOREIGN = ("ARROW:schema", "pandas", "huggingface")


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns, (T,) each, and the schema's metadata.

    Raises:
        LogError: pyarrow is missing, the file is damaged, or a cell is empty or no number.
    """
    _need_pyarrow(path)
    import pyarrow.parquet as pq
    from pyarrow import ArrowException

    try:
        table = pq.ParquetFile(path).read()
    except (ArrowException, OSError) as error:
        raise LogError(f"{path}: this cannot be read as Parquet: {error}") from None
    texts = {key.decode(): text.decode() for key, text in (table.schema.metadata or {}).items()}
    meta = {key: _value(text) for key, text in texts.items() if key not in _FOREIGN}
    if "observation.state" in table.column_names:
        return _lerobot(path, table), meta
    columns = {name: _numbers(path, name, table[name]) for name in table.column_names}
    return keep_known(path, columns), meta


def write(path: Path, columns: Mapping[str, np.ndarray], meta: dict[str, Any]) -> None:
    """Write the columns and, in the schema, the metadata: whole or not at all.

    Raises:
        LogError: pyarrow is missing.
    """
    _need_pyarrow(path)
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {
        name: values.astype(np.int64) if name.partition(".")[0] in INTEGER_KINDS else values
        for name, values in columns.items()
    }
    schema = {key: json.dumps(value, ensure_ascii=False) for key, value in meta.items()}
    with whole_file(path) as temporary:
        pq.write_table(pa.table(arrays).replace_schema_metadata(schema), temporary)


def _need_pyarrow(path: Path) -> None:
    if find_spec("pyarrow") is None:
        raise LogError(f"{path}: Parquet needs pyarrow; install the extra 'data', or use CSV")


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _numbers(path: Path, name: str, column: Any) -> np.ndarray:
    """The column as float64, (T,) or (T, k) for lists."""
    values = column.to_pylist()
    for row, value in enumerate(values):
        if value is None:
            raise LogError(f"{path}, row {row}, column {name!r}: the cell is empty")
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise LogError(f"{path}, column {name!r}: {column.type} holds no plain numbers") from None


def _lerobot(path: Path, table: Any) -> dict[str, np.ndarray]:
    missing = [n for n in ("action", "timestamp", "episode_index") if n not in table.column_names]
    if missing:
        raise LogError(f"{path}: the column {missing[0]!r} of a LeRobot episode is missing")
    state, action = (_numbers(path, name, table[name]) for name in ("observation.state", "action"))
    info = _info(path)
    scale = np.pi / 180 if _unit(path, info) == "degrees" else 1.0
    columns = {
        "episode": _numbers(path, "episode_index", table["episode_index"]),
        "time": _numbers(path, "timestamp", table["timestamp"]),
    }
    for kind, feature, values in (("ctrl", "action", action), ("qpos", "observation.state", state)):
        names = _names(path, info, feature, values)
        columns |= {f"{kind}.{name}": scale * values[:, i] for i, name in enumerate(names)}
    return columns


def _info(path: Path) -> dict[str, Any]:
    for folder in path.parents[:4]:
        file = folder / "meta" / "info.json"
        if file.is_file():
            return json.loads(file.read_text(encoding="utf-8"))
    return {}


def _unit(path: Path, info: dict[str, Any]) -> str:
    sidecar = path.with_suffix(".json")
    beside = json.loads(sidecar.read_text(encoding="utf-8")) if sidecar.is_file() else {}
    unit = beside.get("unit", info.get("unit"))
    if unit not in (None, "degrees", "radians"):
        raise LogError(f"{path}: the unit is {unit!r}; it can be 'degrees' or 'radians'")
    if unit is None:
        _logger.warning(
            '%s: the unit is not said; taken as radians. If not, put {"unit": "degrees"} in %s',
            path,
            sidecar.name,
        )
    return unit or "radians"


def _names(path: Path, info: dict[str, Any], feature: str, values: np.ndarray) -> list[str]:
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
