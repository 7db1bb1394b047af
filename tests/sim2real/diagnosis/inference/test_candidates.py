"""Candidates: what can stand beside what is known already."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from hardware.config import load_robot
from hardware.log import Log
from hardware.stand import write_stand_model
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.candidates import Candidate, candidates
from tests.sim2real.diagnosis import arm, motors


def test_further_scalars_are_fitted_between_bounds(tmp_path: Path) -> None:
    """Stribeck's speed and the external torque's part are values of their own, within bounds."""
    robot = write_stand_model(load_robot("bench1"), tmp_path)
    time = np.arange(300) / 50
    columns = {"episode": np.zeros(300, int), "time": time}
    columns |= {"ctrl.hinge": np.sin(2 * time), "qpos.hinge": 0.9 * np.sin(2 * time)}
    data = Data.of([Log(columns, {"model": str(robot.model)}, Path("log.csv"))], robot.model)
    found = {option.name: option for option in candidates(data) if option.effect.free}
    scaled = {"cogging", "joint_compliance", "load_dependent_friction", "stribeck_friction"}
    scaled |= {"torque_speed_knee", "hysteretic_compliance", "encoder_eccentricity"}
    scaled |= {"dead_zone", "asymmetric_friction", "thermal_derating", "integral_action"}
    assert set(found) == scaled
    stribeck = found["stribeck_friction"]
    assert stribeck.low[1] > 0.01 and stribeck.high[1] < 10.0  # rad/s
    assert np.ptp(stribeck.probes[:, 1]) > 0
    assert (stribeck.towards(np.array([0.1, 0.3, 0.0]), 2.0) == [0.2, 0.3, 0.0]).all()


def test_what_acts_more_as_it_shrinks_does_not_pass_zero() -> None:
    """A limit grows tighter in proportion; friction, or a factor above 1, along a line."""

    def option(name: str, neutral: float, low: float) -> Candidate:
        limits = (np.array([v]) for v in (neutral, low, 10.0))
        return Candidate(make(name, where="hinge"), "hinge", np.zeros((1, 1)), *limits, group="")

    limit, friction = option("torque_limit", 2.0, 0.0), option("coulomb_friction", 0.0, 0.0)
    factor, offset = option("position_gain", 1.0, 0.0), option("encoder_offset", 0.0, -1.0)
    assert limit.towards(np.array([0.08]), 1.1) == pytest.approx(0.08 / 1.1)  # a line gives -0.11
    assert limit.towards(np.array([1.4]), 1.1) == pytest.approx(2.0 - 1.1 * 0.6)
    assert limit.towards(np.array([0.08]), 0.5) == pytest.approx(2.0 - 0.5 * 1.92)
    assert factor.towards(np.array([2.0]), 1.5) == pytest.approx(2.5)
    assert friction.towards(np.array([0.1]), 2.0) == pytest.approx(0.2)
    assert offset.towards(np.array([-0.1]), 2.0) == pytest.approx(-0.2)


def test_what_is_known_and_cannot_be_doubled_is_no_candidate(tmp_path: Path) -> None:
    """More friction may be missing beside a known one; a second law of the same rule cannot be."""
    robot = write_stand_model(load_robot("bench1"), tmp_path)
    time = np.arange(300) / 50
    columns = {"episode": np.zeros(300, int), "time": time}
    columns |= {"ctrl.hinge": np.sin(2 * time), "qpos.hinge": 0.9 * np.sin(2 * time)}
    data = Data.of([Log(columns, {"model": str(robot.model)}, Path("log.csv"))], robot.model)
    known = [
        (make("coulomb_friction", where="hinge"), (0.01,)),
        (make("load_dependent_friction", where="hinge"), (0.2,)),
    ]
    free = {option.name for option in candidates(data)}
    left = {option.name for option in candidates(data, fixed=known)}
    assert free - left == {"load_dependent_friction"}
    assert "coulomb_friction" in left


def test_a_speed_limit_that_only_steps_reach_is_probed(tmp_path: Path) -> None:
    """A jump of 0.5 rad within a command asks for 25 rad/s where the rest moves at 2 rad/s."""
    robot = write_stand_model(load_robot("bench1"), tmp_path)
    time = np.arange(300) / 50
    smooth = np.sin(2 * time)
    probes = {}
    for name, jump in (("smooth", 0.0), ("steps", 0.5)):
        goal = smooth + jump * (time > 3)
        columns = {"episode": np.zeros(300, int), "time": time}
        columns |= {"ctrl.hinge": goal, "qpos.hinge": 0.9 * smooth}
        data = Data.of([Log(columns, {"model": str(robot.model)}, Path("log.csv"))], robot.model)
        found = {option.name: option for option in candidates(data)}
        probes[name] = found["profile_velocity"].probes[:, 0]
    assert probes["smooth"].max() < 2.0
    assert 4.0 < probes["steps"].max() < 20.0
    assert probes["steps"][:-1] == pytest.approx(probes["smooth"], rel=0.05)


def test_knees_are_probed_where_the_joint_was_fast_whatever_the_commands(tmp_path: Path) -> None:
    """A motor's commands are torques, whose change is no speed: half of what a joint reaches."""
    log = arm.make_log(seconds=4.0)
    time, fast = log.time, 3.0
    swing = fast / 2 * np.sin(2.0 * time)  # rad: 3 rad/s at most, nearly so for a while
    columns = {**log.columns, "qpos.a": swing, "ctrl.a": 100.0 * log.columns["ctrl.a"]}
    data = arm.data_of(Log(columns, log.meta), tmp_path)
    (option,) = (one for one in candidates(data) if one.label == "torque_speed_knee.a")
    knees = option.probes[:, 0]
    assert knees.min() == pytest.approx(0.35 * fast, rel=0.02)
    assert knees.max() == pytest.approx(fast, rel=0.02)
    assert ((knees > 0.5 * fast) & (knees < 0.8 * fast)).sum() >= 2


