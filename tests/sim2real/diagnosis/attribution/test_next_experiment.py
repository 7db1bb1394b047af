"""The experiment that is named tells explanations apart, and the robot can be driven along it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.plant import Fixed
from hardware.config import load_robot
from hardware.excite import Kind
from sim2real.deployment.record import drive
from sim2real.diagnosis.attribution.experiment_menu import menu
from sim2real.diagnosis.attribution.next_experiment import (
    Experiment,
    Member,
    next_experiment,
    stand_in,
)
from sim2real.runs.errors import Sim2RealError

FLOOR = {"hinge": 5e-4}


def member(name: str, values: list[float], **where) -> Member:
    """Return an explanation of one effect."""
    return Member(name, ((make(name, **where), values),))


def ask(*members: Member, robot: str = "bench1", fixed: Sequence[Fixed] = ()) -> Experiment:
    """Return the experiment for a robot's model with some known effects."""
    machine = load_robot(robot)
    spec = mujoco.MjSpec.from_file(str(machine.model))
    rng = np.random.default_rng(0)
    return next_experiment(members, spec, FLOOR, rng=rng, robot=machine, fixed=fixed)


def test_the_torque_off_swing_tells_friction_from_the_motors_own_braking() -> None:
    """Viscous friction brakes without torque, a weaker motor does not: the swing shows it best."""
    plan = ask(
        member("viscous_friction", [0.02], where="hinge"),
        member("motor_strength", [0.8], where="hinge"),
    )
    assert plan.motions == ("swing",)
    assert plan.separation == max(score for name, score in plan.ranking if "swings" in name)
    assert plan.separation > 10
    assert "run=record robot=bench1 motions=[swing]" in plan.text


def test_more_of_a_known_effect_is_an_explanation() -> None:
    """An explanation may add to what is known at its joint."""
    known = [(make("viscous_friction", where="hinge"), (0.01,))]
    plan = ask(
        member("viscous_friction", [0.02], where="hinge"),
        member("motor_strength", [0.8], where="hinge"),
        fixed=known,
    )
    assert plan.motions == ("swing",)


def test_explanations_that_no_motion_separates_are_called_so() -> None:
    """A pendulum whose encoder is shifted and one on a tilted base are one and the same."""
    plan = ask(member("encoder_offset", [0.05], where="hinge"), member("gravity_tilt", [0.0, 0.05]))
    assert "no motion of the menu separates them" in plan.text
    assert plan.separation < 1


def test_the_weakest_pair_of_three_decides() -> None:
    """With a third explanation like the second the separation is that of these two."""
    pair = (
        member("coulomb_friction", [0.03], where="hinge"),
        member("backlash", [0.03], where="hinge"),
    )
    twin = member("backlash", [0.0301], where="hinge")
    assert ask(*pair, twin).separation < 0.2 * ask(*pair).separation


def test_an_arm_that_would_fall_is_not_let_go() -> None:
    """No swing for a robot that leaves its pose without torque."""
    plan = ask(
        member("coulomb_friction", [0.1], where="elbow"),
        member("viscous_friction", [0.2], where="elbow"),
        robot="arm6",
    )
    assert all("swings" not in name for name, _ in plan.ranking)


def test_the_plan_can_be_recorded() -> None:
    """The emulated robot is driven along the motions that the plan names."""
    plan = ask(
        member("coulomb_friction", [0.03], where="hinge"),
        member("armature", [0.001], where="hinge"),
    )
    assert set(plan.motions) <= set(get_args(Kind))
    log = drive(load_robot("bench1"), plan.motions, 2.0, np.random.default_rng(0))
    assert len(log) == 100
    assert f"motions=[{','.join(plan.motions)}]" in plan.overrides


def test_a_model_alone_is_enough() -> None:
    """Without a robot's file the model's ranges limit the motions; the menu's changes compile."""
    machine = load_robot("bench1")
    spec = mujoco.MjSpec.from_file(str(machine.model))
    (servo,) = stand_in(spec).servos
    assert servo.position == (-2.2, 2.2)
    before = spec.to_xml()
    for item in menu(spec):
        if item.change is not None:
            changed = spec.copy()
            item.change(changed)
            assert changed.compile().nq == 1
            assert changed.to_xml() != before
    assert any(item.by_hand and "30 g" in item.by_hand for item in menu(spec))


def test_one_explanation_leaves_nothing_to_tell_apart() -> None:
    """That, and a model without servos, are refused with a sentence."""
    with pytest.raises(Sim2RealError, match="give two"):
        ask(member("backlash", [0.03], where="hinge"))
    with pytest.raises(Sim2RealError, match="no position actuator"):
        stand_in(mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>"))
