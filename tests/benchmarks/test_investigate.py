"""The table of what designed recordings part, and of what the menu parts in its order."""

from typing import Any

import pytest

from benchmarks import investigate


def robot(end: str, seconds: float, left: int = 0, **more: Any) -> dict[str, Any]:
    """Return what one robot's two ways were."""
    menu = {"seconds": 24.0, "left": left, "causes": 1}
    told = {"end": end, "seconds": seconds, "named": True, "left": 1, "menu": menu}
    return {"robot": "bench1", "effect": "backlash", "redrawn": 1, **told, **more}


def test_shares_and_seconds_are_counted() -> None:
    """What drawn motions part after all was wrong; seconds are of robots that both ways parted."""
    done = [
        robot("one_left", 8.0),
        robot("one_left", 4.0, left=2),
        robot("not_parted", 0.0, left=2, asked=1.0),
        robot("not_parted", 0.0, left=2, asked=5.0, named=False),
        {"robot": "arm2", "redrawn": 12},
    ]
    table = investigate.table(done)
    values = [[getattr(cell, "value", cell) for cell in row[1:]] for row in table.rows]
    assert values == [[0.5, 0.25], [0.75, None], [0.75, None], [8.0, 24.0]]
    assert "wrong 1 times" in table.notes[0]
    assert "16 draws" in table.notes[0]
    assert "by 5 floors at most; in 0 of these 2 the menu's logs" in table.notes[1]


def test_a_wrong_number_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """No robots at all is no benchmark."""
    with pytest.raises(SystemExit):
        investigate.main(["--robots", "0"])
    assert "--robots: 0 must be at least 1" in capsys.readouterr().err
