"""The verb `convert`: any log as ours, or a first mapping of its columns."""

from pathlib import Path

import pytest

from hardware.log import read_log
from sim2real.runs.errors import Sim2RealError
from tests.hardware.formats.recorded import mcap, run
from tests.sim2real.trained import run_verb


def convert(out: Path, *words: str) -> list[Path]:
    """Convert as the command line does."""
    return run_verb(["run=convert", *words], out)


def test_a_recording_of_messages_becomes_a_csv(tmp_path: Path) -> None:
    """The CSV that comes out reads back as the recording itself does."""
    path = mcap(tmp_path, run())
    mapping = tmp_path / "topics.yaml"
    mapping.write_text(mapping.read_text().replace("to: qpos", "to: qpos\n  unit: deg"))
    (made,) = convert(tmp_path / "out", f"log={path}", "joints=[a,b]")
    assert made == tmp_path / "out" / "run.csv"
    log, before = read_log(made), read_log(path)
    assert log.joints == ["a", "b"]
    assert (log.column("qpos.a") == before.column("qpos.pan")).all()
    assert log.meta["source_units"] == {"qpos.a": "deg", "qpos.b": "deg"}


def test_a_first_mapping_is_written_instead(tmp_path: Path) -> None:
    """columns= writes the mapping, and no log."""
    (tmp_path / "a.csv").write_text("t,cmd_pan,pos_pan\n0,1,0.5\n0.1,1,0.6\n")
    mapping = tmp_path / "columns.yaml"
    assert convert(tmp_path / "out", f"log={tmp_path / 'a.csv'}", f"columns={mapping}") == [mapping]
    assert not (tmp_path / "out").exists()


def test_nothing_to_convert_is_refused(tmp_path: Path) -> None:
    """A missing log is asked for; two logs have no common first mapping."""
    with pytest.raises(Sim2RealError, match="give log=PATH"):
        convert(tmp_path)
    with pytest.raises(Sim2RealError, match="2 were given"):
        convert(tmp_path, "log=[a.csv,b.csv]", "columns=x.yaml")
