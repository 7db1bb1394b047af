"""Studies by cases: what is there is not judged again, and what is written reads back."""

from pathlib import Path
from typing import Any, NamedTuple

import pytest

from benchmarks.cases import Cases, share, typed


class Said(NamedTuple):
    """A row."""

    case: str
    robot: str
    right: int
    off: float


def test_a_study_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    """After each case the file is whole; other seeds and other robots stay, and count apart."""
    judged: list[int] = []

    def judge(number: int) -> list[dict[str, Any]]:
        if number == 2 and len(judged) < 3:
            raise KeyboardInterrupt
        judged.append(number)
        return [Said(f"4-{number}", "arm2", number % 2, 0.1 * k)._asdict() for k in range(2)]

    file = tmp_path / "said.csv"
    with pytest.raises(KeyboardInterrupt):
        Cases(file, Said._fields).run(4, 3, judge)
    assert len(Cases(file, Said._fields).rows) == 4
    judged.append(-1)
    rows = typed(Said, Cases(file, Said._fields).run(4, 3, judge))
    assert judged == [0, 1, -1, 2]
    assert rows[3] == Said("4-1", "arm2", 1, 0.1) and len(rows) == 6
    cases = Cases(file, Said._fields)
    other = cases.run(4, 1, lambda n: [{"case": f"4-{n}", "robot": "quad8"}], robot="quad8")
    assert [row["robot"] for row in other] == ["quad8"] and other[0]["right"] == ""
    assert len(cases.run(4, 1, judge, robot="arm2")) == 6
    assert cases.run(5, 0, judge) == []


def test_a_share_has_its_exact_interval() -> None:
    """None of three: up to 0.708 (1 - 0.025 ** (1 / 3))."""
    found = share([0, 0, 0])
    assert (found.value, found.low) == (0.0, 0.0)
    assert found.high == pytest.approx(1 - 0.025 ** (1 / 3))
    assert share([True, False]).value == 0.5
