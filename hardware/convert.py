"""Turn logs from other tools into this project's own, with new names and a model where wanted.

    convert("bam/data.bak/raw", "logs/xl330", joints=["hinge"], model="xl330.xml")

Each log becomes a CSV with a JSON next to it. On the command line: `sim2real convert`.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

from hardware.errors import LogError, format_names
from hardware.formats.names import SOURCE_UNITS
from hardware.log import Log, read_logs, write_log


def convert(
    source: str | Path | Iterable[str | Path],
    to: str | Path,
    joints: Sequence[str] = (),
    model: str | Path | None = None,
) -> list[Path]:
    """Read logs and write each as a CSV of the same name.

    Args:
        source: see `hardware.log.read_logs`.
        to: a folder.
        joints: new names, as many as the log has joints; none keeps them.
        model: the MJCF that is named in the metadata.

    Returns:
        The files.

    Raises:
        LogError: a log that is damaged, another number of names, or two logs of one name.
    """
    logs = read_logs(source)
    names = [log.path.stem if log.path else "log" for log in logs]
    for name in names:
        if names.count(name) > 1:
            raise LogError(f"two logs are called {name!r}; convert their folders one by one")
    Path(to).mkdir(parents=True, exist_ok=True)
    extra = {} if model is None else {"model": str(Path(model).resolve())}
    made = [renamed(log, joints) if joints else log for log in logs]
    made = [Log(log.columns, {**log.meta, **extra}, log.path) for log in made]
    return [write_log(Path(to) / f"{name}.csv", log) for name, log in zip(names, made, strict=True)]


def renamed(log: Log, joints: Sequence[str]) -> Log:
    """Return the log with other names for its joints, and for its actuators in the same order.

    Raises:
        LogError: another number of names than the log has joints, or actuators named otherwise.
    """
    if len(joints) != len(log.joints) or log.actuators != log.joints:
        raise LogError(
            f"{log.path}: it has joints {format_names(log.joints)} and actuators "
            f"{format_names(log.actuators)}; {len(joints)} names cannot replace them"
        )
    new = dict(zip(log.joints, joints, strict=True))
    columns = {_renamed(name, new): values for name, values in log.columns.items()}
    settings = {new.get(name, name): value for name, value in log.settings.items()}
    units = {_renamed(n, new): unit for n, unit in log.meta.get(SOURCE_UNITS, {}).items()}
    tables = {"settings": settings, SOURCE_UNITS: units}
    meta = {**log.meta, **{key: table for key, table in tables.items() if table}}
    return Log(columns, meta, log.path)


def _renamed(column: str, new: dict[str, str]) -> str:
    kind, _, name = column.partition(".")
    if kind == "sensor":
        ends = [joint for joint in new if name.endswith(f"_{joint}")]
        old = max(ends, key=len, default="")  # of Pitch and Wrist_Pitch the longer
        return f"{column[: len(column) - len(old)]}{new[old]}" if old else column
    return f"{kind}.{new[name]}" if name in new else column
