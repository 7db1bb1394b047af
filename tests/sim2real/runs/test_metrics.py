"""Tables of a run's numbers."""

from pathlib import Path

from sim2real.runs.metrics import MetricsFile


def test_a_metric_that_appears_later_adds_a_column(tmp_path: Path) -> None:
    """Earlier rows leave it empty, and numbers keep all their digits."""
    metrics = MetricsFile(tmp_path / "m.csv")
    metrics.write({"i": 1, "a": 0.1 + 0.2})
    metrics.write({"i": 2, "a": 1e-300, "b": 4.0})
    metrics = MetricsFile(tmp_path / "m.csv")
    metrics.write({"i": 3, "b": float("nan")})
    lines = (tmp_path / "m.csv").read_text().splitlines()
    assert lines == ["i,a,b", "1,0.30000000000000004,", "2,1e-300,4.0", "3,,nan"]


def test_a_cut_keeps_what_came_before(tmp_path: Path) -> None:
    """Rows after the last that counts go, with a torn one, and the rest keeps every byte."""
    metrics = MetricsFile(tmp_path / "m.csv")
    for i in range(1, 5):
        metrics.write({"i": i, "a": i / 3})
    text = (tmp_path / "m.csv").read_text()
    with (tmp_path / "m.csv").open("a") as file:
        file.write("5,0.")
    metrics.truncate("i", 4)
    assert (tmp_path / "m.csv").read_text() == text
    metrics.truncate("i", 2)
    assert (tmp_path / "m.csv").read_text() == "".join(text.splitlines(keepends=True)[:3])


def test_another_file_s_rows_are_taken_over(tmp_path: Path) -> None:
    """A run in a new folder starts with the rows of the one that it continues."""
    former = MetricsFile(tmp_path / "former.csv")
    for i in range(1, 4):
        former.write({"i": i, "a": 0.1 * i})
    here = MetricsFile(tmp_path / "here.csv")
    here.truncate("i", 2, former)
    here.write({"i": 3, "a": 0.1 * 3})
    assert (tmp_path / "here.csv").read_bytes() == (tmp_path / "former.csv").read_bytes()


def test_a_cleared_file_begins_with_its_header(tmp_path: Path) -> None:
    """What a killed run left behind goes, and the next rows have their names again."""
    MetricsFile(tmp_path / "metrics.csv").write({"a": 1.0, "b": 2.0})
    again = MetricsFile(tmp_path / "metrics.csv")
    again.clear()
    assert not again.path.exists()
    again.write({"a": 3.0, "b": 4.0})
    assert again.path.read_text() == "a,b\n3.0,4.0\n"
