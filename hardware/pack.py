"""One ZIP file of what a robot's runs wrote, with nothing personal in it.

    pack(Path("first"), Path("first.zip"), print)

Text files lose the home folder, the folder that the program was started in, and the names of the
user and the machine; pictures and other files that cannot be looked through are left out.
"""

import getpass
import platform
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path

from hardware.command_line import UsageError
from hardware.files import atomic_write
from hardware.terminal import Tell

KINDS = (".csv", ".html", ".json", ".log", ".md", ".txt", ".yaml")
SHORTEST = 3  # letters of a name that is replaced; a shorter one is in every word


def personal() -> list[tuple[str, str]]:
    """Return pairs of a word and its replacement, longer words first."""
    words = {str(Path.cwd()): ".", str(Path.home()): "~", platform.node(): "HOST"}
    if (user := getpass.getuser()) != "root":  # a common word, and no person's name
        words[user] = "USER"
    kept = [(word, name) for word, name in words.items() if len(word) >= SHORTEST]
    return sorted(kept, key=lambda pair: -len(pair[0]))


def without_personal(text: str, words: Sequence[tuple[str, str]]) -> str:
    """Return a text with these words replaced, where they stand alone."""
    for word, name in words:
        text = re.sub(rf"(?<!\w){re.escape(word)}(?!\w)", name, text)
    return text


def pack(folder: Path, path: Path, tell: Tell) -> None:
    """Write the ZIP file atomically, and list what is in it.

    Args:
        folder: what the runs wrote.
        path: the file to write.
        tell: shows a line.

    Raises:
        UsageError: the folder is not there, holds nothing to send, or the file is there already.
    """
    if not folder.is_dir():
        raise UsageError(f"folder={folder}: no such folder")
    if path.exists():
        raise UsageError(f"{path} exists; remove it, or choose another file=")
    files = sorted(f for f in folder.rglob("*") if f.is_file() and f.suffix in KINDS)
    if not files:
        raise UsageError(f"folder={folder}: nothing in it ends in {', '.join(KINDS)}")
    words = personal()
    squeezed = zipfile.ZIP_DEFLATED
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w", squeezed) as packed:
        for file in files:
            text = file.read_text(encoding="utf-8", errors="replace")
            name = f"{folder.resolve().name}/{file.relative_to(folder).as_posix()}"
            packed.writestr(name, without_personal(text, words))
            tell(name)
    tell(f"wrote {path}: {len(files)} files; look through it before you send it")
