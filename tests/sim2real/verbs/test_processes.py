"""No verb leaves a process behind: each runs in a session of its own, which is empty then."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PATIENCE = 300.0  # s that a command may take
LAST = 2.0  # s after which what is left of a session counts
SMALL = ("env=nav2d", "params=goals", "algorithm=ppo_sb3", "algorithm.num_rows=4")
SMALL += ("algorithm.steps=32", "algorithm.epochs=1", "iterations=2", "eval=none")
TRAINED = "checkpoint=run"
COMMANDS: dict[str, tuple[str, ...]] = {  # in this order: later ones use what earlier ones leave
    "train": ("run=train", *SMALL, "collector=processes", "hydra.run.dir=run"),
    "evaluate": ("run=evaluate", TRAINED, "eval.episodes=1"),
    "export": ("run=export", TRAINED),
    "record": ("run=record", "robot=bench1", "seconds=2", "hydra.run.dir=record"),
    "convert": ("run=convert", "log=record", "hydra.run.dir=convert"),
    "replay": ("run=replay", "log=record"),
    "contract": ("run=contract", "log=record"),
    "population": ("run=train", "+experiment=smoke", "algorithm.shards=2", "eval=none"),
}


def session(number: int) -> Iterator[int]:
    """Yield the processes of a session."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                after = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended
            if int(after[3]) == number and after[0] != "Z":
                yield int(folder.name)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs /proc")
def test_no_verb_leaves_a_process_behind(tmp_path: Path) -> None:
    """Each ends by itself, and with it everything that it started."""
    for name, words in COMMANDS.items():
        started = subprocess.Popen(
            [sys.executable, "-m", "sim2real", *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            _, said = started.communicate(timeout=PATIENCE)
        finally:
            if started.poll() is None:
                os.killpg(started.pid, 9)
        time.sleep(LAST)
        assert list(session(started.pid)) == [], name
        known = "is not used by" in said or started.returncode == 0
        assert known or "Error" not in said, (name, said[-2000:])
