"""What people type on the command line, and what Hydra is given for it."""

from pathlib import Path

import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser

from hardware.errors import RobotError
from hardware.robot_files import ROBOTS
from sim2real.config.arguments import as_overrides, find_shadowing_module, path_value
from sim2real.config.compose import compose
from sim2real.config.renamed import ENDED
from sim2real.config.targets import ConfigError


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["diagnose", "a.csv", "arm.xml"], ["run=diagnose", "log=a.csv", "model=arm.xml"]),
        (["replay", "arm.urdf", "a", "b"], ["run=replay", "log=[a,b]", "model=arm.urdf"]),
        (["evaluate", "runs/1", "seed=2"], ["run=evaluate", "checkpoint=runs/1", "seed=2"]),
        (["record", "bench1"], ["run=record", "robot=bench1"]),
        (["deploy", "runs/1", "robot=quad8"], ["run=deploy", "checkpoint=runs/1", "robot=quad8"]),
        (["train", "-m", "seed=0,1"], ["run=train", "-m", "seed=0,1"]),
        (["-m", "replay", "a.csv"], ["run=replay", "log=a.csv", "-m"]),
        (["record", "bench1", "--cfg", "job"], ["run=record", "robot=bench1", "--cfg", "job"]),
        (["--cfg", "job", "replay", "a.csv"], ["run=replay", "log=a.csv", "--cfg", "job"]),
        (["experiment=smoke"], ["+experiment=smoke"]),
        (["run=diagnose", "log=[a.csv,b.csv]"], ["run=diagnose", "log=[a.csv,b.csv]"]),
        (["-m", "run=replay", "log=a.csv,b.csv"], ["-m", "run=replay", "log=a.csv,b.csv"]),
    ],
)  # fmt: skip
def test_verbs_and_files_without_keys(typed: list[str], meant: list[str]) -> None:
    """A verb is named first, a model is known by its suffix, everything else has its key."""
    assert as_overrides(typed) == meant


@pytest.mark.parametrize(
    "name", ["a=1.csv", "swing (2).csv", "run[3].csv", "it's.csv", "a b.csv", "x{1}.csv", "a,b.csv"]
)
def test_any_path_reaches_the_verb(name: str, tmp_path: Path) -> None:
    """Hydra's parser returns the very path that was typed, whatever its characters."""
    path = tmp_path / name
    path.touch()
    (override,) = OverridesParser.create().parse_overrides(as_overrides([f"log={path}"]))
    assert override.value() == str(path)
    assert not override.is_sweep_override()
    (folder,) = OverridesParser.create().parse_overrides(as_overrides([f"hydra.run.dir={path}"]))
    assert folder.value() == str(path)


def test_home_is_expanded(monkeypatch: pytest.MonkeyPatch) -> None:
    """`~` is the home folder, in an override and after a verb."""
    monkeypatch.setenv("HOME", "/home/me")
    assert path_value("~/x.csv") == "/home/me/x.csv"
    assert as_overrides(["diagnose", "~/x.csv"]) == ["run=diagnose", "log=/home/me/x.csv"]


def test_a_robot_by_its_path(tmp_path: Path) -> None:
    """A file that is no choice of conf/robot is composed whole; its model is found beside it."""
    text = (ROBOTS / "arm2.yaml").read_text().replace("model: arm2.xml", "model: 'my arm.xml'")
    (tmp_path / "my arm.xml").touch()
    path = tmp_path / "mine (1).yaml"
    path.write_text(text.replace("name: arm2", 'name: "it\'s mine"'))
    expected = yaml.safe_load(path.read_text()) | {"model": str(tmp_path / "my arm.xml")}
    for typed in (
        ["record", str(path)],
        ["record", f"robot={path}"],
        ["record", f"follower={path}"],
    ):
        tree = compose([*as_overrides(typed), "robot.rate=25"])
        assert tree["robot"] == expected | {"rate": 25}
    with pytest.raises(RobotError, match=r"unknown robot 'none\.yaml'"):
        as_overrides(["record", "none.yaml"])


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (["+experimnt=smoke"], r"did you mean \+experiment=smoke"),
        (["diagnose", "a.csv", "b.xml", "c.xml"], "two models"),
        (["train", "hopper"], "train does not accept 'hopper'"),
        (["record", "bench1", "arm6"], "one robot"),
    ],
)
def test_what_cannot_be_meant_is_refused(typed: list[str], sentence: str) -> None:
    """A word in a place where none belongs is answered with what to write."""
    with pytest.raises(ConfigError, match=sentence):
        as_overrides(typed)


def test_a_package_that_hides_ours_is_named(tmp_path: Path) -> None:
    """Packages that are found elsewhere than beside conf/ are not ours."""
    assert find_shadowing_module() is None
    assert str(find_shadowing_module(tmp_path)).startswith("envs (")


@pytest.mark.parametrize("verb", ENDED)
@pytest.mark.parametrize("typed", ["{}", "run={}", "+experiment={}"])
def test_a_verb_that_ended_names_what_replaces_it(verb: str, typed: str) -> None:
    """In one sentence with a command; a file or a value of that name is none of its business."""
    with pytest.raises(ConfigError, match=rf"^{verb} has ended: .*sim2real \w+"):
        as_overrides([typed.format(verb), "seed=1"])
    assert as_overrides(["evaluate", verb]) == ["run=evaluate", f"checkpoint={verb}"]
