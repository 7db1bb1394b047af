"""File formats of logs: this project's own CSV and Parquet, and those of other tools.

    columns, meta = find(Path("run.mcap")).read(Path("run.mcap"))

A format says whether a path is one of its logs and reads it into the columns of a trajectory log
(`hardware/log.py`). Formats are asked in order, so those that look closely come first. One of your
own is registered before all others:

    register(Format("my tool", is_log=lambda path: path.suffix == ".mine", read=read_mine))
"""

from hardware.formats.registry import FORMATS, Format, find, register

__all__ = ["FORMATS", "Format", "find", "register"]
