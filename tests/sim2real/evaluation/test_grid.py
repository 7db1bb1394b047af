"""A grid lays cells over the parameter space, knows the training range and refuses mistakes."""

from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.errors import ParameterError
from envs.params import Parameter, ParamSpace
from envs.randomization import Draw, Randomization
from sim2real.evaluation.grid import Axis, Grid, GridError
from sim2real.learning.context import training_range

MASS = Parameter("link_mass.torso", "link_mass", "torso", unit="kg", neutral=3.7, low=0, how="set")
FRICTION = Parameter("ground_friction", "ground_friction", neutral=2.0, low=0.0, how="set")
TILT = Parameter("gravity_tilt", "gravity_tilt", unit="rad")
SPACE = ParamSpace([TILT, FRICTION, MASS])
STUDY = (
    {"parameter": "link_mass.torso", "low": 0.5, "high": 11.5, "count": 12},
    {"parameter": "ground_friction", "low": 0.1, "high": 2.9, "count": 15},
)
RANGE = {"link_mass.torso": (1.0, 9.0), "ground_friction": (1.5, 2.5)}


def test_the_study_grid_has_its_cells_at_round_values() -> None:
    """Twelve masses by fifteen frictions, 0.5, 1.5 … kg and 0.1, 0.3 …, without rounding dust."""
    mass, friction = Grid(STUDY).axes
    assert mass.values == tuple(np.arange(12) + 0.5)
    assert friction.values == tuple(round(0.1 + 0.2 * i, 1) for i in range(15))
    assert Grid(STUDY).shape == (12, 15)


def test_values_go_to_their_columns_and_the_rest_stays_neutral() -> None:
    """The space's order of parameters is another than the grid's; the last axis varies fastest."""
    values = Grid(STUDY).values(SPACE)
    assert values.shape == (180, 3)
    assert (values[:, 0] == 0.0).all()
    np.testing.assert_allclose(values[:2, 1:], [[0.1, 0.5], [0.3, 0.5]])
    assert values[15, 2] == 1.5


def test_fixed_values_hold_in_every_cell() -> None:
    """A parameter without an axis may be set to something else than neutral."""
    grid = Grid([{"parameter": "ground_friction", "values": [1.0, 2.0]}], {"gravity_tilt": 0.1})
    np.testing.assert_allclose(grid.values(SPACE), [[0.1, 1.0, 3.7], [0.1, 2.0, 3.7]])


def test_the_training_range_of_the_study_holds_48_cells() -> None:
    """Masses 1.5 … 8.5 and frictions 1.5 … 2.5: both edges of the friction count as inside."""
    inside = Grid(STUDY).inside(RANGE)
    cells = Grid(STUDY).cells()[inside]
    assert inside.sum() == 8 * 6
    np.testing.assert_allclose(cells.min(axis=0), [1.5, 1.5])
    np.testing.assert_allclose(cells.max(axis=0), [8.5, 2.5])


def test_an_axis_that_the_box_lacks_does_not_matter() -> None:
    """A box over friction alone keeps all masses."""
    assert Grid(STUDY).inside({"ground_friction": (1.5, 2.5)}).sum() == 12 * 6


def test_edges_lie_halfway() -> None:
    """Uneven axes have uneven cells; a single value has a cell of width 1."""
    np.testing.assert_allclose(Axis("a", (0.0, 1.0, 3.0)).edges(), [-0.5, 0.5, 2.0, 4.0])
    np.testing.assert_allclose(Axis("a", (2.0,)).edges(), [1.5, 2.5])


def test_training_range_reads_the_draws() -> None:
    """Uniform and truncated laws reach their limits, a normal law 2 standard deviations."""
    mass, friction = make("link_mass", where="torso", how="set"), make("ground_friction")
    tasks = Randomization(
        [Draw(mass, low=1.0, high=9.0), Draw(friction, distribution="normal", mean=2.0, std=0.25)]
    )
    assert training_range(tasks, SPACE) == {
        "link_mass.torso": (1.0, 9.0),
        "ground_friction": (1.5, 2.5),
    }
    assert training_range(object(), SPACE) == {}


def test_names_and_values_are_checked_against_the_space() -> None:
    """An unknown name suggests the nearest; a value without meaning is named with its range."""
    with pytest.raises(ParameterError, match=r"did you mean 'ground_friction'"):
        Grid([{"parameter": "ground_fricton", "values": [1.0]}]).values(SPACE)
    with pytest.raises(ParameterError, match=r"link_mass\.torso = -1"):
        Grid([{"parameter": "link_mass.torso", "values": [-1.0, 2.0]}]).values(SPACE)


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        ([], "at least one axis"),
        ([{"parameter": "a", "values": [2.0, 1.0]}], "must be finite and increase"),
        ([{"parameter": "a", "values": [1.0, float("nan")]}], "must be finite and increase"),
        ([{"parameter": "a"}], "either values, or low, high and count"),
        ([{"parameter": "a", "values": [1.0], "low": 0.0}], "either values, or low"),
        ([{"parameter": "a", "low": 0.0, "high": 1.0}], "give all three"),
        ([{"parameter": "a", "low": 1.0, "high": 0.0, "count": 3}], "low < high"),
        ([{"parameter": "a", "values": [1.0]}] * 2, "a is given twice"),
        ([{"parameter": "a", "value": [1.0]}], "takes parameter, values, low, high, count"),
    ],
)
def test_mistakes_are_named(axes: list[dict[str, Any]], message: str) -> None:
    """Each mistake in an axis is refused when the grid is made."""
    with pytest.raises(GridError, match=message):
        Grid(axes)
