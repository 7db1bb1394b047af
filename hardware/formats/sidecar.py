"""The JSON file next to a log: its metadata."""

import json
from pathlib import Path
from typing import Any

from hardware.errors import LogError
from hardware.formats.names import SOURCE_UNITS


def read_meta(path: Path) -> dict[str, Any]:
    """Return the table that a JSON file holds; {} if there is no such file.

    Raises:
        LogError: it is not JSON, not a table, or its `model` is not a path.
    """
    if not path.is_file():
        return {}
    try:
        meta = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise LogError(f"{path}: the log's metadata cannot be read as JSON: {error}") from None
    if not isinstance(meta, dict):
        kind = type(meta).__name__
        raise LogError(f"{path}: the metadata is a {kind}, not a table of names and values")
    if not isinstance(meta.get("model", ""), str):
        raise LogError(f"{path}: 'model' is {meta['model']!r}; it is the path of an MJCF or URDF")
    tables = {"settings": "registers by actuator", SOURCE_UNITS: "units by column"}
    for key, what in tables.items():
        if not isinstance(meta.get(key, {}), dict):
            raise LogError(f"{path}: {key!r} is {meta[key]!r}; it is a table of {what}")
    return meta
