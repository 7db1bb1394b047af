"""Verdicts, and how causes share what is closed."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim2real.diagnosis.conclude import verdict_of
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
    assert verdict_of(before, after, 0.01, closed, low, data) == verdict
