"""Which effects pass for another: found by fitting each alone."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.effects import make
from hardware.excite import ExcitationPlan
from sim2real.exam.logs import drive, exam_robot, plans
from sim2real.exam.refit import RIVAL_FLOORS, fit, rivals

FLOOR = 1.6e-3  # rad


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory):
    """The bench."""
    return exam_robot("bench1", tmp_path_factory.mktemp("bench1"))


def rng() -> np.random.Generator:
    """Return what says where fits look."""
    return np.random.default_rng(0)


@pytest.mark.slow
def test_a_payload_passes_for_a_heavier_link_and_a_play_does_not(robot) -> None:
    """On a pendulum both masses pull alike; nothing else has that shape."""
    plan = plans(robot, 1)["a"]
    hidden = {"effect": "payload", "where": "arm", "value": 0.02}
    log = drive(robot, [hidden], ExcitationPlan(plan.angles[:150], plan.torque[:150]), 1)
    spec = mujoco.MjSpec.from_file(str(robot.model))
    found = [
        fit(robot, spec, effect, log, RIVAL_FLOORS * FLOOR, np.random.default_rng(0))
        for effect in (make("link_mass", where="arm"), make("dead_zone", where="hinge"))
    ]
    mass, play = found
    assert mass is not None and play is not None
    assert mass.left <= RIVAL_FLOORS * FLOOR < play.left


def test_rivals_act_where_they_could_pass(tmp_path: Path) -> None:
    """At the joint, on both sides of a play, on the bodies of its chain, on the whole robot."""
    arm = exam_robot("arm6", tmp_path)
    truth = {"effect": "backlash", "where": "elbow", "joint": "elbow"}
    assert [one.side for one in rivals(arm, "joint_compliance", truth)] == ["motor", "link"]
    assert [one.where for one in rivals(arm, "supply_sag", truth)] == [None]
    bodies = {one.where for one in rivals(arm, "payload", truth)}
    assert bodies == {"turret", "upper_arm", "forearm", "hand", "palm", "finger"}


def test_an_effect_that_the_robot_cannot_have_is_no_rival(robot) -> None:
    """A factor on a gain that is 0 changes nothing, and is refused."""
    plan = plans(robot, 1)["a"]
    log = drive(robot, [], ExcitationPlan(plan.angles[:20], plan.torque[:20]), 1)
    spec = mujoco.MjSpec.from_file(str(robot.model))
    assert fit(robot, spec, make("derivative_gain", where="hinge"), log, 1.0, rng()) is None
