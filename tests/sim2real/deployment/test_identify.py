"""`deploy adapt=identify`: on the emulated servo bus the policy is told what its logs say."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.tasks import Bench1, Quad8
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.exported import ExportedPolicy, PolicyError
from hardware.rows import RobotRows
from sim2real.deployment.deploy import check_base
from sim2real.deployment.trained import load_policy
from sim2real.learning.adapt import Identify, NoAdaptation
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import SMALL_ES, run_verb, train

TOLD = [w for w in SMALL_ES if not w.startswith("env.task")] + ["env.task.seconds=1.5"]
TOLD += ["params=bench1_dr", "transforms=with_params"]
HIDDEN = """\
- {effect: link_mass, where: arm, value: 0.12}
- {effect: viscous_friction, value: 0.015}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a small training of a policy that is told friction and mass."""
    return train(tmp_path_factory.mktemp("told") / "run", TOLD)


def deployed(run: Path, out: Path, *words: str) -> Any:
    """Deploy it on an emulated robot that hides a mass and friction; return the deployment."""
    hidden = out.parent / "hidden.yaml"
    hidden.write_text(HIDDEN, encoding="utf-8")
    given = ["run=deploy", f"checkpoint={run}", "robot=bench1", f"robot.hidden={hidden}"]
    return run_verb([*given, "trials=1", "settle=0.1", *words], out)


@pytest.mark.slow
def test_the_hidden_robot_is_found_on_the_bus_and_resumed(run: Path, tmp_path: Path) -> None:
    """From the bytes of two episodes to what was hidden, within a fortieth of the prior."""
    first = deployed(run, tmp_path / "a", "adapt=identify", "adapt.episodes=2")
    assert first.session.names == ("viscous_friction", "link_mass.arm")
    off = np.abs(first.session.history[-1] - [0.015, 0.12]) / [0.03, 0.23]
    assert off.max() < 1 / 40
    rows = (tmp_path / "a" / "parameters.csv").read_text().splitlines()
    assert rows[0] == "episode,viscous_friction,link_mass.arm" and len(rows) == 3
    again = deployed(
        run, tmp_path / "b", "adapt=identify", "adapt.episodes=2", f"resume={tmp_path / 'a'}"
    )
    np.testing.assert_array_equal(again.session.result, first.session.result)
    assert again.after == first.after


def test_a_policy_that_is_told_nothing_cannot_identify(tmp_path: Path) -> None:
    """Refused before the robot moves, with what to train instead."""
    plain = train(tmp_path / "run", SMALL_ES)
    with pytest.raises(Sim2RealError, match="transforms=with_params"):
        deployed(plain, tmp_path / "out", "adapt=identify")


def test_a_robot_whose_base_nothing_tells_is_refused() -> None:
    """An IMU and the feet say where a walking robot's base is; servos alone do not."""
    operator = Identify(episodes=1, last=1, find=lambda environment, logs, seed: np.zeros(1))
    walker = RobotRows(Quad8(), ServoBackend(load_robot("quad8"), 0.1))
    check_base(RobotRows(Bench1(), ServoBackend(load_robot("bench1"), 0.1)), operator)
    check_base(walker, operator)
    walker.backend.robot = replace(walker.backend.robot, imu=None)
    check_base(walker, NoAdaptation())
    with pytest.raises(
        Sim2RealError, match="quad8 moves at root, which no servo reads, and no IMU"
    ):
        check_base(walker, operator)


def test_an_export_says_which_parameters_it_needs(run: Path, tmp_path: Path) -> None:
    """They stand behind the observation, with unit and range; without them it computes nothing."""
    run_verb(["run=export", f"checkpoint={run}"], tmp_path / "export")
    policy = ExportedPolicy.load(tmp_path / "export")
    assert policy.names[-2:] == ["viscous_friction", "link_mass.arm"]
    assert policy.parameters[1] == {
        "name": "link_mass.arm",
        "unit": "kg",
        "how": "add",
        "low": -0.03,
        "high": 0.2,
    }
    with pytest.raises(PolicyError, match=r"link_mass\.arm"):
        policy(np.zeros(6))
    trained = load_policy(run)
    raw = np.array([[0.3, -1.0, 0.2, 0.1, 0.0, 0.0]])
    said = trained.context.normalize(np.array([0.02, 0.1]), 1.0)  # type: ignore[union-attr]
    wanted = trained.controller(said=said)(raw)
    np.testing.assert_allclose(policy(np.hstack([raw, [[0.02, 0.1]]])), wanted, atol=1e-5)
