"""Verdicts, and how causes share what is closed."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim2real.diagnosis.conclude import verdict_of
from tests.sim2real.diagnosis import arm


@pytest.mark.parametrize(
    ("after", "closed", "caught", "verdict"),
    [
        (0.019, 0.8, 0.9, "explained"),  # within twice the floor, whatever it looks like
        (0.025, 0.95, 0.02, "explained"),
        (0.025, 0.95, 0.5, "partly_explained"),
        (0.1, 0.2, 0.0, "unexplained"),
    ],
)
def test_a_residue_with_structure_is_not_explained(
    tmp_path: Path, after: float, closed: float, caught: float, verdict: str
) -> None:
    """Nine tenths are not enough while commands and motion could still explain what is left."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    assert verdict_of(0.3, after, 0.01, closed, closed, data, caught) == verdict
