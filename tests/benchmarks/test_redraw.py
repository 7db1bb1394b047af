"""Pictures that are drawn anew show the numbers of the tables beside them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks import redraw
from sim2real.exam.matrix import Confusion
from sim2real.loops.relearn import NOMINAL, Tried


@pytest.mark.parametrize("name", redraw.PICTURES)
def test_every_picture_is_drawn_from_its_table(name: str, tmp_path: Path) -> None:
    """In a folder that holds tables alone, the picture of that name comes to be."""
    for file in redraw.RESULTS.iterdir():
        if file.suffix in (".csv", ".json"):
            shutil.copy(file, tmp_path)
    assert redraw.main([name, "--results", str(tmp_path)]) == 0
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_an_exam_counts_as_its_table_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One case of a velocity limit was called a torque limit; all sound robots were left alone."""
    shown: list[Confusion] = []
    monkeypatch.setattr(redraw.matrix, "draw", lambda found, path: shown.append(found))
    redraw.exams(redraw.RESULTS)
    found = shown[0]
    row = found.counts[found.hidden.index("profile_velocity")]
    named = {name: int(n) for name, n in zip(found.named, row, strict=True) if n}
    assert named == {"profile_velocity": 3, "torque_limit": 1}
    assert found.counts[found.hidden.index("nothing")].sum() == 20


def test_the_loop_s_runs_are_those_of_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five runs of each simulator; on the robot the nominal ones earn least."""
    shown: list[dict[str, list[Tried]]] = []
    monkeypatch.setattr(redraw.relearn, "draw", lambda tried, path: shown.append(tried))
    redraw.loop(redraw.RESULTS)
    (tried,) = shown
    assert {len(runs) for runs in tried.values()} == {5}
    earned = {name: np.median([one.robot[0] for one in runs]) for name, runs in tried.items()}
    assert min(earned, key=lambda name: earned[name]) == NOMINAL


def test_an_unknown_picture_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """With those that there are."""
    with pytest.raises(SystemExit):
        redraw.main(["sped"])
    assert "'sped' is none of blindcheck, hopper_gap" in capsys.readouterr().err
