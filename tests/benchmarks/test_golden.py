"""The golden files: what counts as the same, and what is run again."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import golden
from benchmarks.golden_compare import MISSING, compared, judged, leaves, markdown, ratio, relative
from benchmarks.golden_parts import PARTS, Figures, Job, Part, arrays, columns


def jobs(**figures: Any) -> dict[str, Any]:
    """A record of one job."""
    return {"one": {"figures": figures, "cpu_seconds": 1.0}}


def returns(values: np.ndarray) -> dict[str, Any]:
    """A record with a training of each return."""
    return {f"seed{i}": {"figures": {"source_return": float(v)}} for i, v in enumerate(values)}


def test_leaves_have_their_paths() -> None:
    """Dicts and lists are walked; empty ones are values themselves."""
    found = dict(leaves({"a": {"b": [1, {"c": None}]}, "d": []}))
    assert found == {"a.b[0]": 1, "a.b[1].c": None, "d": []}


def test_the_last_digit_counts_and_seconds_do_not() -> None:
    """One unit in the last place is a difference, with its size; other CPU seconds are none."""
    value = 0.1
    old, new = jobs(a=value, b=[1.0, 2.0]), jobs(a=float(np.nextafter(value, 1)), b=[1.0, 2.0])
    old["one"]["cpu_seconds"] = 9.0
    (row,) = compared(old, new)
    assert (row.figures, [d.path for d in row.differences]) == (3, ["a"])
    assert 1e-17 < row.differences[0].share < 2e-16
    assert not judged("identical", [], old, new, [row]).passed


def test_what_is_missing_or_of_another_kind_differs() -> None:
    """A figure that is gone or new, a job that is gone, 1 for True and text for a number."""
    rows = compared(jobs(gone=1, kind=True, text="1"), jobs(new=2, kind=1, text=1))
    found = {d.path: (d.old, d.new) for d in rows[0].differences}
    assert found["gone"] == (1, MISSING)
    assert found["new"] == (MISSING, 2)
    assert found.keys() == {"gone", "new", "kind", "text"}
    assert compared(jobs(a=1), {})[0].differences[0].new == MISSING


def test_nan_is_the_same_as_nan() -> None:
    """A figure that is undefined both times has not changed."""
    assert compared(jobs(a=float("nan")), jobs(a=float("nan")))[0].differences == []


def test_relative_differences_are_of_numbers() -> None:
    """10 % either way; text, truth values and infinities have none."""
    assert relative(9.0, 10.0) == relative(10.0, 9.0) == pytest.approx(0.1)
    assert relative(0.0, 2.0) == 1.0
    assert {relative(*pair) for pair in (("a", 1), (True, 2), (float("inf"), 1))} == {float("inf")}


def test_table_shows_the_largest_difference_or_all() -> None:
    """One line a job, with every=True one line a figure."""
    rows = compared(jobs(a=1.0, b=1.0, c="x"), jobs(a=1.1, b=2.0, c="y"))
    assert "| one | 3 | 3 | b | 1.0 | 2.0 | 0.5 |" in markdown(rows, every=False)
    assert len(markdown(rows, every=True).splitlines()) == 2 + 3
    assert "| identical |" in markdown(compared(jobs(a=1), jobs(a=1)), every=True)


def test_interval_of_the_ratio_covers_the_truth() -> None:
    """Of 400 pairs of trainings from one distribution about 90 % of the intervals hold 1."""
    rng = np.random.default_rng(5)
    drawn = rng.normal(400.0, 80.0, (400, 2, 20))
    held = [low <= 1 <= high for low, high in (ratio(old, new) for old, new in drawn)]
    assert 0.86 < np.mean(held) < 0.94


@pytest.mark.parametrize(("factor", "passed"), [(1.02, True), (0.98, True), (1.3, False)])
def test_trainings_are_alike_within_the_tolerance(factor: float, passed: bool) -> None:
    """The whole interval of the ratio must be within 15 %; "printed" only tells."""
    old = np.random.default_rng(1).normal(400.0, 40.0, 20)
    before, after = returns(old), returns(factor * old)
    rows = compared(before, after)
    verdict = judged("alike", ["source_return"], before, after, rows)
    assert verdict.passed == passed
    assert f"ratio {factor:.3f}" in verdict.sentence
    assert judged("printed", ["source_return"], before, after, rows).passed


def test_too_few_or_too_scattered_trainings_show_nothing() -> None:
    """Equal means of five wild trainings are no proof; one training cannot be judged."""
    wild = np.array([100.0, 900.0, 200.0, 800.0, 500.0])
    before, after = returns(wild), returns(wild[::-1] + 1.0)
    rows = compared(before, after)
    assert not judged("alike", ["source_return"], before, after, rows).passed
    one = returns(wild[:1])
    sentence = judged("alike", ["source_return"], one, returns(wild[1:2]), rows).sentence
    assert "fewer than two" in sentence


@pytest.fixture
def recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> golden.Recorder:
    """A recorder whose runs only write a manifest and a figure, and are counted there."""

    def call(self: golden.Recorder, arguments: list[str]) -> float:
        run = Path(arguments[-1].removeprefix("hydra.run.dir="))
        run.mkdir(parents=True)
        about = {"git": {"revision": "r", "dirty": False}, "machine": {"cpu": "c"}}
        (run / "manifest.json").write_text(json.dumps(about))
        with (tmp_path / "calls").open("a") as file:
            file.write(".")
        return 2.04

    def read(run: Path) -> Figures:
        return {"runs": len((tmp_path / "calls").read_text())}

    part = Part(lambda: [Job("one", ("+experiment=esmaml",), read)])
    monkeypatch.setitem(PARTS, "esmaml", part)
    monkeypatch.setattr(golden.Recorder, "call", call)
    return golden.Recorder(tmp_path, "code1", tmp_path / "out", fresh=False)


def test_a_run_is_repeated_only_for_other_code(recorder: golden.Recorder) -> None:
    """The record has the command and its cost; the same code is not run twice, other code is."""
    first = json.loads(recorder.record("esmaml").read_text())
    assert first["made"] == {"code": "code1", "revision": "r", "dirty": False, "cpu": "c"}
    command = "python -m sim2real +experiment=esmaml"
    assert first["jobs"]["one"] == {"command": command, "cpu_seconds": 2.0, "figures": {"runs": 1}}
    again = json.loads(recorder.record("esmaml").read_text())
    assert again == first
    other = recorder._replace(code="code2")
    assert json.loads(other.record("esmaml").read_text())["jobs"]["one"]["figures"] == {"runs": 2}


def test_compare_tells_by_its_status(
    recorder: golden.Recorder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """0 for the same record, 1 for another one and for one that is not there."""
    recorder.record("esmaml")
    old, out = str(tmp_path / "out"), str(tmp_path / "new")
    given = ["compare", "--only", "esmaml", "--with", old, "--new"]
    assert golden.main([*given, old]) == 0
    assert "**identical**: 1 of 1 jobs" in capsys.readouterr().out
    assert golden.main([*given, out]) == 1
    assert "no " in capsys.readouterr().out
    recorder._replace(out=tmp_path / "new", code="code2").record("esmaml")
    assert golden.main([*given, out]) == 1
    assert "| one | 1 | 1 | runs | 1 | 2 | 0.5 |" in capsys.readouterr().out


def test_an_unknown_part_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """Before anything runs, with the parts that there are."""
    with pytest.raises(SystemExit):
        golden.main(["record", "--only", "esmalm"])
    assert "'esmalm'; there are: esmaml, deploy" in capsys.readouterr().err


def test_nothing_of_the_project_is_imported() -> None:
    """The recorder outlives a move of every module that it records."""
    rooms = "|".join(golden.CODE)
    for file in Path(golden.__file__).parent.glob("golden*.py"):
        text = file.read_text(encoding="utf-8")
        assert re.findall(rf"^\s*(?:from|import) (?:{rooms})\b.*", text, re.MULTILINE) == []


def test_other_code_has_another_fingerprint(tmp_path: Path) -> None:
    """A file that git does not know yet counts; one outside of the code does not."""
    golden.subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    (tmp_path / "envs").mkdir()
    (tmp_path / "envs" / "a.py").write_text("a = 1\n")
    first = golden.fingerprint(tmp_path)
    (tmp_path / "README.md").write_text("text\n")
    assert golden.fingerprint(tmp_path) == first
    (tmp_path / "envs" / "a.py").write_text("a = 2\n")
    assert golden.fingerprint(tmp_path) != first


def test_checkpoints_are_read_without_their_random_generators(tmp_path: Path) -> None:
    """Arrays are told by shape and bytes, whatever they are called."""
    folder = tmp_path / "checkpoints"
    folder.mkdir()
    for run, name in (("00", "0"), ("01", "mean")):
        npz, made = tmp_path / f"{run}.npz", folder / f"checkpoint-{run}.torchrl"
        held: dict[str, Any] = {name: np.arange(3.0)}
        np.savez(npz, **held)
        with zipfile.ZipFile(made, "w") as archive:
            archive.write(npz, "components/0000-algorithm/arrays.npz")
            archive.write(npz, "components/0001-random/arrays.npz")
        (found,) = arrays(tmp_path)
        assert found.startswith("(3,) ")
        assert found.endswith(golden.sha256(np.arange(3.0).tobytes()))


def test_cells_of_a_table_are_numbers_text_or_nothing(tmp_path: Path) -> None:
    """Every digit of a number is kept."""
    (tmp_path / "a.csv").write_text("name,value\nx,0.1234567890123456\ny,\n")
    assert columns(tmp_path / "a.csv") == {"name": ["x", "y"], "value": [0.1234567890123456, None]}
