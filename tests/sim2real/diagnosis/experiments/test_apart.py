"""Explanations play against each other, and each refits before it is called apart."""

from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.replay import Recording
from hardware.config import load_robot
from sim2real.diagnosis.data.trial import trial
from sim2real.diagnosis.experiments.apart import Asked, Member, pairs, refitted, separation
from sim2real.diagnosis.experiments.menu import Item
from sim2real.diagnosis.experiments.next_experiment import record_of

NOISE = 5e-4  # rad


def member(name: str, *values: float) -> Member:
    """Return an explanation at the bench's hinge."""
    return Member(f"{name} {values}", ((make(name, where="hinge"), values),))


def bench(**more: Any) -> tuple[Asked, list[Recording]]:
    """Return the bench and a slow and a fast motion of it."""
    robot = load_robot("bench1")
    spec = mujoco.MjSpec.from_file(str(robot.model))
    items = [Item("ramps", ("ramp",), 4.0), Item("a chirp", ("chirp",), 4.0)]
    motions = [record_of(item, spec.copy().compile(), robot) for item in items]
    return Asked(spec, {0: NOISE}, **more), motions


def test_one_effect_with_two_values_refits_to_itself() -> None:
    """Forty noises apart as they are, the values meet once one follows the other."""
    asked, motions = bench()
    pair = member("viscous_friction", 0.03), member("viscous_friction", 0.04)
    paths = [trial(asked.spec, motions, fixed=one.fixed) for one in pair]
    as_given = [np.sqrt(np.mean((a - b) ** 2)) / NOISE for a, b in zip(*paths, strict=True)]
    linear, exact = separation(pair, motions, asked)[:, 0], refitted(pair, motions[1], asked)
    assert as_given[1] > 40
    assert linear[1] < 0.1 * as_given[1]  # what is left is the law's curvature
    assert exact < 0.05 * linear[1]


def test_different_laws_stay_apart_after_refits() -> None:
    """Friction that grows with speed is none that does not, whatever their values."""
    asked, motions = bench()
    pair = member("viscous_friction", 0.03), member("coulomb_friction", 0.02)
    linear = separation(pair, motions, asked)
    assert linear.shape == (2, 1)
    assert (linear > 5).all()
    exact = refitted(pair, motions[1], asked)
    assert 5 < exact[0] <= 1.1 * linear[1, 0]


def test_what_was_recorded_holds_values_in_place() -> None:
    """A heavier load may look like a stiffer friction in one motion, not in two."""
    pair = member("armature", 0.002), member("viscous_friction", 0.02)
    free, motions = bench()
    held = free._replace(past=(motions[1],))
    alone = separation(pair, motions[:1], free)
    assert (separation(pair, motions[:1], held) >= alone - 1e-9).all()


@pytest.mark.slow
def test_each_pair_is_told_by_itself() -> None:
    """A third explanation is near the one that it is like, and as far from the first as that."""
    asked, motions = bench()
    three = (
        member("viscous_friction", 0.03),
        member("coulomb_friction", 0.02),
        member("coulomb_friction", 0.021),
    )
    assert [(a.label, b.label) for a, b in pairs(three)] == [
        (three[0].label, three[1].label),
        (three[0].label, three[2].label),
        (three[1].label, three[2].label),
    ]
    linear, exact = separation(three, motions, asked), refitted(three, motions[1], asked)
    assert np.allclose(linear[:, 0], separation(three[:2], motions, asked)[:, 0])
    for found in (linear[0], linear[1], exact):
        assert min(found[:2]) > 5
        assert found[2] < 0.1 * min(found[:2])
