"""The examples run as they are typed, in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hardware.log import read_log

ROOT = Path(__file__).resolve().parent.parent


def run(name: str, folder: Path, *words: str) -> str:
    """Return what an example prints."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, str(ROOT / "examples" / name), *words]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_log_is_replayed(tmp_path: Path) -> None:
    """The demo's elbow rubs: it is further off than the shoulder."""
    said = dict(re.findall(r"(\w+): ([\d.]+) mrad", run("replay_a_log.py", tmp_path)))
    assert float(said["elbow"]) > float(said["shoulder"]) > 1


def test_a_servo_is_recorded(tmp_path: Path) -> None:
    """An emulated servo swings by 0.3 rad, and its log can be read."""
    run("record_a_servo.py", tmp_path, "swing.csv")
    log = read_log(tmp_path / "swing.csv")
    assert log.time[-1] > 3.8
    assert 0.2 < log.column("qpos.hinge").max() < 0.4


@pytest.mark.slow
def test_parameters_adapt(tmp_path: Path) -> None:
    """Thirty episodes gain most of what there is to gain."""
    before, after = map(float, re.findall(r"-\d\.\d+", run("adapt_in_episodes.py", tmp_path)))
    assert before == -0.14
    assert after > -0.05


@pytest.mark.slow
def test_another_librarys_world_is_trained_on(tmp_path: Path) -> None:
    """Ten iterations on Gymnasium's pendulum leave metrics and a policy."""
    run("train_elsewhere.py", tmp_path)
    out = tmp_path / "outputs" / "elsewhere"
    rows = (out / "metrics.csv").read_text().splitlines()
    assert len(rows) == 11
    assert list((out / "checkpoints").iterdir())
