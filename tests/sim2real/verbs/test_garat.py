"""The verb garat: it writes what transforms=grounded takes, and says what it lacks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.easi.demonstrations import demonstrate
from envs.torch_env import RowsEnv
from sim2real.config.compose import compose, prepare
from sim2real.learning.environment import make_env
from sim2real.learning.grounding import FILE, read
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs.garat import run

TINY = ["algorithm.num_rows=4", "algorithm.steps=32", "algorithm.minibatch_size=64", "frames=256"]
TINY += ["identify.score.updates=2", "identify.score.batch=64"]


def go(out: Path, *words: str) -> Path:
    """Run the verb on what the command line says."""
    verb, arguments = prepare(compose(["+experiment=garat", *TINY, *words]), out)
    assert verb is run
    return verb(**arguments)


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run of a policy that has hardly learned."""
    out = tmp_path_factory.mktemp("policy")
    words = ["env=cartpole", "params=none", "iterations=1", "algorithm.pairs=2", "video=none"]
    command = [sys.executable, "-m", "sim2real", *words, f"hydra.run.dir={out}"]
    subprocess.run(command, check=True, capture_output=True)
    return out


def test_it_writes_what_a_training_takes(tmp_path: Path, policy: Path) -> None:
    """The file is of the task's sizes; an environment with it steps, and shows what it did."""
    log = demonstrate(policy, 2, 0, tmp_path / "log.csv")
    path = go(tmp_path, f"checkpoint={policy}", f"log={log}")
    assert path == tmp_path / FILE and read(path).sizes == (4, 1)
    assert "train/critic_gap" in (tmp_path / "metrics.csv").read_text().splitlines()[0]
    words = ["env=cartpole", "transforms=grounded", f"transforms.ground.path={path}"]
    env = make_env(compose([*words, "+experiment=easi_cartpole", "params=none"]), 2)
    assert isinstance(env.base_env, RowsEnv)
    assert np.isfinite(env.rollout(3)["next", "observation"]).all()


def test_what_is_lacking_is_said(tmp_path: Path, policy: Path) -> None:
    """Demonstrations and their policy; a critic; steps."""
    with pytest.raises(Sim2RealError, match="log=PATH checkpoint=RUN"):
        go(tmp_path)
    known = (f"checkpoint={policy}", "log=x.csv")
    arguments = prepare(compose(["+experiment=garat", *known]), tmp_path)[1]
    arguments["identify"] = None
    with pytest.raises(Sim2RealError, match="score=critic_gp"):
        run(**arguments)
    with pytest.raises(Sim2RealError, match="frames=0"):
        go(tmp_path, *known, "frames=0")
