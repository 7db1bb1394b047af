"""Axes: values are where their numbers say, and small ones stay visible beside large ones."""

import numpy as np
import pytest

from sim2real.diagnosis.report.axes import Axis, Log, Signed, scale_for


def test_equal_ratios_are_equally_long_on_a_logarithmic_axis() -> None:
    """1 to 10 takes as much room as 10 to 100; what is too small stands at the start."""
    axis = Log(1.0, 100.0)
    assert axis(np.array([1.0, 10.0, 100.0])) == pytest.approx([0.0, 0.5, 1.0])
    assert axis(0.0) == 0.0
    assert [text for _, text in axis.ticks(2)] == ["1", "10", "100"]
    assert [text for _, text in axis.ticks(4)] == ["1", "2", "5", "10", "20", "50", "100"]


def test_errors_keep_their_sign_and_their_decades() -> None:
    """Next to zero it is a line; beyond, ten times as much is a fixed step further."""
    axis = Signed(0.01, 100.0, start=-1.0, end=1.0)
    assert axis(0.0) == 0.0
    assert axis(-3.0) == pytest.approx(-axis(3.0))
    assert axis(100.0) == pytest.approx(1.0)
    assert axis(100.0) - axis(10.0) == pytest.approx(axis(10.0) - axis(1.0), rel=1e-3)
    places = [place for place, _ in axis.ticks(3)]
    assert places == sorted(places) and 0.0 in places and places[0] == -places[-1]


def test_a_scale_is_logarithmic_where_sizes_lie_far_apart() -> None:
    """108 and 1.5 share one; 2 and 3 share a linear one that starts at zero."""
    far, near = scale_for([108.0, 1.5, 0.609], 0.609), scale_for([2.0, 3.0], 0.1)
    assert isinstance(far, Log) and far(1.5) - far(0.609) > 0.1
    assert type(near) is Axis and near(0.0) == 0.0
    assert 0 < far(0.609) < far(108.0) < 1
    assert scale_for([0.0], 0.0)(0.0) == 0.0