@pytest.mark.parametrize("name", ["backlash", "joint_compliance", "hysteretic_compliance"])
def test_where_encoders_sit_is_tried_where_it_matters(tmp_path: Path, name: str) -> None:
    """The servo's encoder and the log's are two choices; a motor without a loop has only one.

    All three are tried on the same sides: else one is taken for another.
    """

    def sides(data: Data) -> set[tuple[str | None, str | None]]:
        plays = [c.effect for c in candidates(data) if c.name == name and c.effect.where == "a"]
        return {(play.side, play.options().get("encoder")) for play in plays}

    one = {("motor", None), ("link", None)}
    two = {("motor", "link"), ("link", "motor")}
    assert sides(arm.data_of(arm.make_log(seconds=4.0), tmp_path)) == one | two
    log = motors.make_log(0.0, 4.0)
    assert sides(Data.of([log], motors.model(tmp_path))) == one


def test_one_value_for_all_joints_is_a_candidate_where_there_are_several(tmp_path: Path) -> None:
    """A batch of weak motors is one cause; a wrong zero is each joint's own."""
    found = {c.label: c for c in candidates(arm.data_of(arm.make_log(seconds=4.0), tmp_path))}
    assert {"motor_strength", "position_gain", "coulomb_friction", "thermal_derating"} <= set(found)
    assert not {"encoder_offset", "cogging", "asymmetric_friction"} & set(found)
    wide = found["motor_strength"]
    assert (wide.effect.where, wide.joint, wide.joints) == (None, None, ())
    np.testing.assert_array_equal(wide.probes, found["motor_strength.a"].probes)
    assert found["thermal_derating"].probes.max() == pytest.approx(
        min(found[f"thermal_derating.{name}"].probes.max() for name in "ab")
    )

    robot = write_stand_model(load_robot("bench1"), tmp_path)
    time = np.arange(300) / 50
    columns = {"episode": np.zeros(300, int), "time": time}
    columns |= {"ctrl.hinge": np.sin(2 * time), "qpos.hinge": 0.9 * np.sin(2 * time)}
    data = Data.of([Log(columns, {"model": str(robot.model)}, Path("log.csv"))], robot.model)
    assert "motor_strength" not in {option.label for option in candidates(data)}


def test_what_every_probe_leaves_as_it_is_has_a_step_as_well(tmp_path: Path) -> None:
    """A ripple's count is neutral in all its probes; a fit that starts there has to move it."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    (ripple,) = (c for c in candidates(data) if c.label == "cogging.a")
    assert (ripple.probes[:, 1] == ripple.neutral[1]).all()
    assert (ripple.step > 0).all()


def test_masses_are_probed_as_finely_as_strengths(tmp_path: Path) -> None:
    """A few per cent shift a whole motion: 4 g less were explained as a strong motor and a rotor.

    From a quarter of the mass no straight line leads there.
    """
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    found = {option.label: option for option in candidates(data)}
    own = float(data.models[0].body("lower").mass[0])
    weights = np.sort(np.abs(found["link_mass.lower"].probes.ravel()))
    assert weights[0] <= 0.05 * own and (found["link_mass.lower"].probes < 0).sum() >= 2
    strengths = np.abs(found["motor_strength.a"].probes.ravel() - 1)
    assert strengths.min() <= 0.05
