"""A trajectory log as Parquet; needs pyarrow (the extra `data`)."""

import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError
from hardware.files import atomic_write
from hardware.formats import cells
from hardware.formats.csv_file import keep_known
from hardware.formats.names import INTEGER_KINDS
from hardware.formats.sidecar import read_meta

_FOREIGN = ("ARROW:schema", "pandas", "huggingface")


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns, (T,) each, and the schema's metadata.

    Raises:
        LogError: pyarrow is missing, the file is damaged, or a cell is empty or no number.
    """
    table = read_table(path)
    texts = {key.decode(): text.decode() for key, text in (table.schema.metadata or {}).items()}
    meta = {key: _value(text) for key, text in texts.items() if key not in _FOREIGN}
    columns = {name: numbers(path, name, table[name]) for name in table.column_names}
    return keep_known(path, columns), meta | read_meta(path.with_suffix(".json"))


def is_log(path: Path) -> bool:
    """Say whether a path is a Parquet file."""
    return path.suffix == ".parquet"


def read_table(path: Path) -> Any:
    """Return a Parquet file as an Arrow table.

    Raises:
        LogError: pyarrow is missing, or the file is damaged.
    """
    need_pyarrow(path)
    import pyarrow.parquet as pq
    from pyarrow import ArrowException

    try:
        return pq.ParquetFile(path).read()
    except (ArrowException, OSError) as error:
        raise LogError(f"{path}: cannot be read as Parquet: {error}") from None


def column_names(path: Path) -> list[str]:
    """Return the names of a Parquet file's columns, read from its end; [] where none can be."""
    if find_spec("pyarrow") is None:
        return []
    import pyarrow.parquet as pq
    from pyarrow import ArrowException

    try:
        return list(pq.read_schema(path).names)
    except (ArrowException, OSError):
        return []


def write(path: Path, columns: Mapping[str, np.ndarray], meta: dict[str, Any]) -> None:
    """Write the columns and, in the schema, the metadata atomically.

    Raises:
        LogError: pyarrow is missing.
    """
    need_pyarrow(path)
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {
        name: values.astype(np.int64) if name.partition(".")[0] in INTEGER_KINDS else values
        for name, values in columns.items()
    }
    schema = {key: json.dumps(value, ensure_ascii=False) for key, value in meta.items()}
    with atomic_write(path) as temporary:
        pq.write_table(pa.table(arrays).replace_schema_metadata(schema), temporary)


def need_pyarrow(path: Path) -> None:
    """Raise LogError where pyarrow is missing."""
    if find_spec("pyarrow") is None:
        raise LogError(f"{path}: Parquet needs pyarrow; install the extra 'data', or use CSV")


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def numbers(path: Path, name: str, column: Any) -> np.ndarray:
    """Return a column as float64, (T,), or (T, k) for lists; dates in s from the first one.

    Raises:
        LogError: cells of another kind; NaN stands for an empty one.
    """
    values, place = column.to_pylist(), f"{path}, column {name!r}"
    if any(isinstance(value, list) for value in values):
        for row, value in enumerate(values):
            if value is None or None in value:
                raise LogError(f"{place}, row {row}: a number is missing; remove the row")
        try:
            return np.asarray(values, float)
        except (TypeError, ValueError):
            raise LogError(f"{place}: {column.type} is not a column of numbers") from None
    read = {"episode": cells.labels}.get(name, cells.seconds)
    return read(values, place)
