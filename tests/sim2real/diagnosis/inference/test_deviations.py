"""Parameters that are off by little, against what was hidden."""

from pathlib import Path

import pytest

from sim2real.diagnosis.inference.deviations import find_deviations
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from sim2real.diagnosis.schema import Deviation
from tests.sim2real.diagnosis import arm


def found(folder: Path, *effects: tuple[str, dict, float]) -> tuple[Deviation, ...]:
    """Return what is said of the arm with hidden effects, one change alone being looked at."""
    data = arm.data_of(arm.make_log(*effects, noise=3e-4), folder)
    return find_deviations(Judge(data).judge(Vocabulary(data, only=["coulomb_friction.a"])))


@pytest.mark.parametrize("factor", [0.96, 0.85])
def test_the_parameter_that_is_off_is_named_with_its_size(factor: float, tmp_path: Path) -> None:
    """Be it off by as little as is usual, or by more."""
    first, *_ = found(tmp_path, ("position_gain", {"where": "b"}, factor))
    assert (first.effect, first.where) == ("position_gain", "b")
    low, high = first.change_ci
    assert low < factor - 1 < high < 0
    assert first.change == pytest.approx(factor - 1, rel=0.25)


def test_nothing_is_said_of_a_sound_robot(tmp_path: Path) -> None:
    """Noise deviates from no parameter for certain."""
    assert found(tmp_path) == ()


def test_nothing_is_said_where_something_else_is_missing(tmp_path: Path) -> None:
    """Parameters would stand for it."""
    assert found(tmp_path, ("backlash", {"where": "b", "side": "link"}, 0.05)) == ()
