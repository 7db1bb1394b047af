"""The Python of a client that lives in an environment of its own.

    python_of("servolab==1.0.0")        # .clients/servolab-1.0.0/bin/python

An environment is made once, by the test that first needs it; the test is skipped where its package
cannot be installed.
"""

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / ".clients"


def python_of(package: str) -> str:
    """Return the Python of a package's own environment."""
    folder = FOLDER / re.sub(r"\[.*\]", "", package).replace("==", "-")
    python = folder / "bin" / "python"
    if not (folder / "complete").exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(folder)], check=True)
        install = [str(python), "-m", "pip", "install", "--quiet", package]
        done = subprocess.run(install, capture_output=True, text=True)
        if done.returncode:
            said = (done.stderr.strip() or "no reason given").splitlines()[-1]
            pytest.skip(f"{package} cannot be installed here: {said}")
        (folder / "complete").touch()
    return str(python)


def run_client(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a client that sees nothing of this project, and return its end."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(words, capture_output=True, text=True, timeout=300, env=clean)
