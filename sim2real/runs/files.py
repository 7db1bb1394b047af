"""Files that are whole or absent, and folders that several programs share.

A file is written beside its name, then moved into place (`hardware.files.whole_file`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from hardware.files import whole_file


def write_text(path: str | Path, text: str) -> Path:
    """Write a UTF-8 text file at once; return its path."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


@contextmanager
def claimed(folder: str | Path) -> Iterator[bool]:
    """Hold a folder; yield False if another program works there. A program's end frees it."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        held = FileLock(folder / ".claimed").acquire(blocking=False)
    except Timeout:
        yield False
        return
    with held:
        yield True
