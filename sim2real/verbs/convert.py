"""The verb `convert`: logs from other tools as this project's own."""

import logging
from collections.abc import Sequence
from pathlib import Path

from hardware.convert import convert
from hardware.formats.guess import write_guess
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)


def run(
    *,
    log: str | list[str] | None,
    model: str | None,
    joints: Sequence[str],
    columns: str | None,
    out: Path,
) -> list[Path]:
    """Convert logs, or write a first mapping for one.

    Args:
        log: a log of any format, a folder of logs, or a list of these.
        model: the MJCF or URDF that the logs name from then on; None keeps theirs.
        joints: new names for joints and actuators, in the log's order; none keeps them.
        columns: where to write a first columns.yaml (a topics.yaml for recordings of messages)
            from the log's header, instead of converting.
        out: the run's folder; gets a CSV and a JSON for each log.

    Returns:
        The files that were written.

    Raises:
        Sim2RealError: no log, or several logs for one mapping.
        LogError: a log that is damaged, another number of names, or two logs of one name.
    """
    if not log:
        raise Sim2RealError("convert needs a recording; give log=PATH")
    if columns is None:
        return convert(log, Path(out), joints, model)
    sources = [log] if isinstance(log, str) else list(log)
    if len(sources) != 1:
        raise Sim2RealError(f"columns= needs one log, but {len(sources)} were given")
    written = write_guess(Path(sources[0]).expanduser(), Path(columns).expanduser())
    log_.info("wrote %s; read it over, then use the log as it is", written)
    return [written]
