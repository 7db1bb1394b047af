"""The seal: keys that were touched are refused."""

from pathlib import Path

import pytest

from sim2real.exam import seal
from sim2real.runs.errors import Sim2RealError


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Return keys and logs, sealed."""
    keys, logs = tmp_path / "keys", tmp_path / "logs"
    (keys / "case_000").mkdir(parents=True)
    logs.mkdir()
    (keys / "case_000" / "key.json").write_text("{}")
    seal.close(keys, logs, ["case_000"])
    return keys, logs


def test_untouched_keys_pass(folders: tuple[Path, Path]) -> None:
    """What was sealed is what is opened."""
    seal.check(*folders)


@pytest.mark.parametrize("how", ["changed", "added", "gone"])
def test_touched_keys_are_refused(folders: tuple[Path, Path], how: str) -> None:
    """The message says which file, and what became of it."""
    keys, _ = folders
    file = keys / "case_000" / ("other.json" if how == "added" else "key.json")
    file.unlink() if how == "gone" else file.write_text('{"a": 1}')
    with pytest.raises(Sim2RealError, match=f"{file.name} was {how}"):
        seal.check(*folders)


def test_a_seal_grows_and_keeps_what_it_holds(folders: tuple[Path, Path]) -> None:
    """Further cases are added; one that was sealed is not sealed again with other numbers."""
    keys, logs = folders
    (keys / "case_001").mkdir()
    (keys / "case_001" / "key.json").write_text("[]")
    seal.check(keys, logs)  # what is not sealed yet is not looked at
    assert seal.cases(logs) == ["case_000"]
    (keys / "case_000" / "key.json").write_text("other")
    seal.close(keys, logs, ["case_000", "case_001"])
    assert seal.cases(logs) == ["case_000", "case_001"]
    with pytest.raises(Sim2RealError, match=r"case_000/key.json was changed"):
        seal.check(keys, logs)


def test_logs_without_a_seal_are_refused(folders: tuple[Path, Path]) -> None:
    """A score without a seal would mean nothing."""
    keys, logs = folders
    (logs / seal.SEAL).unlink()
    with pytest.raises(Sim2RealError, match="never sealed"):
        seal.check(keys, logs)
