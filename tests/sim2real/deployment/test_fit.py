"""What is about to drive a robot is compared with it before anything moves."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from hardware.config import load_robot
from hardware.log import read_logs
from sim2real.deployment.fit import check_interface
from sim2real.deployment.trained import load_policy
from sim2real.learning.interface import FILE
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.checkpoint import find
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import SMALL_ES, run_verb, train


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A policy of evolution strategies for the bench."""
    return train(tmp_path_factory.mktemp("es") / "run", SMALL_ES)


@pytest.fixture(scope="module")
def policy(run) -> TrainedPolicy:
    """The same, loaded."""
    return load_policy(run)


def deploy(run: Path, out: Path, *words: str):
    """Deploy one episode as the command line does."""
    given = ["run=deploy", f"checkpoint={run}", "trials=1", "settle=0.1", *words]
    return run_verb(given, out)


def change(run: Path, out: Path, **changes) -> Path:
    """Return a copy of a run whose interface is another one."""
    shutil.copytree(run, out)
    block = json.loads((out / FILE).read_text()) | changes
    (out / FILE).write_text(json.dumps(block))
    return out


def test_training_writes_what_a_policy_sees_does_and_drives(run):
    """Names in order, rate, units, gains and limits stand in the run's folder."""
    block = json.loads((run / FILE).read_text())
    assert (block["robot"], block["rate"], block["units"]["angle"]) == ("bench1", 50.0, "rad")
    assert block["observation"][0] == "angle.hinge"
    assert len(block["action"]["low"]) == len(block["action"]["high"]) == 1
    hinge = block["servos"]["hinge"]
    assert hinge["gains"]["position_p_gain"] == 800
    assert hinge["limits"] == {"position": [-2.0, 2.0], "step": pytest.approx(0.16)}


def test_export_writes_the_same_block(run, tmp_path):
    """policy.json carries the interface of the run."""
    run_verb(["run=export", f"checkpoint={run}"], tmp_path)
    facts = json.loads((tmp_path / "policy.json").read_text())
    assert facts["policy_interface"] == json.loads((run / FILE).read_text())


def test_another_gain_is_refused_side_by_side(run, tmp_path):
    """A robot whose gains are not those of training is refused, both values beside each other."""
    words = r"servos\.hinge\.gains\.position_p_gain +800 +400"
    with pytest.raises(Sim2RealError, match=words):
        deploy(run, tmp_path / "a", "robot.registers.position_p_gain=400")
    assert not list((tmp_path / "a").glob("logs/*"))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"observation": ["speed.hinge", "angle.hinge"]}, r"observation\.0 +speed\.hinge +angle"),
        ({"rate": 100.0}, r"rate +100 +50"),
        ({"units": {"angle": "degree"}}, r"units\.angle +degree +rad"),
        ({"action": {"low": [-9.0], "high": [9.0]}}, r"action\.low\.0 +-9 "),
    ],
)
def test_what_cannot_be_meant_is_refused(run, policy, tmp_path, changes, words):
    """Another order, rate, unit or range of actions is refused."""
    other = replace(policy, source=find(change(run, tmp_path / "run", **changes)))
    with pytest.raises(Sim2RealError, match=words):
        check_interface(other, load_robot("bench1"))
    check_interface(policy, load_robot("bench1"))


def test_other_limits_are_said(policy, caplog):
    """A robot with narrower limits may run; both sides are shown."""
    robot = load_robot("bench1")
    (hinge,) = robot.servos
    check_interface(policy, replace(robot, servos=(replace(hinge, position=(-0.4, 2.0)),)))
    assert "in training" in caplog.text
    assert "servos.hinge.limits.position.0  -2           -0.4" in caplog.text


def test_a_policy_without_an_interface_is_refused_with_the_command(run, policy, tmp_path):
    """An old run is not deployed; export adds what today's files say, and then it is."""
    old = change(run, tmp_path / "run")
    (old / FILE).unlink()
    aged = replace(policy, source=find(old))
    with pytest.raises(Sim2RealError, match=r"run=export checkpoint=.*adds it"):
        check_interface(aged, load_robot("bench1"))
    run_verb(["run=export", f"checkpoint={old}"], tmp_path / "export")
    assert json.loads((old / FILE).read_text()) == json.loads((run / FILE).read_text())
    check_interface(aged, load_robot("bench1"))


def test_a_dry_run_says_what_it_would_have_commanded(run, tmp_path, caplog):
    """The whole loop runs with torque off, its log says so, and the goals are told."""
    with caplog.at_level("INFO"):
        deploy(run, tmp_path, "dry_run=true")
    (log,) = read_logs(tmp_path / "logs")
    assert not log.column("torque.hinge").any()
    assert abs(log.column("current.hinge")).max() == 0
    assert "hinge would have been commanded to" in caplog.text
    (row,) = csv.DictReader((tmp_path / "dry_run.csv").open())
    assert float(row["largest goal [rad]"]) == log.column("ctrl.hinge").max()
