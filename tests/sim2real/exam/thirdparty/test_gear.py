"""Play and springs between motor and link."""

import pytest

from sim2real.exam.thirdparty.gear import Gear


def test_a_spring_pulls_both_ways() -> None:
    """Stiffness and damping add up."""
    gear = Gear(stiffness=50.0, damping=0.1)
    assert gear(0.01, 0.0) == pytest.approx(0.5)
    assert gear(-0.01, 2.0) == pytest.approx(-0.3)


def test_play_passes_nothing_inside_and_never_sticks() -> None:
    """A damper may not hold the sides together."""
    gear = Gear(stiffness=50.0, damping=1.0, play=0.02)
    assert gear(0.009, 5.0) == 0.0
    assert gear(0.012, 0.0) == pytest.approx(0.1)
    assert gear(-0.012, 0.0) == pytest.approx(-0.1)
    assert gear(0.012, -5.0) == 0.0
