"""Deviations of a robot's numbers: those of a hidden effect are its value."""

import math

import numpy as np
import pytest

from envs.effects import EFFECTS
from sim2real.exam.score import Places
from sim2real.exam.thirdparty.deviations import list_deviations, names_deviation
from sim2real.exam.thirdparty.hidden import LAWS, put
from sim2real.exam.thirdparty.rig import Rig
from sim2real.exam.thirdparty.robots import ROBOTS, make_rig

PLACES = Places(["yaw", "shoulder", "elbow"], {"upper": "shoulder", "forearm": "elbow"})


@pytest.fixture(scope="module")
def bare() -> Rig:
    """Return the arm with nothing hidden."""
    return make_rig(ROBOTS["arm3"])


@pytest.mark.parametrize(
    "effect",
    [
        *("position_gain", "derivative_gain", "coulomb_friction", "viscous_friction"),
        *("armature", "link_mass", "center_of_mass", "link_inertia", "motor_strength"),
    ],
)
def test_a_hidden_effect_is_its_deviation(bare: Rig, effect: str) -> None:
    """At its joint and nowhere else, in the vocabulary's unit and form."""
    truth = LAWS[effect].draw(bare, "elbow", np.random.default_rng(2))(0.3)
    found = list_deviations(put(bare, {"effect": effect, **truth}), bare)
    (own,) = [one for one in found if (one["effect"], one["joint"]) == (effect, "elbow")]
    assert own["value"] == pytest.approx(truth["value"])
    none = 1.0 if EFFECTS[effect].hows[0] == "scale" else 0.0
    others = [one["value"] for one in found if one["effect"] == effect and one is not own]
    assert others == pytest.approx([none, none])
    assert names_deviation(
        {"effect": effect, "where": "elbow", "value": own["value"]}, PLACES, [own]
    )


def test_one_for_the_robot_is_the_mean_of_its_joints(bare: Rig) -> None:
    """Factors are compared as logarithms, so that twice and half have no mean."""
    rig = bare.servo("yaw", kp=bare.joints["yaw"].servo.kp * 1.331)  # type: ignore[union-attr]
    found = list_deviations(rig, bare)
    for factor, right in ((1.1, True), (math.sqrt(1.1) * 0.999, False), (1.1**-1, False)):
        cause = {"effect": "position_gain", "where": None, "value": factor}
        assert names_deviation(cause, PLACES, found) is right


@pytest.mark.parametrize("cause", [("backlash", 0.1), ("payload", [0.1, 0.2]), ("armature", None)])
def test_what_no_number_stands_for_is_no_deviation(bare: Rig, cause: tuple[str, object]) -> None:
    """An effect that the model has no number for, and one without a value."""
    effect, value = cause
    named = {"effect": effect, "where": "elbow", "value": value}
    assert not names_deviation(named, PLACES, list_deviations(bare, bare))
