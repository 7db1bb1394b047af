"""Files that are whole or absent, and folders that several programs share.

A file is written under a temporary name next to its own, then moved into place
(`hardware.files.atomic_write`); so is a folder whose being there says that a step is done.
"""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from hardware.files import atomic_write


def write_text(path: str | Path, text: str) -> Path:
    """Write a UTF-8 text file at once; return its path."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Yield a new folder next to `path`; move it there if the block ends well, else remove it.

    What a process that was killed left of the same folder is removed first.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    for left in path.parent.glob(f".{path.name}-*"):
        shutil.rmtree(left)
    temporary = path.with_name(f".{path.name}-{secrets.token_hex(8)}")
    temporary.mkdir()
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def folder_lock(folder: str | Path) -> Iterator[bool]:
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
