"""The exam from end to end, with a diagnosis that is told the truth, or nothing."""

import json
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from envs.effects import Effect, make, write_effects
from sim2real.exam import hold as blindcheck
from sim2real.exam import logs as logs_module
from sim2real.exam import seal, sizes
from sim2real.exam.cases import KEY, Exam, Outline
from sim2real.exam.hiding import EFFECTS
from sim2real.exam.hold import share
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.verbs.blindcheck import run

EXAM = Exam(["bench1"], one=1, two=0, none=1, excluded=0, longest=60.0, block=2, sample=3)
asked: list[str] = []


def oracle(logs: Path, answer: Path, longest: float) -> None:
    """Answer with what the key says, in the form of a report."""
    asked.append(logs.name)
    answer.mkdir(parents=True, exist_ok=True)
    key = json.loads((logs.parents[1] / "keys" / logs.name / KEY).read_text())
    causes = [
        {
            "effect": t["effect"],
            "where": t["joint"],
            "side": t["side"],
            "unit": "",
            "equivalent": [],
        }
        | {"value": t["value"], "value_ci": [t["value"], t["value"]], "confidence": 1.0}
        | {"extra": t["extra"] | ({"body": t["where"]} if t["where"] == "arm" else {})}
        for t in key["truths"]
    ]
    write_effects(answer / "effects.yaml", [_effect(t) for t in key["truths"]])
    found = {"verdict": "explained" if causes else "no_gap", "causes": causes, "seconds": 1.0}
    found |= {"gap": {"closed": 1.0 if causes else None}, "where": [{"joint": "hinge"}]}
    write_text(answer / "report.json", json.dumps(found))


def _effect(truth: dict) -> tuple[Effect, tuple[float, ...]]:
    effect = make(truth["effect"], where=truth["where"], side=truth["side"], **truth["extra"])
    return effect, (truth["value"],)


@pytest.fixture(scope="module")
def exam(tmp_path_factory: pytest.TempPathFactory):
    """A small exam, answered by the oracle: its folder and marks."""
    out = tmp_path_factory.mktemp("exam")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(logs_module, "SECONDS", 3.0)
        patch.setattr(logs_module, "AGAIN", 1.0)
        patch.setattr(sizes, "TRIALS", 4)
        patch.setattr(blindcheck, "ask", oracle)
        asked.clear()
        yield out, run(exam=EXAM, seed=1, resume=None, out=out)


@pytest.mark.slow
def test_who_knows_the_truth_passes(exam) -> None:
    """Every effect is named, closes the gap of a log that was held back, and nothing is alarmed."""
    _, marks = exam
    hidden = [one for one in marks if one.kind == "one"]
    assert len(marks) == 3 and len(hidden) == 2
    assert all(one.rank1 and one.place for one in hidden)
    assert all(one.closed > 0.5 for one in hidden)
    assert [one.alarm for one in marks if one.kind == "none"] == [False]


@pytest.mark.slow
def test_the_tables_are_written(exam) -> None:
    """For people and for programs."""
    out, marks = exam
    page = (out / "table.md").read_text()
    assert f"{len(marks)} of 3 cases of seed 1 were answered" in page
    assert "| rank 1 right | 2 | 1.00 [0.34, 1.00] | ≥ 0.90 |" in page
    assert json.loads((out / "score.json").read_text())["figures"]["place right"][0] == 2
    assert (out / "plots" / "matrix.png").is_file()
    assert len((out / "cases.csv").read_text().splitlines()) == 4


@pytest.mark.slow
def test_an_exam_goes_on_where_it_stopped(exam, tmp_path: Path) -> None:
    """Cases and answers that are there are not made again."""
    out, marks = exam
    before = len(asked)
    (out / "answers" / "case_001" / "report.json").unlink()
    again = run(exam=EXAM, seed=1, resume=str(out), out=tmp_path)
    assert again == marks
    assert asked[before:] == ["case_001"]


@pytest.mark.slow
def test_what_is_answered_is_scored_and_called_a_part(exam, tmp_path: Path, monkeypatch) -> None:
    """`most` cases are asked and no more; the tables say how many of how many there are."""
    out, marks = exam
    part = tmp_path / "part"
    shutil.copytree(out, part)
    for name in ("case_001", "case_002"):
        (part / "answers" / name / "report.json").unlink()
    monkeypatch.setattr(blindcheck, "ask", oracle)
    found = run(exam=replace(EXAM, most=1), seed=1, resume=str(part), out=tmp_path)
    assert [one.case for one in found] == ["case_000", "case_001"]
    assert "**partial: true.** 2 of 3 cases" in (part / "table.md").read_text()
    told = json.loads((part / "score.json").read_text())
    assert (told["partial"], told["answered"], told["cases"]) == (True, 2, 3)
    assert run(exam=EXAM, seed=1, resume=str(part), out=tmp_path) == marks
    assert not json.loads((part / "score.json").read_text())["partial"]


