"""Numbers and names as a person reads them."""

from dataclasses import replace

import pytest

from sim2real.diagnosis.report import text
from sim2real.diagnosis.schema import Cause, Deviation
from tests.sim2real.diagnosis.report.sample import report


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.0503, "rad", "50.3 mrad"),
        (1.5, "rad", "1.50 rad"),
        (0.00012, "s", "0.120 ms"),
        (0.98, "kg", "0.980 kg"),
        (-0.012, "rad", "−12.0 mrad"),
        (0.48, "", "0.480"),
        (0.031, "spread", "3.10 %"),
        (1234.5, "N·m", "1234 N·m"),
        (2e-9, "kg·m²", "2.00e-09 kg·m²"),
        (0.0, "m", "0 mm"),
        (2e-9, "m", "< 0.001 mm"),
        (None, "m", "–"),
    ],
)
def test_quantities_have_the_prefix_that_fits(value: float | None, unit: str, expected) -> None:
    """Three digits, thousandths where that reads better, no exponent without need."""
    assert text.quantity(value, unit).replace("\xa0", " ") == expected


def test_a_row_of_numbers_has_one_unit() -> None:
    """The first number's prefix holds for the others."""
    assert text.quantity(1.5, "rad", like=0.2).replace("\xa0", " ") == "1500 mrad"
    assert text.interval((0.9, 1.1), "s").replace("\xa0", " ") == "0.900 to 1.10 s"


@pytest.mark.parametrize(
    ("share", "expected"),
    [(0.5, "50 %"), (0.996, "99.6 %"), (0.004, "0.4 %"), (1.0, "100 %"), (-0.2, "-20 %")],
)
def test_percentages_show_tenths_where_they_tell(share: float, expected: str) -> None:
    """Near nothing and near all, a tenth is a difference."""
    assert text.percent(share).replace("\xa0", " ") == expected


def test_names_of_effects_are_words() -> None:
    """Underscores go, people keep their capitals, places and sides are said."""
    assert text.format_effect("coulomb_friction", "elbow") == "Coulomb friction at elbow"
    assert text.format_effect("backlash", "knee", "link") == "backlash at knee (link side)"
    assert text.format_effect("command_delay", None) == "command delay"
    assert text.label("+ stribeck_friction.hip_fl") == "+ Stribeck friction at hip_fl"
    assert text.label("noise floor") == "noise floor"


def test_many_causes_are_told_by_their_kind() -> None:
    """A headline of seventeen places is none."""
    few = [("position_gain", "elbow"), ("coulomb_friction", "elbow")]
    assert text.subjects(few) == ["position gain at elbow", "Coulomb friction at elbow"]
    many = [("position_gain", joint) for joint in "abc"] + [
        *[("coulomb_friction", joint) for joint in "ab"],
        ("supply_sag", None),
    ]
    assert text.subjects(many) == [
        "position gain at 3 places",
        "Coulomb friction at 2 places",
        "supply sag",
    ]


def test_what_the_simulator_was_tested_for_is_one_sentence() -> None:
    """What makes no difference is said together, what does on its own."""
    assert text.numerics({"timestep": "ok", "solver": "ok"}) == [
        "The gap is not due to numerics: timestep and solver make no difference to it."
    ]
    assert text.numerics({"timestep": "ok", "friction": "halves the gap"}) == [
        "Timestep makes no difference to it.",
        "Friction: halves the gap",
    ]


def test_a_cause_of_all_joints_is_not_at_the_robot() -> None:
    """As people say it: at all joints alike; a delay of the robot needs no place."""
    numbers = {"side": None, "value": 0.1, "value_ci": (0.1, 0.1), "unit": "", "extra": {}}
    for effect, shared, said in (
        ("coulomb_friction", True, "Coulomb friction at all joints alike"),
        ("command_delay", False, "command delay"),
    ):
        cause = Cause(effect, None, **numbers, confidence=1.0, closed=1.0, shared=shared)
        assert text.format_effect(*text.place_of(cause)) == said


def test_deviations_of_parameters_are_told_with_signs_and_options() -> None:
    """The first four, each with its interval."""
    one = Deviation("motor_strength", "hip", -0.027, (-0.034, -0.02), "braking kept")
    shown = replace(report(), deviations=(one, *4 * (replace(one, where="knee"),)))
    told = text.deviation_sentence(shown).replace("\xa0", " ")
    assert "motor strength at hip (braking kept), −2.7 % (−3.4 % to −2.0 %)" in told
    assert told.count("knee") == text.SINGLY - 1
    assert text.deviation_sentence(shown) in text.details(shown)
    assert text.deviation_sentence(report()) == ""
