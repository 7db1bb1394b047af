"""manifest.json of a run: with what, from what and on what it was made.

write_manifest(Path("outputs/train/smoke/2026-11-21_10-00-00"), seed=0)
"""

import datetime
import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from sim2real.runs.files import write_text

NAME = "manifest.json"
PACKAGES = (
    "sim2real",
    "torch",
    "torchrl",
    "tensordict",
    "mujoco",
    "gymnasium",
    "numpy",
    "scipy",
    "hydra-core",
    "omegaconf",
)
_ROOT = Path(__file__).resolve().parents[2]


def write_manifest(out: Path, seed: int) -> Path:
    """Write a run's manifest.json; it is whole or absent.

    Args:
        out: the run's folder.
        seed: the run's seed.
    """
    return write_text(out / NAME, json.dumps(manifest(seed), indent=2) + "\n")


def command_line(out: Path) -> str | None:
    """Return the command that started the run in this folder; None where no command did.

    Args:
        out: the run's folder.
    """
    path = out / NAME
    if not path.is_file():
        return None
    program, *arguments = json.loads(path.read_text(encoding="utf-8"))["argv"]
    start = "python -m sim2real" if program == "__main__.py" else shlex.quote(program)
    return " ".join([start, *map(shlex.quote, arguments)])


def manifest(seed: int) -> dict[str, Any]:
    """Return versions, git revision, command line, seed, machine and time."""
    return {
        "schema": 1,
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "argv": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "directory": str(Path.cwd()),
        "seed": seed,
        "git": git(_ROOT),
        "python": platform.python_version(),
        "packages": {name: version for name in PACKAGES if (version := _version(name))},
        "machine": machine(),
    }


def git(root: Path) -> dict[str, Any] | None:
    """Return the revision of the checkout at root and whether files differ; None outside one."""
    if not (root / ".git").exists() or shutil.which("git") is None:
        return None
    try:
        revision = _git(root, "rev-parse", "HEAD")
        return {"revision": revision, "dirty": bool(_git(root, "status", "--porcelain"))}
    except (OSError, subprocess.SubprocessError):
        return None


def machine() -> dict[str, Any]:
    """Return the system, its cores, memory [bytes], processor and CUDA devices."""
    return {
        "host": platform.node(),
        "system": platform.platform(),
        "cores": _cores(),
        "memory": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        "cpu": _cpu(),
        "gpus": _gpus(),
    }


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    for line in info.read_text(encoding="utf-8").splitlines() if info.exists() else ():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _gpus() -> list[str]:
    """Return the devices' names as their driver says them: torch is not imported for it."""
    if shutil.which("nvidia-smi") is None:
        return []
    command = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError):
        return []
    return [line.strip() for line in done.stdout.splitlines() if line.strip()]


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=20, check=True
    ).stdout.strip()


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
