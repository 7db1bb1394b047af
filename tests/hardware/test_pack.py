"""What is sent back from a robot: whole, and without a word about whose it is."""

import zipfile

import pytest

from hardware import commands, pack


@pytest.fixture
def first(tmp_path, monkeypatch):
    """Return a folder of runs by Ann at the machine bench-pc."""
    home = tmp_path / "home" / "ann"
    runs = home / "desk" / "first"
    (runs / "record").mkdir(parents=True)
    monkeypatch.chdir(runs.parent)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setattr(pack.getpass, "getuser", lambda: "ann")
    monkeypatch.setattr(pack.platform, "node", lambda: "bench-pc")
    (runs / "record" / "log.json").write_text(
        f'{{"model": "{home}/models/arm.xml", "cwd": "{runs.parent}", "by": "ann@bench-pc"}}'
    )
    (runs / "record" / "log.csv").write_text("episode,time,ctrl.annular\n0,0,1\n")
    (runs / "record" / "log.png").write_bytes(b"\x89PNG")
    return runs


def test_nothing_personal_is_packed(first, capsys):
    """Paths, user and machine are replaced; other words, and what was recorded, stay."""
    assert commands.main(["pack", "folder=first", "file=first.zip"]) == 0
    with zipfile.ZipFile("first.zip") as packed:
        assert packed.namelist() == ["first/record/log.csv", "first/record/log.json"]
        text = packed.read("first/record/log.json").decode()
        assert text == '{"model": "~/models/arm.xml", "cwd": ".", "by": "USER@HOST"}'
        assert "ctrl.annular" in packed.read("first/record/log.csv").decode()
    assert "2 files; look through it" in capsys.readouterr().out


def test_what_cannot_be_packed(first, capsys):
    """No folder, nothing in it, a file that is there: a sentence, and nothing is written."""
    (first.parent / "there.zip").write_text("kept")
    (first.parent / "empty").mkdir()
    for words, sentence in (
        (["folder=none", "file=a.zip"], "no such folder"),
        (["folder=empty", "file=a.zip"], "nothing in it ends in .csv"),
        (["folder=first", "file=there.zip"], "exists; remove it"),
        (["folder=first"], "file= is missing"),
    ):
        assert commands.main(["pack", *words]) == 2
        assert sentence in capsys.readouterr().err
    assert (first.parent / "there.zip").read_text() == "kept"
    assert not (first.parent / "a.zip").exists()
