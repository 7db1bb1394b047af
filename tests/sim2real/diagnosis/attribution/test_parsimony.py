"""As few values as the logs ask for: one for all joints, none that costs nothing to leave out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.parsimony import neutral, simplified
from sim2real.diagnosis.attribution.price import pays, worth
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm

FLOOR = 3e-4


def search_of(folder: Path, *hidden: tuple[str, dict, float], among: tuple[str, ...]) -> Search:
    """Return a search in a log of the arm, whose candidates are those of some labels."""
    data = arm.data_of(arm.make_log(*hidden, noise=FLOOR), folder)
    options = [c for c in candidates(data) if c.label in among]
    assert {c.label for c in options} == set(among)
    problem, rng = Problem(data, Simulator(data, threads=1)), np.random.default_rng(0)
    return Search(problem, options, FLOOR, rng, lambda text, share: None)


def found_of(search: Search, **values: float) -> Found:
    """Return what a search would come to with these values, by label without its dot."""
    named = {o.label.replace(".", "_"): o for o in search.options}
    members = tuple(named[name] for name in values)
    fit = Fit(members, np.tile(list(values.values()), (FOLDS, 1)), np.zeros(FOLDS))
    return Found(fit, search.problem.held_out(members, fit.values))


RUBS = ("coulomb_friction", "coulomb_friction.a", "coulomb_friction.b")


def test_what_all_joints_share_is_one_value(tmp_path: Path) -> None:
    """Two frictions of one size become one for the robot; its rivals are named."""
    search = search_of(tmp_path, ("coulomb_friction", {}, 0.1), among=RUBS)
    found = simplified(search, found_of(search, coulomb_friction_a=0.09, coulomb_friction_b=0.11))
    (member,) = found.fit.members
    assert (member.label, member.shared) == ("coulomb_friction", True)
    assert found.fit.mean == pytest.approx([0.1], rel=0.03)


def test_joints_that_differ_keep_their_own_values(tmp_path: Path) -> None:
    """A joint that rubs three times as much as its neighbour is no robot-wide friction."""
    hidden = [("coulomb_friction", {"where": joint}, v) for joint, v in (("a", 0.15), ("b", 0.05))]
    search = search_of(tmp_path, *hidden, among=RUBS)
    found = simplified(search, found_of(search, coulomb_friction_a=0.15, coulomb_friction_b=0.05))
    assert {m.label for m in found.fit.members} == set(RUBS[1:])


def test_what_helps_the_other_joints_too_is_of_the_whole_robot(tmp_path: Path) -> None:
    """Friction of both joints that was found at one; found at the one that has it, it stays."""
    search = search_of(tmp_path, ("coulomb_friction", {}, 0.1), among=RUBS)
    found = simplified(search, found_of(search, coulomb_friction_a=0.1))
    assert [m.label for m in found.fit.members] == ["coulomb_friction"]
    assert found.fit.mean == pytest.approx([0.1], rel=0.03)
    (tmp_path / "one").mkdir()
    hidden = ("coulomb_friction", {"where": "a"}, 0.1)
    search = search_of(tmp_path / "one", hidden, among=RUBS)
    found = simplified(search, found_of(search, coulomb_friction_a=0.1))
    assert [m.label for m in found.fit.members] == ["coulomb_friction.a"]


def test_gains_of_all_joints_are_one_strength(tmp_path: Path) -> None:
    """Weak motors, first told as gain and damping of each joint, are one cause of the robot."""
    among = ("motor_strength", "position_gain.a", "position_gain.b", "coulomb_friction.a")
    search = search_of(tmp_path, ("motor_strength", {}, 0.73), among=among)
    told = {"position_gain_a": 0.73, "position_gain_b": 0.73, "coulomb_friction_a": 1e-4}
    found = simplified(search, found_of(search, **told))
    assert [m.label for m in found.fit.members] == ["motor_strength"]
    assert found.fit.mean == pytest.approx([0.73], rel=0.02)
    assert "best so far: motor_strength, " in search.best  # the progress tells it


def test_a_value_that_costs_nothing_to_leave_out_is_left_out(tmp_path: Path) -> None:
    """Friction of nothing at the neighbour goes; the cause stays as it was."""
    among = ("coulomb_friction.a", "viscous_friction.b", "armature.b")
    search = search_of(tmp_path, ("coulomb_friction", {"where": "a"}, 0.1), among=among)
    told = {"coulomb_friction_a": 0.1, "viscous_friction_b": 2e-3, "armature_b": 1e-5}
    found = simplified(search, found_of(search, **told))
    assert [m.label for m in found.fit.members] == ["coulomb_friction.a"]
    assert found.fit.mean == pytest.approx([0.1], rel=0.03)


def test_the_price_is_told_at_the_joint(tmp_path: Path) -> None:
    """A value pays by what it closes where it acts; less where much is left, which it may mend."""
    search = search_of(
        tmp_path, ("coulomb_friction", {"where": "a"}, 0.1), among=("armature.a", "armature.b")
    )
    rows = search.problem.data.mask[..., None]

    def error(a: float, b: float) -> np.ndarray:
        return np.where(rows, np.array([a, b]), 0.0)

    search.base = error(30e-3, 0.0)
    assert worth(search, error(10e-3, 0.0), error(8.5e-3, 0.0)) < 1  # mends a bad fit
    assert worth(search, error(5e-3, 0.0), error(1.9e-3, 0.0)) > 1  # a tenth of the gap
    assert worth(search, error(5e-3, 0.0), error(2.1e-3, 0.0)) < 1
    assert pays(search, error(5e-3, 0.0), error(1e-3, 0.0))
    assert not pays(search, error(5e-3, 0.0), error(1e-3, 0.0), values=2)
    assert not pays(search, error(5e-3, 1e-3), error(1e-3, 9e-3))  # harms its neighbour more


def test_an_interval_that_holds_neutral_is_no_cause(tmp_path: Path) -> None:
    """All sizes count, whatever else is fitted along; a factor is neutral at one."""
    among = ("gravity_tilt", "position_gain.a", "joint_compliance.b (link side)")
    search = search_of(tmp_path, among=among)
    named = {o.label: o for o in search.options}
    fit = Fit(tuple(named[label] for label in among), np.zeros((FOLDS, 5)), np.zeros(FOLDS))
    tilt, gain, spring = [[-0.1, 0.1], [0.2, 0.3]], [[0.9, 1.1]], [[-0.01, 0.02], [0.3, 0.4]]
    assert neutral(fit, np.array([*tilt, *gain, *spring])) == [1, 2]
