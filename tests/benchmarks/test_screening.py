"""The table of what screening's glance keeps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import screening
from sim2real.runs.statistics import Interval

EXACT = ["coulomb_friction.a", "viscous_friction.a", "position_gain.a"]


def case(glance: list[str], effect: str = "coulomb_friction") -> dict[str, Any]:
    """Return a case whose exact screening says EXACT."""
    steps = {"exact_steps": 300, "glance_steps": 100}
    return {"effects": [effect], "exact": EXACT, "glance": glance, **steps}


def test_places_and_first_ones_are_counted() -> None:
    """Two of three places are lost where two change them; who is right alone is told."""
    swapped = [EXACT[1], EXACT[0], EXACT[2]]
    cases = [case(EXACT), case(EXACT), case(EXACT[:2]), case(swapped), case(swapped, "viscous")]
    table = screening.table(cases, np.random.default_rng(0))
    found: list[Any] = [row[1] for row in table.rows]
    assert all(isinstance(one, Interval) and one.low <= one.value <= one.high for one in found)
    assert [one.value for one in found] == pytest.approx([(3 + 3 + 2 + 1 + 1) / 15, 3 / 5, 3.0])
    assert "exact screening alone in 1 cases" in table.notes[0]
    assert "p = 1." in table.notes[0]


def test_what_is_done_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second call goes on; a case that a robot cannot show counts as done, and in no table."""
    made = []

    def compare(exam: object, outline: screening.Outline) -> dict[str, Any]:
        made.append(outline.name)
        return {} if len(made) == 1 else case(EXACT)

    monkeypatch.setattr(screening, "compare", compare)
    options = ["--cases", "4", "--out", str(tmp_path / "out"), "--results", str(tmp_path / "kept")]
    assert screening.main([*options, "--most", "0"]) == 1
    assert screening.main([*options, "--most", "3"]) == 0
    assert screening.main(options) == 0
    assert len(made) == len(set(made)) == 4
    files = [json.loads(file.read_text()) for file in (tmp_path / "out").glob("*.json")]
    assert sum(bool(one) for one in files) == 3
    assert "3 cases of seed 77, of 4 drawn" in (tmp_path / "kept" / "screening.md").read_text()


def test_single_cases_can_be_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are those of the whole draw; a number beyond it is refused."""
    made = []
    monkeypatch.setattr(
        screening, "compare", lambda exam, outline: made.append(outline.name) or case(EXACT)
    )
    options = ["--cases", "4", "--out", str(tmp_path / "out"), "--results", str(tmp_path / "kept")]
    assert screening.main([*options, "--only", "3", "1"]) == 0
    assert made == ["case_003", "case_001"]
    with pytest.raises(SystemExit):
        screening.main([*options, "--only", "4"])
    assert "--only [4] must lie between 0 and 3" in capsys.readouterr().err
