"""The verdict in a terminal: what it says, its alignment and its colours."""

import re
from dataclasses import replace

import pytest

from sim2real.diagnosis.report.terminal import align, format_verdict
from sim2real.diagnosis.report.text import EVERYWHERE, SUBTITLES, deviation_sentence
from sim2real.diagnosis.schema import Deviation, Equivalent
from tests.sim2real.diagnosis.report.sample import report

ESCAPES = re.compile(r"\x1b\[[0-9;]*m")


def test_columns_are_aligned() -> None:
    """Words at their left ends, numbers at their right ends; no line ends in spaces."""
    assert align([("effect", "closes"), ("backlash", "5 %")], right=(1,)) == [
        "effect    closes",
        "backlash     5 %",
    ]
    assert align([("a", ""), ("b", "c")]) == ["a", "b  c"]


def test_every_cause_has_a_row_and_the_gap_its_numbers() -> None:
    """The values of the report's own causes, in the order of the report."""
    shown = report()
    lines = format_verdict(shown).splitlines()
    assert lines[0].startswith(f"{SUBTITLES[shown.verdict]}. ")
    head = next(n for n, line in enumerate(lines) if line.split()[:1] == ["effect"])
    others = sum(len(cause.equivalent) for cause in shown.values)
    rows = lines[head + 1 :]
    assert len(rows) == len(shown.values) + others
    at = lines[head].index("at")
    for row in rows:
        assert row[at] != " " and row[at - 2 : at] == "  "
    assert any(line.split()[:2] == ["noise", "floor"] for line in lines)


def test_an_equivalent_of_all_joints_is_not_at_the_robot() -> None:
    """A friction of all joints is so; what the robot has once is the robot's."""
    shown = report()
    others = (Equivalent("viscous_friction", None), Equivalent("gravity_tilt", None))
    first = replace(shown.causes[0], equivalent=others)
    lines = format_verdict(replace(shown, causes=(first, *shown.causes[1:]))).splitlines()
    (friction,) = (line for line in lines if "or viscous friction" in line)
    (tilt,) = (line for line in lines if "or gravity tilt" in line)
    assert EVERYWHERE in friction and "the robot" in tilt


def test_colours_change_nothing_but_colours() -> None:
    """Without its escape sequences the coloured text is the plain one."""
    plain, coloured = format_verdict(report()), format_verdict(report(), coloured=True)
    assert "\x1b" not in plain and "\x1b" in coloured
    assert ESCAPES.sub("", coloured) == plain


@pytest.mark.parametrize("verdict", SUBTITLES)
def test_every_verdict_can_be_shown(verdict: str) -> None:
    """Also without causes, or without a gap that could be closed."""
    shown = replace(report(), verdict=verdict)
    bare = replace(shown, causes=(), fitted=(), gap=replace(shown.gap, after=None, closed=None))
    assert format_verdict(bare).startswith(SUBTITLES[verdict])
    assert "effect" not in {line.split()[0] for line in format_verdict(bare).splitlines() if line}


def test_deviations_of_parameters_come_last() -> None:
    """Below the causes, as the page says them."""
    one = Deviation("position_gain", "elbow", -0.05, (-0.06, -0.04))
    shown = replace(report(), deviations=(one,))
    assert format_verdict(shown).splitlines()[-1] == deviation_sentence(shown)
