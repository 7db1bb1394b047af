"""Paths that a command names are there before anything is written; each run has its own folder."""

from pathlib import Path

import pytest

from sim2real.config.compose import compose, used_keys
from sim2real.config.folders import check_paths_exist, free_folder
from sim2real.config.targets import ConfigError


def test_two_runs_of_one_second_have_two_folders(tmp_path: Path) -> None:
    """The name that is taken gets a number; one below a file is left to whoever makes it."""
    wanted = str(tmp_path / "train" / "2026-11-22_10-00-00")
    assert [free_folder(wanted) for _ in range(3)] == [wanted, f"{wanted}_2", f"{wanted}_3"]
    assert all(path.is_dir() for path in (tmp_path / "train").iterdir())
    (tmp_path / "file").touch()
    assert free_folder(str(tmp_path / "file" / "run")) == str(tmp_path / "file" / "run")


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (["run=replay"], "replay needs log=PATH"),
        (["run=replay", "log=swin.csv"], r"log=swin.csv: no such .*'swing.csv'"),
        (["run=replay", "log=swing.csv", "model=a.xml"], "model=a.xml: no such file"),
        (["run=replay", "log=[swing.csv,b.csv]"], "log=b.csv: no such"),
        (["run=export", "checkpoint=nowhere"], "checkpoint=nowhere: no such"),
        (["run=evaluate"], "evaluate needs checkpoint=PATH"),
        (["run=export"], "export needs checkpoint=PATH"),
        (["run=export", "to=mjcf", "effects=e.yaml"], "effects=e.yaml: no such"),
        (["run=improve"], "improve needs checkpoint=PATH"),
        (["+experiment=smoke", "resume=nowhere"], "resume=nowhere: no such"),
    ],
)
def test_what_is_not_there_is_refused_first(typed, sentence, tmp_path, monkeypatch) -> None:
    """Logs, models, checkpoints and runs to resume, with the key and the nearest name."""
    monkeypatch.chdir(tmp_path)
    Path("swing.csv").touch()
    tree = compose(typed)
    with pytest.raises(ConfigError, match=sentence):
        check_paths_exist(tree, used_keys(tree))


def test_what_is_there_and_what_a_verb_does_not_use_passes(tmp_path: Path) -> None:
    """A home folder's `~` is read, and no path at all is fine where none is needed."""
    (tmp_path / "swing.csv").touch()
    for typed in (
        ["run=replay", f"log={tmp_path}/swing.csv"],
        ["+experiment=smoke"],
        ["run=record", "leader=so101_leader"],  # the name of a robot
        ["run=contract", f"log={tmp_path}/swing.csv", "observation=legged_gym"],
        ["run=improve", "by=returns", "+experiment=udr"],
        ["run=export", f"effects={tmp_path}/swing.csv", f"model={tmp_path}/swing.csv", "to=mjcf"],
    ):
        tree = compose(typed)
        check_paths_exist(tree, used_keys(tree))


def test_one_line_starts_an_exam_and_continues_it(tmp_path: Path) -> None:
    """`resume=` may name a folder that the exam is only going to make."""
    tree = compose(["+experiment=blindcheck_small", f"resume={tmp_path}/exam"])
    check_paths_exist(tree, used_keys(tree))
