"""Improve by returns: trainings under distributions, judged on a target or on the emulated bus."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.distribution import Distribution
from envs.distribution_file import read
from sim2real.config.compose import compose, instantiate
from sim2real.runs.checkpoint import find, read_metadata
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import train

pytest.importorskip("botorch", reason="pip install 'sim2real[botorch]'")

from sim2real.loops.improve import steps
from sim2real.verbs.improve import run

SHORT = ["run=improve", "by=returns", "iterations=1", "trials=2", "algorithm.pairs=2"]
SHORT += ["keep_checkpoints=1", "bayrn.first=2", "bayrn.rounds=3"]
HOPPER = ["env=hopper_polito", "params=udr", "+env@target=hopper_polito"]
HOPPER += ["target.task.domain=target"]


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return what robots each training met."""
    met, real = [], steps.train

    def train(**settings: Any) -> Any:
        met.append(settings["parts"].tasks)
        return real(**settings)

    monkeypatch.setattr(steps, "train", train)
    return met


def go(out: Path, *words: str, **more: Any) -> Any:
    """Run the verb."""
    verb, arguments = instantiate(compose([*SHORT, *words]), out)
    assert verb is run
    return run(**arguments | more)


def test_each_round_trains_under_what_was_asked(tmp_path: Path, worlds: list[Any]) -> None:
    """Three policies on the target; the best is the answer, and nothing is done twice."""
    found = go(tmp_path, *HOPPER)
    assert len(worlds) == 3 and all(isinstance(one, Distribution) for one in worlds)
    for number, (met, asked) in enumerate(zip(worlds, found.tried, strict=True), start=1):
        np.testing.assert_allclose(met.mean, asked.mean)
        np.testing.assert_allclose(
            read(tmp_path / f"{number:02d}" / "distribution.yaml").std, met.std
        )
    np.testing.assert_allclose(read(tmp_path / "distribution.yaml").mean, found.result.mean)
    assert len(set(found.values)) == 3
    again = go(tmp_path / "other", *HOPPER, resume=str(tmp_path))
    assert len(worlds) == 3 and again.values == found.values


@pytest.mark.slow
def test_an_emulated_robot_pays_returns_too(tmp_path: Path, worlds: list[Any]) -> None:
    """Episodes over its bus; each round keeps its logs."""
    found = go(
        tmp_path, "env=hopper2", "params=hopper2_dr", "robot=hopper2", "env.task.seconds=0.4"
    )
    assert np.isfinite(found.values).all()
    assert len(list((tmp_path / "03" / "deploy" / "logs").glob("*.csv"))) == 2


def test_what_cannot_be_searched_is_refused(tmp_path: Path) -> None:
    """Without ranges, without trials, on a robot that people stand beside."""
    with pytest.raises(Sim2RealError, match="ranges of a randomization"):
        go(tmp_path, *HOPPER, "params=none")
    with pytest.raises(Sim2RealError, match="trials=1"):
        go(tmp_path, *HOPPER, trials=1)
    with pytest.raises(Sim2RealError, match="arm=true"):
        go(tmp_path, "env=hopper2", "params=hopper2_dr", "robot=hopper2", "port=/dev/there-is-none")


def test_an_operator_s_no_ends_it(tmp_path: Path, worlds: list[Any], monkeypatch) -> None:
    """A real robot is asked for before each deployment; what was trained stays."""
    monkeypatch.setattr("builtins.input", lambda question: "n")
    words = ("env=hopper2", "params=hopper2_dr", "robot=hopper2", "env.task.seconds=0.4")
    found = go(tmp_path, *words, "port=/dev/there-is-none", "arm=true")
    assert found.values == [] and len(worlds) == 1
    assert (tmp_path / "01" / "checkpoints").is_dir()


def test_a_policy_that_is_given_is_trained_on(tmp_path: Path, worlds: list[Any]) -> None:
    """Each round adds its iterations to those of the checkpoint, from its parameters."""
    given = train(tmp_path / "run", [*HOPPER[:2], "iterations=2", "algorithm.pairs=2"])
    found = go(tmp_path / "out", *HOPPER[2:], f"checkpoint={given}")
    assert len(found.values) == 3 and len(worlds) == 3
    assert read_metadata(find(tmp_path / "out" / "01"))["iteration"] == 3
