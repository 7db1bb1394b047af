"""The seal: what is hidden lies apart from the logs, and cannot be changed once they are out.

    close(keys, logs)               # writes logs/seal.json: a hash of every file below keys
    check(keys, logs)               # raises if one of them has changed since

A diagnosing process is given one case's folder below `logs`, never `keys`. The hashes lie with the
logs, so that whoever has these can tell later whether the key is the one that they came with. A
hash of a hundred digits and letters tells nothing of what it was made of: the key holds numbers of
full precision that nobody can try one by one.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from sim2real.errors import Sim2RealError
from sim2real.files import write_text

SEAL = "seal.json"


def digests(keys: Path) -> dict[str, str]:
    """Return the SHA-256 of every file below a folder, by its path from there."""
    files = sorted(path for path in keys.rglob("*") if path.is_file())
    return {
        path.relative_to(keys).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


def close(keys: Path, logs: Path) -> Path:
    """Write the hashes of the keys beside the logs, and return the file."""
    text = json.dumps({"algorithm": "sha256", "files": digests(keys)}, indent=1)
    return write_text(logs / SEAL, text + "\n")


def check(keys: Path, logs: Path) -> None:
    """Refuse keys that are not the ones that were sealed.

    Raises:
        Sim2RealError: there is no seal, or a file was changed, added or taken away; it says which.
    """
    seal = logs / SEAL
    if not seal.is_file():
        raise Sim2RealError(f"{seal} is missing: these logs were never sealed; make the exam anew")
    sealed, found = json.loads(seal.read_text(encoding="utf-8"))["files"], digests(keys)
    for name in sorted(sealed.keys() | found.keys()):
        if sealed.get(name) != found.get(name):
            how = "added" if name not in sealed else "gone" if name not in found else "changed"
            raise Sim2RealError(
                f"{keys / name} was {how} after the exam was sealed: its score would mean nothing; "
                "make the exam anew"
            )
