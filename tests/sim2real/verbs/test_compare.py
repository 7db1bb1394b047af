"""The verb `compare`: its files, its exit status, and what it refuses."""

import json
import sys
from pathlib import Path

import pytest

from hardware.log import write_log
from sim2real import __main__ as program
from sim2real.config.compose import compose, instantiate
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.comparison.test_compare import driven, noisy


def test_a_guard_ends_with_its_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the command line: 3 for a change, with compare.json and a page."""
    monkeypatch.chdir(tmp_path)
    arm.model(tmp_path)
    write_log("golden.csv", noisy(driven(), 1, temperature=30.0))
    write_log("today.csv", noisy(driven(0.03), 2, temperature=30.0))
    Path("robot_ci.yaml").write_text(
        "recording: golden.csv\nmodel: arm.xml\nwatch: [coulomb_friction]\n"
    )
    words = ["compare", "ci=robot_ci.yaml", "after=today.csv", "out=here"]
    monkeypatch.setattr(sys, "argv", ["sim2real", *words])
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 3
    answer = json.loads(Path("here/compare.json").read_text())
    assert [(c["effect"], c["where"]) for c in answer["changes"]] == [("coulomb_friction", "a")]
    assert "Changed: 1 effect." in Path("here/compare.html").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "two sides"),
        (["before=log.csv"], "two sides"),
        (
            ["before=log.csv", "units=[log.csv,log.csv,log.csv]"],
            "units= replaces before= and after=",
        ),
    ],
)
def test_one_side_is_not_enough(tmp_path: Path, monkeypatch, words: list[str], said: str) -> None:
    """A sentence before anything is simulated."""
    monkeypatch.chdir(tmp_path)
    write_log("log.csv", driven(seconds=4.0))
    verb, arguments = instantiate(compose(["run=compare", *words]), tmp_path / "out")
    with pytest.raises(Sim2RealError, match=said):
        verb(**arguments)
