"""The experiment that is named tells explanations apart, and the robot can be driven along it."""

from collections.abc import Sequence
from typing import get_args

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.plant import Fixed
from envs.replay import Recording, with_impedance
from hardware.config import load_robot
from hardware.excite import Kind
from sim2real.deployment.record import record_motions
from sim2real.diagnosis.experiments.apart import Member
from sim2real.diagnosis.experiments.menu import Item, menu
from sim2real.diagnosis.experiments.next_experiment import (
    Experiment,
    _Near,
    _repeat_gains,
    next_experiment,
    stand_in,
)
from sim2real.diagnosis.settings import DEFAULT
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import motors

FLOOR = {"hinge": 5e-4}


def member(name: str, values: list[float], **where) -> Member:
    """Return an explanation of one effect."""
    return Member(name, ((make(name, **where), values),))


def ask(
    *members: Member, robot: str = "bench1", fixed: Sequence[Fixed] = (), exact: int = 0
) -> Experiment:
    """Return the experiment for a robot's model with some known effects."""
    machine = load_robot(robot)
    spec = mujoco.MjSpec.from_file(str(machine.model))
    rng = np.random.default_rng(0)
    given = {"rng": rng, "robot": machine, "fixed": fixed, "exact": exact}
    return next_experiment(members, spec, FLOOR, **given)


PAIR = (
    member("viscous_friction", [0.02], where="hinge"),
    member("motor_strength", [0.8], where="hinge"),
)
SAME = (member("encoder_offset", [0.05], where="hinge"), member("gravity_tilt", [0.0, 0.05]))


@pytest.fixture(scope="module")
def plan() -> Experiment:
    """Return the experiment that tells friction from a weaker motor."""
    return ask(*PAIR)


@pytest.fixture(scope="module")
def none() -> Experiment:
    """Return what is said of two that are one."""
    return ask(*SAME)


@pytest.mark.slow
def test_fast_motion_and_free_swings_tell_friction_from_a_weaker_motor(plan: Experiment) -> None:
    """Slow ramps ask little of either; a chirp is braked by one, and without torque one is gone."""
    ranked = dict(plan.ranking)
    assert min(ranked["a chirp"], ranked["swings with the torque off"]) > 100
    assert ranked["slow ramps with reversals"] < 30
    assert plan.item.motions in [("chirp",), ("swing",)]
    assert f"run=record robot=bench1 motions=[{plan.item.motions[0]}]" in plan.text


@pytest.mark.slow
def test_more_of_a_known_effect_is_an_explanation(plan: Experiment) -> None:
    """An explanation may add to what is known at its joint."""
    known = [(make("viscous_friction", where="hinge"), (0.01,))]
    assert 10 < ask(*PAIR, fixed=known).separation < plan.separation


def test_drawn_motions_are_named_so_that_record_repeats_them() -> None:
    """Where the menu's motions are too long, drawn ones part explanations; none is too long."""
    pair = (
        member("coulomb_friction", [0.03], where="hinge"),
        member("viscous_friction", [0.05], where="hinge"),
    )
    machine = load_robot("bench1")
    spec = mujoco.MjSpec.from_file(str(machine.model))
    given = {"robot": machine, "by_hand": False, "draws": 12, "longest": 4.0}
    plan = next_experiment(pair, spec, FLOOR, rng=np.random.default_rng(0), **given)
    assert 0 < len(plan.ranking) < 12
    assert plan.separation > 10
    item = plan.item
    assert f"seconds=4 size={item.size:g} seed={item.seed}`" in plan.text
    assert f"{item.size:.0%}" in item.name


