"""Atomic writing of files: complete, or not there."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile

from hardware.errors import RobotError


def check_new(path: Path) -> None:
    """Refuse to make a file that is there already, or where none can be; makes its folder.

    Raises:
        RobotError: with the reason.
    """
    if path.exists():
        raise RobotError(f"{path} exists; choose another name, or remove it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise RobotError(f"{path}: no file can be made there: {error.strerror}") from None


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yield a new name next to `path`; move it there if the block ends well, else remove it.

    The name keeps the suffix, which writers of images go by. The block makes the file, so that it
    gets the permissions of any other.

    Args:
        path: where the file shall be; its folder is made if need be.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(8)}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
