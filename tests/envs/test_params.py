"""Parameter spaces: names, ranges and what they refuse."""

import numpy as np
import pytest

from envs.errors import EnvsError, ParameterError, did_you_mean
from envs.params import Parameter, ParamSpace

SPACE = ParamSpace(
    [
        Parameter(
            "link_mass.torso", "link_mass", "torso", unit="kg", neutral=3.7, low=0.0, how="set"
        ),
        Parameter("motor_strength", "motor_strength", neutral=1.0, low=0.0, high=2.0, how="scale"),
    ]
)


def test_neutral_points_are_valid() -> None:
    """Points of absent effects lie in the space, one row each."""
    points = SPACE.points(3)
    np.testing.assert_array_equal(points, np.tile([3.7, 1.0], (3, 1)))
    np.testing.assert_array_equal(SPACE.validate(points), points)
    assert SPACE.size == 2


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([[1.0, 1.0], [-1.0, 1.0]], r"link_mass.torso = -1 kg \(row 1\) is outside \[0, inf\]"),
        ([[1.0, 2.5]], r"motor_strength = 2.5 .*outside \[0, 2\] \(scale\)"),
        ([[np.nan, 1.0]], "link_mass.torso = nan kg"),
        ([[np.inf, 1.0]], "link_mass.torso = inf kg"),
        ([[1.0]], r"shape \(n, 2\), got \(1, 1\)"),
        ([1.0, 1.0], r"shape \(n, 2\), got \(2,\)"),
    ],
)
def test_values_outside_are_refused(values: list, message: str) -> None:
    """The first wrong value is named with its row, unit and range."""
    with pytest.raises(ParameterError, match=message):
        SPACE.validate(np.array(values))


def test_names_are_looked_up_or_listed() -> None:
    """An unknown name is refused with the nearest one; a name given twice is refused."""
    assert SPACE.index("motor_strength") == 1
    with pytest.raises(ParameterError, match=r"'motor_strenth'.*did you mean 'motor_strength'"):
        SPACE.index("motor_strenth")
    with pytest.raises(ParameterError, match=r"motor_strength, or params=NAME that draws it"):
        SPACE.index("goal.x")
    with pytest.raises(ParameterError, match=r"'goal\.x'; choose params=NAME that draws it"):
        ParamSpace().index("goal.x")  # the robots of params=none
    with pytest.raises(ParameterError, match="'motor_strength' is given twice"):
        ParamSpace([SPACE.parameters[1], SPACE.parameters[1]])


def test_errors_share_a_base() -> None:
    """One class catches every mistake of a user, as a ValueError."""
    assert issubclass(ParameterError, EnvsError)
    assert issubclass(EnvsError, ValueError)
    assert did_you_mean("xyz", ["torso"]) == ""
