"""Verdicts follow what is left, joint by joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.attribution.verdict import Rest, is_no_gap, stands_out, verdict_of
from tests.sim2real.diagnosis import arm


@pytest.mark.parametrize(
    ("before", "after", "closed", "low", "values", "verdict"),
    [
        (0.019, 0.019, 0.0, 0.0, 0, "no_gap"),  # within twice the floor
        (0.3, 0.019, 0.8, 0.7, 1, "explained"),  # what is left is
        (0.3, 0.025, 0.95, 0.9, 4, "explained"),
        (0.9, 0.04, 0.966, 0.9, 1, "partly_explained"),  # but four floors are left
        (0.3, 0.1, 0.7, 0.5, 1, "partly_explained"),
        (0.3, 0.019, 0.8, 0.7, 5, "fitted"),
        (0.3, 0.025, 0.95, 0.9, 13, "fitted"),
        (0.3, 0.1, 0.7, 0.5, 5, "fitted"),
        (0.3, 0.1, 0.7, -0.1, 1, "unexplained"),  # not surely anything
        (0.3, 0.25, 0.2, 0.1, 5, "unexplained"),
    ],
)
def test_verdicts_follow_what_is_left(
    tmp_path: Path,
    before: float,
    after: float,
    closed: float,
    low: float,
    values: int,
    verdict: str,
) -> None:
    """Twice the floor, nine tenths with three floors, three tenths and four values part them."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    assert verdict_of(Rest(before, after, 0.01, closed, low, values=values), data) == verdict


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
    assert verdict_of(Rest(1.5e-3, 1.4e-3, 1e-3, 0.1, 0.0, (True, True)), data) == "unexplained"
    assert verdict_of(Rest(1.5e-3, 1.0e-3, 1e-3, 0.6, 0.3, (True, False)), data) == "explained"
