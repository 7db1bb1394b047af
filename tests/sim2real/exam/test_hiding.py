"""What an exam can hide: every form of a value, and places that the robot has."""

import math
from pathlib import Path

import numpy as np
import pytest

from hardware.emulator.hidden import make_hidden
from sim2real.exam.hiding import EFFECTS, Secret, choose, moved, places
from sim2real.exam.logs import exam_robot


@pytest.mark.parametrize(
    ("form", "unit", "direction", "value"),
    [
        ("add", 2.0, -1.0, 0.2),
        ("signed", 2.0, -1.0, -0.2),
        ("factor", 1.0, -1.0, math.exp(-0.1)),
        ("limit", 2.0, 1.0, 20.0),
        ("mass", 2.0, 1.0, 2 * (math.exp(0.1) - 1)),
    ],
)
def test_a_size_becomes_a_value(form: str, unit: float, direction: float, value: float) -> None:
    """Sizes are positive; the form and the drawn direction make a value of them."""
    secret = Secret("some", "hinge", "hinge", form, unit, direction)  # type: ignore[arg-type]
    assert secret.value(0.1) == pytest.approx(value)


def test_a_tilt_has_the_size_of_its_angle() -> None:
    """The two angles of a tilt are the parts of one rotation."""
    tilt = Secret("gravity_tilt", None, None, "tilt", 1.0, 0.7).value(0.05)
    assert np.hypot(*tilt) == pytest.approx(0.05)  # type: ignore[misc]


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_can_be_hidden_in_an_arm(effect: str, tmp_path: Path) -> None:
    """The emulator takes what is drawn, at each end of the range of sizes."""
    robot = exam_robot("arm6", tmp_path)
    rng = np.random.default_rng(0)
    for where in places(robot, effect):
        secret = choose(robot, effect, where, rng)
        for size in (EFFECTS[effect].low, EFFECTS[effect].high):
            make_hidden([secret.entry(size)], robot)


def test_bodies_belong_to_the_joints_that_move_them(tmp_path: Path) -> None:
    """The forearm is moved by the elbow, and a diagnosis should name the elbow for its mass."""
    robot = exam_robot("arm6", tmp_path)
    assert moved(robot)["elbow"] == "forearm"
    secret = choose(robot, "link_mass", "forearm", np.random.default_rng(0))
    assert (secret.where, secret.joint) == ("forearm", "elbow")
