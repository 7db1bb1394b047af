"""The pictures of the symptoms: the page shows one for each of its examples, and they are small."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.symptoms import PAGE, PICTURES, SPAN, draw, examples, main, stretch
from sim2real.diagnosis.data.replay import Gap

LARGEST = 60_000  # bytes


def gap(error: float) -> Gap:
    """Return 20 s of two joints; the second one is off by `error` from 10 s to 15 s."""
    time = np.arange(0, 20, 0.02)
    measured = np.column_stack([np.sin(time), np.cos(time)])
    simulated = measured + 1e-3
    simulated[(time >= 10) & (time < 10 + SPAN), 1] += error
    log: Any = SimpleNamespace(time=time)
    return Gap(log, ("pan", "lift"), measured, simulated)


def test_each_example_has_a_small_picture_on_the_page() -> None:
    """What the commands of the page record, a picture of the same name shows, and no others are."""
    text = PAGE.read_text(encoding="utf-8")
    assert len(examples()) >= 5
    assert {path.stem for path in PICTURES.iterdir()} == set(examples())
    for name in examples():
        assert f"](../images/symptoms/{name}.svg)" in text
        assert (PICTURES / f"{name}.svg").stat().st_size < LARGEST


def test_the_seconds_with_the_largest_error_are_shown() -> None:
    """The joint and the span in which the model as given is farthest from the robot."""
    joint, rows = stretch(gap(0.1))
    assert joint == 1
    assert (rows.start, rows.stop) == (500, 750)


def test_a_picture_is_the_same_each_time(tmp_path: Path) -> None:
    """The same replays give the same bytes: neither date nor random names stand in the file."""
    for name in ("a.svg", "b.svg"):
        draw(gap(0.1), gap(0.0), tmp_path / name)
    first = (tmp_path / "a.svg").read_bytes()
    assert first == (tmp_path / "b.svg").read_bytes()
    assert b"lift (rad)" in first and b"error (mrad)" in first


def test_an_unknown_example_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """The message names those that there are."""
    with pytest.raises(SystemExit):
        main(["wobble"])
    assert "unknown example wobble; known: sag" in capsys.readouterr().err
