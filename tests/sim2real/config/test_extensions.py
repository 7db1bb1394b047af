"""A folder of a user's own: its groups and modules are in reach of every verb."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware.config import load_robot
from hardware.formats import FORMATS
from sim2real.config import extensions
from sim2real.config.catalogue import CONF, lines, options
from sim2real.config.compose import compose
from sim2real.config.targets import ConfigError, build, check

READER = """
from hardware.formats import Format, register

register(Format("mine", lambda path: path.suffix == ".mine", lambda path: ({}, {})))
"""
PLAIN = """
class Plain:
    def __init__(self, *, width: float) -> None:
        self.width = width
"""


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Path]:
    """A folder with a module, a group's choice, a robot and an experiment."""
    folder = tmp_path / "my parts"
    for group in ("adapt", "robot", "experiment"):
        (folder / group).mkdir(parents=True)
    (folder / "my_plain.py").write_text(PLAIN)
    (folder / "adapt" / "plain.yaml").write_text("# mine\n_target_: my_plain.Plain\nwidth: 1.0\n")
    (folder / "robot" / "mine.yaml").write_text((CONF / "robot" / "bench1.yaml").read_text())
    text = "# @package _global_\n# a try\ndefaults:\n  - override /adapt: plain\n"
    (folder / "experiment" / "try.yaml").write_text(text)
    formats = list(FORMATS)
    yield folder
    FORMATS[:] = formats


def test_groups_and_modules_are_found(own: Path) -> None:
    """A choice, an experiment and a class outside the repository are composed and built."""
    extensions.activate(own)
    assert "plain" in options("adapt")
    assert any("try" in line and "a try" in line for line in lines())
    tree = compose(["+experiment=try", "adapt.width=2.5"])
    assert tree["adapt"] == {"_target_": "my_plain.Plain", "width": 2.5}
    assert build(tree["adapt"], "adapt").width == 2.5


def test_mistakes_in_them_are_sentences(own: Path) -> None:
    """A wrong key, a wrong type and a class that is not there are refused without an import."""
    extensions.activate(own)
    with pytest.raises(ConfigError, match=r"adapt.widht: .*did you mean 'width'"):
        check({"_target_": "my_plain.Plain", "widht": 1.0}, "adapt")
    with pytest.raises(ConfigError, match="expected a number"):
        check({"_target_": "my_plain.Plain", "width": "wide"}, "adapt")
    with pytest.raises(ConfigError, match=r"no such class.*did you mean 'Plain'"):
        check({"_target_": "my_plain.Plane"}, "adapt")
    assert "my_plain" not in sys.modules


def test_without_the_folder_nothing_is_allowed(own: Path) -> None:
    """What a configuration names is not imported because it lies somewhere."""
    with pytest.raises(ConfigError, match="not allowed"):
        check({"_target_": "my_plain.Plain", "width": 1.0}, "adapt")


def test_modules_register_what_they_bring(own: Path) -> None:
    """Every module is imported before a verb starts; one that fails is named."""
    (own / "my_reader.py").write_text(READER)
    extensions.activate(own)
    extensions.load()
    assert FORMATS[0].name == "mine"
    (own / "my_fault.py").write_text("1 / 0")
    with pytest.raises(ConfigError, match="'my_fault' cannot be imported: ZeroDivisionError"):
        extensions.load()


def test_a_module_that_would_hide_another_is_refused(own: Path) -> None:
    """A name that Python finds elsewhere already cannot be a user's module."""
    (own / "json.py").write_text("")
    with pytest.raises(ConfigError, match="'json' exists already"):
        extensions.activate(own)
    with pytest.raises(ConfigError, match="no such folder"):
        extensions.activate(own / "none")


def test_robots_are_found_by_name(own: Path) -> None:
    """`robot=mine` works in every verb and in `python -m hardware`."""
    extensions.activate(own)
    assert load_robot("mine").rate == load_robot("bench1").rate
    assert "mine" in options("robot")


@pytest.mark.parametrize(
    ("line", "folder", "rest"),
    [
        (["a=1", "--config-dir", "d", "-m"], "d", ["a=1", "-m"]),
        (["-cd=d", "a=1"], "d", ["a=1"]),
        (["a=1"], None, ["a=1"]),
    ],
)
def test_the_option_is_taken_off_the_line(line: list[str], folder, rest, monkeypatch) -> None:
    """Both spellings are understood; without, the environment says."""
    monkeypatch.delenv(extensions.VARIABLE, raising=False)
    assert extensions.of_arguments(line) == folder
    assert extensions.without_option(line) == rest
    monkeypatch.setenv(extensions.VARIABLE, "other")
    assert extensions.of_arguments(["a=1"]) == "other"
