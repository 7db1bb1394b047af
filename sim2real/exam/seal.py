"""The seal: what is hidden lies apart from the logs, and cannot be changed once they are out.

    close(keys, logs, names)        # adds to logs/seal.json: a hash of every file of these
    check(keys, logs)               # raises if one of them has changed since

A diagnosing process is given one case's folder below `logs`, never `keys`. The hashes lie with the
logs, so that their owner can check later whether the key is the one that they came with. A
hash of a hundred digits and letters tells nothing of what it was made of: the key holds numbers of
full precision, too many to try one by one.
"""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

SEAL = "seal.json"


def digests(keys: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 of every file of some cases, by its path from the keys' folder."""
    files = sorted(path for name in names for path in (keys / name).rglob("*") if path.is_file())
    return {
        path.relative_to(keys).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


def sealed(logs: Path) -> dict[str, str]:
    """Return the hashes that were written, by the file's path; none without a seal."""
    seal = logs / SEAL
    if not seal.is_file():
        return {}
    return json.loads(seal.read_text(encoding="utf-8"))["files"]


def cases(logs: Path) -> list[str]:
    """Return the names of the cases that were sealed, in order."""
    return sorted({name.split("/")[0] for name in sealed(logs)})


def close(keys: Path, logs: Path, names: Iterable[str]) -> Path:
    """Add the hashes of these cases' keys to those next to the logs, and return the file.

    What was sealed before stays as it was.
    """
    files = digests(keys, names) | sealed(logs)
    text = json.dumps({"algorithm": "sha256", "files": files}, indent=1)
    return write_text(logs / SEAL, text + "\n")


def check(keys: Path, logs: Path) -> None:
    """Refuse keys that are not the ones that were sealed; cases without a seal are not looked at.

    Raises:
        Sim2RealError: there is no seal, or a file was changed, added or taken away; it says which.
    """
    seal = logs / SEAL
    if not seal.is_file():
        raise Sim2RealError(f"{seal} is missing: these logs were never sealed; create a new exam")
    wanted, found = sealed(logs), digests(keys, cases(logs))
    for name in sorted(wanted.keys() | found.keys()):
        if wanted.get(name) != found.get(name):
            how = "added" if name not in wanted else "gone" if name not in found else "changed"
            raise Sim2RealError(
                f"{keys / name} was {how} after the exam was sealed, so its score would be "
                f"invalid; create a new exam"
            )
