"""Pictures of recordings: which pieces are shown, and that lines are where the numbers are."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from sim2real.diagnosis.report import svg
from sim2real.diagnosis.schema import Trace


@pytest.fixture
def trace() -> Trace:
    """Return 12 s of a joint, of which 6 to 9 s were not fitted."""
    time = np.arange(0, 12, 0.02)
    q = np.sin(time)
    held = (time >= 6) & (time < 9)
    return Trace("a.csv", 0, "elbow", "rad", time, q, q + 0.1, q + 0.01, 0.002, held)


def test_pieces_are_those_that_were_not_fitted(trace: Trace) -> None:
    """Pieces with few held-out rows are left out; without any there are none."""
    found = svg.spans(trace, 3.0)
    assert found
    assert all(trace.held_out[svg.rows(trace, span)].mean() > 0.5 for span in found)
    assert svg.spans(replace(trace, held_out=np.zeros_like(trace.held_out)), 3.0) == []
    assert len(svg.spans(replace(trace, held_out=np.ones_like(trace.held_out)), 20.0)) == 1


def test_errors_are_of_held_out_rows_alone(trace: Trace) -> None:
    """What was fitted to does not make a piece look better."""
    nominal = np.where(trace.held_out, trace.nominal, trace.measured)
    flattered = replace(trace, nominal=nominal)
    assert svg.error(flattered, "nominal", svg.Span(5.0, 8.0)) == pytest.approx(0.1)


def test_lines_are_where_the_numbers_are(trace: Trace) -> None:
    """The model as given lies a constant 0.1 rad off: its error is a level line, above zero."""
    picture = svg.window(trace, svg.Span(6.0, 9.0), "an elbow")
    lines = re.findall(r'<path class="nominal" d="M(.*?)"', picture)
    assert len(lines) == 2  # positions, errors
    heights = np.array([float(p.split()[1]) for p in lines[1].split("L")])
    zero = float(re.findall(r'class="n" x=".*?" y="([\d.]+)">0<', picture)[-1])
    assert np.ptp(heights) < 0.2
    assert heights.mean() < zero - 10
    assert 'aria-label="an elbow"' in picture


def test_a_track_stays_on_its_line() -> None:
    """Shares outside 0 to 1 are drawn at the ends."""
    picture = svg.track(-0.5, 1.7, [(0.25, "after")])
    assert 'x1="0.00%" x2="100.00%"' in picture
    assert 'cx="25.00%"' in picture