def test_a_block_is_sealed_before_its_first_question(tmp_path: Path, monkeypatch) -> None:
    """Two are made, sealed and asked, then the next one; whoever stops has made no more."""
    told: list[str] = []

    class Fake(blindcheck.Examiner):
        def draw(self, seed: int) -> list[Outline]:
            return [Outline(f"case_{i:03d}", "none", "bench1", (), i) for i in range(3)]

        def make(self, outline: Outline, logs: Path, key: Path) -> bool:
            told.append(f"made {outline.name}")
            write_text(logs / "a.csv", "")
            write_text(key / KEY, "{}")
            return True

    def ask(logs: Path, answer: Path, longest: float) -> None:
        assert logs.name in seal.cases(logs.parent)
        told.append(f"asked {logs.name}")
        write_text(answer / "report.json", "{}")

    monkeypatch.setattr(blindcheck, "ask", ask)
    fake = Fake(longest=60.0, block=2)
    blindcheck.hold(replace(fake, most=1), fake.draw(0), tmp_path)
    assert told == ["made case_000", "made case_001", "asked case_000"]
    blindcheck.hold(fake, fake.draw(0), tmp_path)
    assert told[3:] == ["asked case_001", "made case_002", "asked case_002"]


@pytest.mark.slow
def test_after_ctrl_c_what_is_answered_is_scored(exam, tmp_path: Path, monkeypatch) -> None:
    """The tables are there, and the interrupt goes on to whoever called."""
    out, _ = exam
    part = tmp_path / "part"
    shutil.copytree(out, part)
    (part / "answers" / "case_002" / "report.json").unlink()
    (part / "table.md").unlink()

    def interrupted(logs: Path, answer: Path, longest: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(blindcheck, "ask", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(exam=EXAM, seed=1, resume=str(part), out=tmp_path)
    assert "2 of 3 cases" in (part / "table.md").read_text()
    shutil.rmtree(part / "answers")
    with pytest.raises(KeyboardInterrupt, match="no case was answered"):
        run(exam=EXAM, seed=1, resume=str(part), out=tmp_path)


def test_two_programs_share_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each piece is done once, by either; both come back when all is done."""
    monkeypatch.setattr(blindcheck, "PATIENCE", 0.01)
    names = [str(number) for number in range(12)]
    finished: list[tuple[int, str]] = []

    def work(who: int) -> None:
        def do(name: str) -> None:
            time.sleep(0.01)
            finished.append((who, name))

        share(names, lambda name: name in [n for _, n in finished], do, tmp_path)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(work, (0, 1)))
    assert sorted(name for _, name in finished) == sorted(names)
    assert {who for who, _ in finished} == {0, 1}


@pytest.mark.slow
def test_several_versions_of_the_diagnosis_are_told(exam, tmp_path: Path) -> None:
    """An exam whose answers are of different code says so."""
    out, _ = exam
    part = tmp_path / "part"
    shutil.copytree(out, part)
    for name, text in (("case_000", "abc"), ("case_001", "abc"), ("case_002", "def")):
        (part / "answers" / name / "version.txt").write_text(f"{text}\n")
    run(exam=EXAM, seed=1, resume=str(part), out=tmp_path)
    assert "2 by abc, 1 by def" in (part / "table.md").read_text()


@pytest.mark.slow
def test_a_key_that_was_changed_is_refused(exam, tmp_path: Path) -> None:
    """Whoever changes the key after the logs are out gets no score."""
    out, _ = exam
    key = out / "keys" / "case_000" / KEY
    text = key.read_text()
    key.write_text(text.replace("bench1", "bench2"))
    with pytest.raises(Sim2RealError, match="was changed after the exam was sealed"):
        run(exam=EXAM, seed=1, resume=str(out), out=tmp_path)
    key.write_text(text)


@pytest.mark.slow
def test_no_answer_folder_and_no_key_is_given_to_a_diagnosis(exam) -> None:
    """Nothing in the folders that it is given names an effect or a key."""
    out, _ = exam
    told = {"command_delay", "armature", "supply_voltage"}  # words of the model and its robot
    for file in (out / "logs").glob("case_*/*"):
        text = file.read_text()
        assert "keys" not in text
        assert not any(effect in text for effect in EFFECTS if effect not in told)
