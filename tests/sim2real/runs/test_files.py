"""Files are whole or absent, have the permissions of any other file; a folder has one holder."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envs.effects import make, write_effects
from sim2real.runs.files import atomic_folder, folder_lock, write_text

HOLDER = """
import sys
from sim2real.runs.files import folder_lock
with folder_lock(sys.argv[1]) as mine:
    print(mine, flush=True)
    sys.stdin.read()
"""


def _effects(path: Path) -> None:
    write_effects(path, [(make("coulomb_friction", where="elbow"), (0.1,))])


@pytest.mark.parametrize("write", [lambda path: write_text(path, "a"), _effects])
def test_files_have_the_permissions_of_any_other(tmp_path, write: Callable[[Path], object]) -> None:
    """The umask decides: what a group may read, it may read here too."""
    before = os.umask(0o027)
    try:
        write(tmp_path / "one.yaml")
        (tmp_path / "other.yaml").write_text("a")
    finally:
        os.umask(before)
    one, other = ((tmp_path / name).stat().st_mode for name in ("one.yaml", "other.yaml"))
    assert one == other
    assert len(list(tmp_path.iterdir())) == 2


def test_a_file_that_cannot_be_written_leaves_the_former_one(tmp_path: Path) -> None:
    """Neither half a file nor a temporary one stays."""
    write_text(tmp_path / "a.txt", "before")
    with pytest.raises(UnicodeEncodeError):
        write_text(tmp_path / "a.txt", "after \ud800")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "before"


def test_a_folder_has_one_holder_and_is_free_after_its_end(tmp_path: Path) -> None:
    """Another process is told that the folder is taken, until the holder ends."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline().strip() == b"True"
        with folder_lock(tmp_path) as mine:
            assert not mine
        holder.kill()
        holder.wait()
    for _ in range(2):
        with folder_lock(tmp_path) as mine:
            assert mine


def test_a_folder_is_whole_or_absent(tmp_path: Path) -> None:
    """What fails leaves nothing, and what a killed process left is gone with the next try."""
    (tmp_path / ".step-killed").mkdir()
    with pytest.raises(ZeroDivisionError), atomic_folder(tmp_path / "step") as made:
        (made / "half").touch()
        assert not (tmp_path / "step").exists()
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    with atomic_folder(tmp_path / "step") as made:
        (made / "all").touch()
    assert [path.name for path in (tmp_path / "step").iterdir()] == ["all"]
    assert len(list(tmp_path.iterdir())) == 1
