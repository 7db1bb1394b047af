"""What a report says of how it was made: its inputs, its settings, the command that repeats it.

inputs["link"] = links(logs)            # of the logs whose metadata tell it, by `hardware/link.py`
command(inputs)                         # python -m sim2real run=diagnose log=... model=...
"""

import os
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hardware.log import Log
from sim2real.diagnosis.data.pairs import name_of

HASH, HASHES = 12, 3  # digits of a hash next to the verdict, and how many hashes are shown


def number(value: Any) -> str:
    """Return a number, or a list of them, with four digits."""
    if isinstance(value, list | tuple):
        return ", ".join(map(number, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def header(inputs: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what stands below the verdict: date, robot, versions, logs with their hashes."""
    versions = inputs.get("versions", {})
    hashes = inputs.get("sha256", {})
    shown = {f"SHA-256 of {Path(log).name}": text[:HASH] for log, text in hashes.items()}
    if len(hashes) > HASHES:
        shown = {"SHA-256 of the logs": f"{len(hashes)}, see below"}
    rows = {
        "Made": inputs.get("made", ""),
        "Robot": ", ".join(inputs.get("robots", [])),
        "With": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }
    return [(name, value) for name, value in (rows | shown).items() if value]


def flat(tree: Mapping[str, Any], head: str = "") -> list[tuple[str, str]]:
    """Return a tree of names and values as lines of a list."""
    lines = []
    for key, value in tree.items():
        if key in ("command", "link"):
            continue  # they stand elsewhere on the page
        own = str(key)  # a word, or the path of a log, which keeps its underscores
        title = head + (own.replace("_", " ") if own.isidentifier() else _short(own))
        if isinstance(value, Mapping):
            lines += flat(value, f"{title}: ")
        else:
            shown = [_short(path) for path in value] if key in ("logs", "models") else value
            lines.append((title, ("" if shown is None else number(shown)) or "none"))
    return lines


def links(logs: Iterable[Log]) -> dict[str, Mapping[str, Any]]:
    """Return what the metadata of logs tell of their link, by the name of the log's file."""
    return {
        name_of(log, f"log {number}"): log.meta["link"]
        for number, log in enumerate(logs, 1)
        if "link" in log.meta
    }


def names(inputs: Mapping[str, Any]) -> list[str]:
    """Return the names of the logs' files."""
    return [Path(log).name for log in inputs.get("logs", [])]


def command(inputs: Mapping[str, Any]) -> str:
    """Return the command line that makes this report again."""
    if "command" in inputs:
        return str(inputs["command"])
    seed = [f"seed={inputs['seed']}"] if inputs.get("seed") else []
    return " ".join(["python -m sim2real run=diagnose", *sources(inputs), *seed])


def sources(inputs: Mapping[str, Any]) -> list[str]:
    """Return log=... and model=..., quoted for a shell."""
    logs = [_short(log) for log in inputs.get("logs", [])]
    parts = ["log=" + (logs[0] if len(logs) == 1 else f"[{','.join(logs)}]")]
    models = {_short(model) for model in inputs.get("models", [])}
    parts += [f"model={model}" for model in models if len(models) == 1]
    return [shlex.quote(part) for part in parts]


def _short(path: str) -> str:
    """Return a path without detours: from the working folder, from `~`, or as it was given.

    A report may be published, so it names no folder of the machine that nobody typed.
    """
    if not os.path.isabs(path):
        return os.path.normpath(path)
    for start, sign in ((os.getcwd(), ""), (os.path.expanduser("~"), "~" + os.sep)):
        if os.path.abspath(path).startswith(start + os.sep):
            return sign + os.path.relpath(path, start)
    return os.path.normpath(path)
