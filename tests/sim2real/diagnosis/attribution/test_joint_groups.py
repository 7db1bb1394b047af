"""One kind of effect at every joint: found side by side where single effects are too few."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.joint_groups import _Families, by_family, families, is_spread
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator

JOINTS = ("base", "elbow", "wrist")
GAINS, FRICTION = (6.0, 3.0, 1.5), (0.15, 0.1, 0.05)
STIFF = 100.0  # N·m/rad that the model has
RATE, SECONDS = 50, 36.0


def arm(gains: tuple[float, ...], friction: tuple[float, ...]) -> str:
    """Return an MJCF of three pendulums with position servos, each its own."""
    bodies = "".join(
        f'<body name="{name}_link" pos="0 {i} 0"><joint name="{name}" axis="0 1 0" damping="0.2" '
        f'armature="0.01" frictionloss="{rub}"/><geom type="capsule" size="0.02" '
        'fromto="0 0 0 0.15 0 0" mass="0.4" contype="0" conaffinity="0"/></body>'
        for i, (name, rub) in enumerate(zip(JOINTS, friction, strict=True))
    )
    servos = "".join(
        f'<position name="{name}" joint="{name}" kp="{gain}" forcerange="-3 3"/>'
        for name, gain in zip(JOINTS, gains, strict=True)
    )
    stiff = '<default><joint solimpfriction="0.9999 0.9999 0.001"/></default>'
    options = '<option timestep="0.004"/>'
    return (
        f"<mujoco>{options}{stiff}<worldbody>{bodies}</worldbody>"
        f"<actuator>{servos}</actuator></mujoco>"
    )


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> Search:
    """Three soft, rubbing servos, and a model in which all are stiff and none rubs."""
    model = mujoco.MjModel.from_xml_string(arm(GAINS, FRICTION))
    data = mujoco.MjData(model)
    time = np.arange(int(RATE * SECONDS)) / RATE
    rng = np.random.default_rng(0)
    goals = np.zeros((len(time), 3))
    for i in range(3):
        steps = np.repeat(rng.uniform(-0.8, 0.8, 60), 30)[: len(time)]
        goals[:, i] = np.where(time % 12 < 6, 0.6 * np.sin(time * (0.7 + 0.3 * i)), steps)
    seen = np.zeros_like(goals)
    for row, goal in enumerate(goals):
        seen[row] = data.qpos
        data.ctrl[:] = goal
        mujoco.mj_step(model, data, 5)
    seen = np.round(seen / (2 * np.pi / 4096)) * (2 * np.pi / 4096)
    columns = {"episode": np.zeros(len(time), int), "time": time}
    columns |= {f"ctrl.{name}": goals[:, i] for i, name in enumerate(JOINTS)}
    columns |= {f"qpos.{name}": seen[:, i] for i, name in enumerate(JOINTS)}
    path = tmp_path_factory.mktemp("arm") / "model.xml"
    path.write_text(arm((STIFF,) * 3, (0.0,) * 3))
    found = Data.of([Log(columns, {"model": str(path)}, Path("log.csv"))], path)
    kept = ("position_gain", "coulomb_friction", "viscous_friction", "encoder_offset")
    options = [o for o in candidates(found) if o.name in kept]
    rng = np.random.default_rng(0)
    return Search(Problem(found, Simulator(found)), options, 5e-4, rng, lambda text, share: None)


def test_families_are_kinds_at_joints(search: Search) -> None:
    """Each kind has a member for each joint; factors start from orders of magnitude too."""
    kinds = families(search)
    assert set(kinds) >= {"position_gain", "coulomb_friction", "viscous_friction"}
    assert [member.joint for member in kinds["position_gain"]] == list(JOINTS)
    assert kinds["position_gain"][0].probes.min() <= 0.02


def test_gains_come_first_with_what_every_servo_has(search: Search) -> None:
    """Gains, dry and viscous friction are tried together; once something joined, one by one."""
    state = _Families(search, np.random.default_rng(0))
    assert ("position_gain", "coulomb_friction", "viscous_friction") in state.choices(search.none)
    some = Fit((search.options[0],), np.zeros((2, 1)), np.zeros(2))
    assert all(len(choice) == 1 for choice in state.choices(some))


def test_friction_of_the_model_itself_is_tried_with_less(search: Search) -> None:
    """A joint whose model is damped may be damped too much."""
    damped = families(search)["viscous_friction"][0]
    assert damped.probes.min() == pytest.approx(-0.9 * 0.2)
    assert families(search)["coulomb_friction"][0].probes.min() > 0  # this model has none


def test_no_second_variant_of_an_effect_joins(search: Search) -> None:
    """What has joined leaves with all its variants, such as the other side of a spring."""
    state = _Families(search, np.random.default_rng(0))
    assert {"encoder_offset", "encoder_offset (log only)"} <= set(state.left)
    state.leave_out({"encoder_offset"})
    assert not any("encoder_offset" in kind for kind in state.left)
    assert "position_gain" in state.left


@pytest.mark.slow
def test_gains_and_frictions_of_all_joints_are_found(search: Search) -> None:
    """Six causes none of which closes the gap: gains within 15 %, frictions within 40 %."""
    nothing = Found(search.none, search.base)
    assert is_spread(search, nothing)
    found = by_family(search, nothing)
    assert search.blocks.rms(found.error) < 0.12 * search.before
    assert "position_gain.elbow" in search.best  # the progress tells it
    values = {m.label: v for m, v in zip(found.fit.members, found.fit.mean, strict=True)}
    for name, gain, rub in zip(JOINTS, GAINS, FRICTION, strict=True):
        assert values[f"position_gain.{name}"] * STIFF == pytest.approx(gain, rel=0.15)
        assert values[f"coulomb_friction.{name}"] == pytest.approx(rub, rel=0.4)


def test_a_gap_that_single_effects_close_is_none_of_families(search: Search) -> None:
    """Where little is left there is nothing to spread."""
    assert not is_spread(search, Found(search.none, 0.2 * search.base))
