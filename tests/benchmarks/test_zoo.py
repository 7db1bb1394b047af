"""The zoo's models move, and what a diagnosis comes to is told as it is."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.zoo.__main__ import main, outcome
from benchmarks.zoo.drive import Hidden, drive
from benchmarks.zoo.models import models
from hardware.log import read_log

HIDDEN = Hidden("b", 0.1, ("b", "low", "servo_b"))


def test_there_are_thirty_models_with_names_of_their_own() -> None:
    """At least so many, wherever Drake cannot be installed too."""
    names = [model.name for model in models() if model.source != "Drake"]
    assert len(set(names)) == len(names) >= 30


@pytest.mark.parametrize("name", ["joint_ball", "actuator_velocity", "equality_joint", "swimmer"])
def test_a_log_shows_the_friction_that_it_hides(name: str, tmp_path: Path) -> None:
    """The joint is there, what moves it is stronger than what it hides, and all of it is logged."""
    [model] = [model for model in models() if model.name == name]
    log = tmp_path / "log.csv"
    hidden = drive(model.write(tmp_path), log, np.random.default_rng(1))
    told = read_log(log)
    assert hidden.friction > 0
    assert hidden.joint in hidden.places
    assert np.ptp(told.column(f"qpos.{hidden.joint}")) > 0.02
    assert told.time[-1] == pytest.approx(7.99)


def done(status: int, said: str = "") -> subprocess.CompletedProcess[str]:
    """Return how a command ended."""
    return subprocess.CompletedProcess([], status, "", said)


@pytest.mark.parametrize(
    ("causes", "expected"),
    [
        ([("coulomb_friction", "b")], "right"),
        ([("motor_strength", "servo_b")], "right"),
        ([("coulomb_friction", "a"), ("coulomb_friction", "b")], "wrong"),
        ([("command_delay", None)], "wrong"),
        ([], "none"),
    ],
)
def test_the_first_cause_decides(tmp_path: Path, causes: list[Any], expected: str) -> None:
    """Its joint, body or actuator; a cause of the whole robot is at no joint."""
    entries = [{"effect": effect, "where": where, "value": 0.1} for effect, where in causes]
    told = {"causes": entries, "fitted": [], "verdict": "explained", "gap": {"closed": 0.9}}
    report = tmp_path / "report.json"
    report.write_text(json.dumps(told))
    assert outcome(done(0), report, HIDDEN)["outcome"] == expected


def test_a_refusal_is_no_failure(tmp_path: Path) -> None:
    """A sentence and status 2 refuse; any other status is a failure, with what was said."""
    said = "warning\nsim2real: arm.xml: no\nactuators\n"
    refused = outcome(done(2, said), tmp_path, HIDDEN)
    assert refused == {"outcome": "refused", "told": "arm.xml: no actuators"}
    assert outcome(done(1, "Traceback"), tmp_path, HIDDEN)["outcome"] == "failed"


def test_an_unknown_model_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """With those that there are."""
    with pytest.raises(SystemExit):
        main(["--only", "elephant"])
    assert "no model 'elephant'; there are: ant, half_cheetah" in capsys.readouterr().err


@pytest.mark.slow
def test_a_model_goes_through_the_whole_diagnosis(tmp_path: Path) -> None:
    """A hidden friction of a slide is found by the command that a user types."""
    folders = ["--out", str(tmp_path / "zoo"), "--results", str(tmp_path)]
    assert main(["--only", "joint_slide", *folders]) == 0
    assert "1 of the other 1" in (tmp_path / "zoo.md").read_text(encoding="utf-8")
