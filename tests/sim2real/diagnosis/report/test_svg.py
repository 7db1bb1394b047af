"""Pictures of recordings: which pieces are shown, and that lines are where the numbers are."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sim2real.diagnosis.evidence import Trace
from sim2real.diagnosis.report import svg


@pytest.fixture
def trace() -> Trace:
    """Return 12 s of a joint, of which 6 to 9 s are compared."""
    time = np.arange(0, 12, 0.02)
    q = np.sin(time)
    known = np.where((time >= 6) & (time < 9), 0.0, np.nan)
    return Trace("a.csv", 0, "elbow", "rad", time, q, q + 0.1 + known, q + 0.01 + known, 0.005)


def test_pieces_are_those_that_are_compared(trace: Trace) -> None:
    """Pieces with few compared rows are left out; without any there are none."""
    found = svg.pieces(trace, 3.0)
    assert found
    assert all(svg.compared(trace)[piece.rows].mean() > 0.5 for piece in found)
    assert svg.pieces(replace(trace, nominal=np.full_like(trace.time, np.nan)), 3.0) == []
    assert len(svg.pieces(replace(trace, nominal=trace.measured), 20.0)) == 1


def test_errors_are_of_compared_rows_alone(trace: Trace) -> None:
    """Rows that nothing is known of do not make a piece look better."""
    assert svg.Piece(trace, 5.0, 8.0).error("nominal") == pytest.approx(0.1)


def test_a_line_breaks_where_the_simulation_starts_again(trace: Trace) -> None:
    """A model that runs off and comes back is two lines and a mark, not a jump."""
    starts = np.array([300, 375])  # at 6 s and 7.5 s
    off = np.where(trace.time < 7.5, trace.time - 6, trace.time - 7.5)
    running = replace(trace, nominal=trace.nominal + off, starts=starts)
    picture = svg.window(svg.Piece(running, 6.0, 9.0), "an elbow")
    assert len(re.findall('<path class="nominal"', picture)) == 4  # two positions, two errors
    assert len(re.findall('<path class="restart"', picture)) == 1


def test_errors_that_span_decades_have_a_logarithmic_axis(trace: Trace) -> None:
    """Next to an error of 1 rad one of 10 mrad is still seen off zero."""
    far = replace(trace, nominal=trace.nominal + 0.9)
    picture = svg.window(svg.Piece(far, 6.0, 9.0), "an elbow")
    heights = {
        kind: float(re.findall(f'<path class="{kind}" d="M[\\d.]+ ([\\d.]+)', picture)[1])
        for kind in ("nominal", "corrected")
    }
    zero = float(re.findall(r'class="n" x=".*?" y="([\d.]+)">0<', picture)[-1])
    assert heights["nominal"] < heights["corrected"] < zero - 3


def test_lines_are_where_the_numbers_are(trace: Trace) -> None:
    """The model as given lies a constant 0.1 rad off: its error is a level line, above zero."""
    picture = svg.window(svg.Piece(trace, 6.0, 9.0), "an elbow")
    lines = re.findall(r'<path class="nominal" d="M(.*?)"', picture)
    assert len(lines) == 2  # positions, errors
    heights = np.array([float(p.split()[1]) for p in lines[1].split("L")])
    zero = float(re.findall(r'class="n" x=".*?" y="([\d.]+)">0<', picture)[-1])
    assert np.ptp(heights) < 0.2
    assert heights.mean() < zero - 10
    assert 'aria-label="an elbow"' in picture


def test_a_track_stays_on_its_line() -> None:
    """Shares outside 0 to 1 are drawn at the ends."""
    picture = svg.track((-0.5, 1.7), [(0.25, "after")])
    assert 'x1="0.00%" x2="100.00%"' in picture
    assert 'cx="25.00%"' in picture
