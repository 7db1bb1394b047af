"""Verdicts, and how causes share what is closed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim2real.diagnosis.attribution.conclude import _confidence, is_no_gap, stands_out, verdict_of
from tests.sim2real.diagnosis import arm


@pytest.mark.parametrize(
    ("before", "after", "closed", "low", "verdict"),
    [
        (0.019, 0.019, 0.0, 0.0, "no_gap"),  # within twice the floor
        (0.3, 0.019, 0.8, 0.7, "explained"),  # what is left is
        (0.3, 0.025, 0.95, 0.9, "explained"),
        (0.3, 0.1, 0.7, 0.5, "partly_explained"),
        (0.3, 0.1, 0.7, -0.1, "unexplained"),  # not surely anything
        (0.3, 0.25, 0.2, 0.1, "unexplained"),
    ],
)
def test_verdicts_follow_what_is_left(
    tmp_path: Path, before: float, after: float, closed: float, low: float, verdict: str
) -> None:
    """Twice the floor, nine tenths and three tenths part the verdicts."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    assert verdict_of(before, after, 0.01, closed, low, data, (False, False)) == verdict


def test_one_joint_that_stands_out_is_a_gap(tmp_path: Path) -> None:
    """Seven joints at their floor do not hide the eighth, and it has to be explained as well."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    floors = np.array([1e-3, 1e-3])
    error = np.where(data.mask[..., None], [1e-3, 2.9e-3], 0.0)
    assert not stands_out(error, data, floors)
    error = np.where(data.mask[..., None], [1e-3, 3.1e-3], 0.0)
    assert stands_out(error, data, floors)
    assert is_no_gap(1.5e-3, 1e-3, data, alone=False)
    assert not is_no_gap(1.5e-3, 1e-3, data, alone=True)
    assert verdict_of(1.5e-3, 1.4e-3, 1e-3, 0.1, 0.0, data, (True, True)) == "unexplained"
    assert verdict_of(1.5e-3, 1.0e-3, 1e-3, 0.6, 0.3, data, (True, False)) == "explained"


def test_a_cause_without_rivals_is_as_likely_as_a_coin(tmp_path: Path) -> None:
    """What never raced against anything cannot have won: half, even where all is closed."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    search: Any = SimpleNamespace(problem=SimpleNamespace(data=data), blocks=None)
    member: Any = SimpleNamespace(label="position_gain.a")
    rest = np.zeros((0, 0, 0))
    assert _confidence(search, member, [], [], rest, closed=1.0) <= 0.5
    raced: Any = SimpleNamespace(candidate=member)  # the screening has ruled out all others
    assert _confidence(search, member, [], [raced], rest, closed=1.0) > 0.9
