"""The exam on other engines: cases are drawn, made, sealed and scored."""

import json
from pathlib import Path
from typing import Any

import pytest

from hardware.log import read_logs
from sim2real.exam import hold, seal
from sim2real.exam.thirdparty import make
from sim2real.exam.thirdparty.exam import EngineExam
from sim2real.exam.thirdparty.kinds import KINDS
from sim2real.runs.errors import Sim2RealError

pytestmark = pytest.mark.slow
pytest.importorskip("dartpy", reason="needs DART: pip install 'sim2real[engines]'")
SMALL: dict[str, Any] = {
    "kinds": list(KINDS), "cases_per_kind": 2, "half": "calibration", "engine": "dart",
    "seconds": 8.0, "longest": 600.0, "block": 8,
}  # fmt: skip


def test_a_seed_draws_the_same_cases_and_halves_share_none() -> None:
    """Kinds take turns, so that an exam that is stopped has some of each."""
    drawn = EngineExam(**SMALL).draw(3)
    assert drawn == EngineExam(**SMALL).draw(3)
    assert [one.kind for one in drawn] == list(KINDS) * 2
    assert EngineExam(**SMALL, skip=3).draw(3) == drawn[3:]  # what was not opened before
    sealed = EngineExam(**{**SMALL, "half": "sealed"}).draw(3)
    assert not {one.seed for one in drawn} & {one.seed for one in sealed}
    more = EngineExam(**{**SMALL, "kinds": ["dirty"]}).draw(3)
    assert [one.effects for one in more] == [o.effects for o in drawn if o.kind == "dirty"]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"skip": 1000}, r"exam.skip=1000 must be from 0 to"),
        ({"kinds": ["dusty"]}, "dirty"),
        ({"kinds": []}, "at least one"),
        ({"half": "both"}, "calibration or sealed"),
        ({"engine": "bullet"}, "drake, dart"),
        ({"cases_per_kind": 0}, "cases_per_kind=0"),
        ({"seconds": 1.0}, "at least 8"),
        ({"block": 0}, "block=0"),
    ],
)
def test_settings_that_make_no_exam_are_refused(wrong: dict[str, Any], words: str) -> None:
    """The error says what is allowed, before anything is made."""
    with pytest.raises(Sim2RealError, match=words):
        EngineExam(**{**SMALL, **wrong})


def test_a_case_is_made_sealed_and_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs tell nothing of the key; an answer gets its marks, and a changed key is refused."""
    monkeypatch.setattr(make, "LOOK", 4.0)
    exam = EngineExam(**{**SMALL, "kinds": ["dirty"], "cases_per_kind": 1})
    outlines = exam.draw(1)
    (name,) = hold.prepare(exam, outlines, tmp_path)
    folder, keys = tmp_path / "logs" / name, tmp_path / "keys" / name
    assert sorted(p.name for p in folder.iterdir() if p.suffix != ".json") == [
        *("a.csv", "a_again.csv", "b.csv", "model.xml")
    ]
    assert len(read_logs(folder)) == 3
    key = json.loads((keys / "key.json").read_text())
    assert key["truths"][0]["gap"] >= 2 * key["background"] > 0
    assert key["truths"][0]["gap"] / key["floor"] >= 3
    assert key["residue"] < 2 * key["floor"]
    assert key["truths"][0]["effect"] not in "".join(
        file.read_text() for file in folder.iterdir() if file.suffix == ".json"
    )
    answer = tmp_path / "answers" / name
    answer.mkdir(parents=True)
    (answer / "error.txt").write_text("failed")
    (mark,) = exam.report(tmp_path, 1, 1)
    assert mark.rank1 is False
    assert "partial" not in (tmp_path / "table.md").read_text()
    (keys / "key.json").write_text(json.dumps(key | {"gap": 1.0}))
    with pytest.raises(Sim2RealError, match="changed after"):
        exam.report(tmp_path, 1, 1)
    assert seal.cases(tmp_path / "logs") == [name]
