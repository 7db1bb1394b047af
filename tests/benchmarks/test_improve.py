"""The loops resume, and what they closed of the gap is what the table says."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import improve, study
from benchmarks.improve import Case, cases, closed, main

RETURNS = {"hopper2_mass": (0.5, 2.0), "hopper2_soft": (0.5, 1.0), "hopper2_slow": (2.4, 2.4)}


def job(*arguments: str) -> bool:
    """Stand for the command line: leave what a training, or a loop, would."""
    given = dict(a.split("=", 1) for a in arguments)
    folder = Path(given["hydra.run.dir"])
    folder.mkdir(parents=True, exist_ok=True)
    if "+experiment" in given:
        return True
    before, after = RETURNS[Path(given["robot.hidden"]).stem]
    sound, found = before > 2, [{"label": "supply_voltage", "value": 0.741}]
    rounds = [{"robot": [before] * 2, "simulator": [2.5, 2.5], "causes": []}]
    if not sound:
        rounds += [{"robot": [after] * 2, "simulator": [2.5, 2.5], "causes": found}]
    end = "within_noise" if sound else "rounds"
    told = {"rounds": rounds, "best": len(rounds) - 1, "end": end, "words": "it was enough"}
    (folder / "improve.json").write_text(json.dumps(told))
    return True


def test_what_is_closed_of_the_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three quarters and one quarter of 2 are a half; a robot without a gap does not count."""
    monkeypatch.setattr(study, "sim2real", job)
    monkeypatch.setattr(improve, "best", lambda case, told: [2.5, 2.5])
    words = ["--robots", "hopper2", "--seeds", "0", "--out", str(tmp_path / "runs")]
    words += ["--results", str(tmp_path / "results")]
    assert main([*words, "--most", "2"]) == 0
    page = (tmp_path / "results" / "improve.md").read_text()
    assert "PARTIAL: 1 of 3 loops are missing." in page
    assert main(words) == 0
    page = (tmp_path / "results" / "improve.md").read_text()
    assert "over 2 loops with a gap: 0.50 [0.25, 0.75]" in page and "missed" in page
    assert "PARTIAL" not in page and "supply_voltage 0.741" in page
    monkeypatch.setattr(study, "sim2real", lambda *_: pytest.fail("nothing is left to do"))
    assert main(words) == 0


def test_a_loop_without_a_gap_has_no_share() -> None:
    """Where the best possible policy earns no more, nothing can be closed."""
    told: dict[str, Any] = {"rounds": [{"robot": [1.0]}, {"robot": [2.0]}], "best": 1, "end": "x"}
    assert closed({**told, "best_possible": [0.9]}) is None
    assert closed({**told, "best_possible": [3.0]}) == pytest.approx(0.5)


def test_the_cases_are_what_was_asked_for(tmp_path: Path) -> None:
    """Two robots, three that hide something each, two seeds; every file of effects is there."""
    every = cases(("hopper2", "quad8"), (0, 1), tmp_path)
    assert len(every) == 12 and len({case.folder for case in every}) == 12
    assert all((improve.SHIFTS / f"{case.world}.yaml").is_file() for case in every)
    assert Case("quad8", "quad8_soft", 1, tmp_path).line[0] == "run=improve"


def test_no_table_of_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a complete loop the command says so."""
    words = ["--most", "0", "--out", str(tmp_path), "--results", str(tmp_path / "r")]
    assert main(words) == 1
    assert "no loop is complete" in capsys.readouterr().err