def test_joints_under_impedance_control_move_with_their_usual_gains() -> None:
    """A command alone says nothing there: gains are the recordings', and no torque is sent."""
    gains = {"a": (6.0, 0.4), "b": (4.0, 0.2)}
    spec = with_impedance(motors.spec(), gains)
    time = np.arange(100) / motors.RATE
    law = np.zeros((100, 2, 4))
    law[..., :2], law[:10, :, 3] = list(gains.values()), 0.3
    past = Recording(time, np.sin(3 * time)[:, None] * [0.4, -0.3], *np.zeros((2, 2)), law=law)
    pair = (
        member("coulomb_friction", [0.05], where="a"),
        member("viscous_friction", [0.08], where="a"),
    )
    rng, floor = np.random.default_rng(0), dict.fromkeys("ab", 5e-4)
    plan = next_experiment(pair, spec, floor, rng=rng, past=[past], by_hand=False, longest=8.0)
    assert plan.separation > 3
    usual = _repeat_gains([past], 7)
    assert usual is not None
    assert usual.shape == (7, 2, 4)
    np.testing.assert_array_equal(usual[3], [[6.0, 0.4, 0.0, 0.0], [4.0, 0.2, 0.0, 0.0]])
    assert _repeat_gains([past._replace(law=None)], 7) is None


def test_the_shortest_motion_that_is_enough_is_worth_most() -> None:
    """Beyond what surely parts them seconds count; short of it evidence by its time."""
    sure = DEFAULT.experiment.apart_sure
    short, long = Item("short", ("ramp",), 4.0), Item("long", ("steps",), 16.0)
    by_hand = Item("by hand", ("hold",), 4.0, by_hand="tilt the base")

    def best(*scored: tuple[Item, float]) -> str:
        scores = {item: np.array([floors]) for item, floors in scored}
        return max(scores.items(), key=_Near(DEFAULT.experiment, scores).worth)[0].name

    assert best((short, 1.1 * sure), (long, 9 * sure), (by_hand, 20 * sure)) == "short"
    assert best((short, 0.9 * sure), (long, 1.1 * sure), (by_hand, 2 * sure)) == "long"
    assert best((short, 0.5 * sure), (long, 0.9 * sure), (by_hand, 0.99 * sure)) == "long"


def test_a_pair_that_no_motion_parts_has_no_say() -> None:
    """The others decide what a motion is worth; nothing is gained by one that parts them less."""
    sure = DEFAULT.experiment.apart_sure
    scores = {
        Item("long", ("steps",), 16.0): np.array([2 * sure, 1e-9, 2 * sure]),
        Item("short", ("ramp",), 4.0): np.array([0.4 * sure, 2e-9, 0.4 * sure]),
        Item("one pair", ("hold",), 4.0): np.array([9 * sure, 1e-9, 0.0]),
    }
    near = _Near(DEFAULT.experiment, scores)
    assert near.parted.tolist() == [True, False, True]
    assert near.most == 9 * sure
    assert [near.least(found) for found in scores.values()] == [2 * sure, 0.4 * sure, 0.0]
    ranked = sorted(scores.items(), key=near.worth, reverse=True)
    assert [item.name for item, _ in ranked] == ["long", "one pair", "short"]
    none = _Near(DEFAULT.experiment, {item: 0.1 * found[1:2] for item, found in scores.items()})
    assert not none.parted.any()
    assert none.least(np.array([1.0, 2.0])) == 2.0


@pytest.mark.slow
def test_explanations_that_no_motion_separates_are_called_so(none: Experiment) -> None:
    """A pendulum whose encoder is shifted and one on a tilted base are one and the same."""
    assert "no motion that was looked at separates them" in none.text
    assert none.separation <= none.most < 1


@pytest.mark.slow
@pytest.mark.parametrize("exact", [0, 1])
def test_two_that_are_one_do_not_hide_what_can_be_parted(exact: int, none: Experiment) -> None:
    """A shifted encoder and a tilted base are one; friction is parted from both all the same."""
    other = member("viscous_friction", [0.05], where="hinge")
    plan = ask(*SAME, other, exact=exact)
    assert plan.most >= plan.separation > DEFAULT.experiment.apart_sure
    assert (
        "but no motion that was looked at separates encoder_offset from gravity_tilt" in plan.text
    )
    assert (ask(*SAME, exact=exact) if exact else none).most < 1


@pytest.mark.slow
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
    assert set(plan.item.motions) <= set(get_args(Kind))
    log = record_motions(load_robot("bench1"), plan.item.motions, 2.0, np.random.default_rng(0))
    assert len(log) == 100
    assert f"motions=[{','.join(plan.item.motions)}]" in plan.text


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
