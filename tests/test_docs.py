"""The documentation as it is typed: command lines parse, imports resolve, links lead somewhere."""

from __future__ import annotations

import argparse
import ast
import glob
import importlib
import re
import runpy
import shlex
import sys
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from hardware import commands as servos
from hardware.command_line import parse_keys
from hardware.config import load_robot
from sim2real.__main__ import precheck, readable

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted(
    path
    for pattern in ("*.md", "docs/**/*.md", "benchmarks/**/*.md")
    for path in ROOT.glob(pattern)
    if path.name.lower() != "changelog.md"  # they name commands that are gone
)
ROOMS = ("sim2real", "hardware", "envs")
SOURCES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
PROGRAM = re.compile(
    r"(?:[A-Z]\w*=\S+ )*"
    r"(?:sim2real(?= )|python -m [\w.]+|make(?= [a-z-]+(?: +#|$))|pip install|\.\.\.(?= \S+=))"
)
INLINE = re.compile(r"`([^`\n]+)`")
ENDED = re.compile(r"at `studies-1` by `[^`]+`")  # a command of the tag, which is gone since
PYTHON = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)")
STANDS_FOR = {  # what a reader replaces, and a value that composes
    r"<time>": "TIME",
    r"=NAME\b(?=.*port=)": "=bench1",
    r"\+experiment=NAME": "+experiment=smoke",
    r"\b(robot=|record )NAME": r"\1bench1",
    r"^\.\.\. ": "sim2real +experiment=esmaml ",
    r" \.\.\.(?= |$)": "",
    r" --cfg job": "",
    r"=([\d.e-]+,[\d.e-]+)(,[\d.e-]+)+": r"=\1",  # two values of a sweep stand for all
}
NOT_COMPOSED = {  # what a line needs that the repository does not hold
    "--config-dir my_parts": "a reader's own folder; tests/sim2real/config/test_extensions.py",
    "--config-dir tutorial_parts": "the tutorial's cells make the folder",
    "pip install sim2real": "the package's own name",
    "LIBRARY FOLDER ROWS": "the worker that one of our processes starts for itself",
}


class ParsedError(Exception):
    """A benchmark's arguments were right; nothing was measured."""


def lines_of(path: Path) -> Iterator[str]:
    """Yield a page's code, inline and in fences without a language; a source's indented lines."""
    text = ENDED.sub("", path.read_text(encoding="utf-8").replace("\\\n", " "))
    if path.suffix == ".py":
        yield from (line.strip() for line in text.splitlines() if line.startswith("    "))
        return
    fence = None
    for line in text.splitlines():
        if line.startswith("```"):
            fence = None if fence is not None else line[3:]
        elif fence is None:
            yield from INLINE.findall(line)
        elif not fence:
            yield line


def commands() -> dict[str, str]:
    """Return every command line that is printed somewhere, placeholders replaced, and its place."""
    found: dict[str, str] = {}
    for path in [*PAGES, *SOURCES]:
        for line in lines_of(path):
            if not PROGRAM.match(line) or any(part in line for part in NOT_COMPOSED):
                continue
            for shown, meant in STANDS_FOR.items():
                line = re.sub(shown, meant, line)
            found.setdefault(shlex.join(words_of(line)), str(path.relative_to(ROOT)))
    return found


def words_of(line: str) -> list[str]:
    """Return a command line as a shell passes it on, without the environment before it.

    Braces and spaces that a shell would take apart must be quoted, or their halves are refused.
    """
    words = shlex.split(line, comments=True)
    while re.fullmatch(r"[A-Z]\w*=.*", words[0]):
        words.pop(0)
    return words


def check_servos(words: list[str]) -> None:
    """Take a command of `python -m hardware`: its verb, its keys, and a robot of conf/robot."""
    if words:
        robot = parse_keys(words[0], words[1:], servos.KEYS).get("robot", "bench1")
        if not robot.startswith("my_"):  # a file of the reader's own
            load_robot(robot, needs_model=False)


def check_module(name: str, words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Take a command of another module: it is there, and its parser knows the arguments."""
    assert find_spec(name) is not None, name
    if not any(word.startswith("-") for word in words):
        return
    original = argparse.ArgumentParser.parse_args

    def parse(parser: argparse.ArgumentParser, *given: Any, **more: Any) -> None:
        original(parser, *given, **more)
        raise ParsedError

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse)
    monkeypatch.setattr(sys, "argv", [name, *words])
    with pytest.raises(ParsedError):
        runpy.run_module(name, run_name="__main__")


def marked(line: str, place: str) -> Any:
    """Return a command line as a parameter.

    Those of docstrings alone, of the notebook and of tables of results wait for the long suite.
    """
    late = place.endswith(".py") or place.startswith("benchmarks/")
    marks = [pytest.mark.slow] if late else []
    return pytest.param(line, id=f"{place}: {line}", marks=marks)


@pytest.mark.parametrize("line", [marked(*found) for found in commands().items()])
def test_a_command_line_is_right(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a page or a docstring tells a reader to type is accepted by its program."""
    monkeypatch.chdir(ROOT)
    words = shlex.split(line)
    named = len(words) == 2  # a verb that is mentioned, without what it needs; no RUN is here
    skipped = "check_paths_exist" if named else "check_exists"
    monkeypatch.setattr(f"sim2real.config.folders.{skipped}", lambda *_: None)
    if words[0] == "sim2real" or words[:3] == ["python", "-m", "sim2real"]:
        precheck(readable(words[1:] if words[0] == "sim2real" else words[3:]))
    elif words[0] == "make":
        assert re.search(rf"^\.PHONY:.* {words[1]}\b", Path("Makefile").read_text(), re.MULTILINE)
    elif words[0] == "pip":
        extra = words[-1].partition("[")[2].rstrip("]")
        extras = tomllib.loads(Path("pyproject.toml").read_text())["project"]
        assert words[-1] == "." or extra in extras["optional-dependencies"]
    elif words[2] == "hardware":
        check_servos(words[3:])
    elif words[2] == "pytest":
        assert all(glob.glob(word) for word in words if word.startswith("tests/"))
    else:
        check_module(words[2], words[3:], monkeypatch)


@pytest.mark.parametrize(
    "line",
    [
        "sim2real +experiment=udr algorithm.clip=0.1",
        "sim2real deploy RUN robot=quad8 stops={odd_voltage: 0.4, stray: 2.0}",
        "python -m hardware scan robot=bench2",
        "python -m benchmarks.transfer --row_ udr",
        "make everything",
    ],
)
def test_a_wrong_command_line_is_found(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The check sees a key, a robot, a flag or a target that is gone, and braces without quotes."""
    with pytest.raises((ValueError, AssertionError, SystemExit)):
        test_a_command_line_is_right(shlex.join(words_of(line)), monkeypatch)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    """Each relative link names a file of the repository, and its anchor a heading there."""
    for target, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        file = (page.parent / target) if target else page
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), f"{target}#{anchor}"


def anchors(page: Path) -> set[str]:
    """Return the anchors that the headings of a page get."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", h).strip().lower()) for h in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_of_examples_are_there(page: Path) -> None:
    """Each Python example parses, and what it imports from this project exists."""
    for source in PYTHON.findall(page.read_text(encoding="utf-8")):
        for node in ast.walk(ast.parse(source)):
            module = (node.module or "") if isinstance(node, ast.ImportFrom) else ""
            if isinstance(node, ast.ImportFrom) and module.split(".")[0] in ROOMS:
                room = importlib.import_module(module)
                assert all(hasattr(room, name.name) for name in node.names), module


CHECKED = ROOT / "tests" / "REGRESSIONS.md"
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def test_every_test_that_is_promised_is_there() -> None:
    """Each fault of `tests/REGRESSIONS.md` names a test that exists, or why it was declined."""
    text = CHECKED.read_text(encoding="utf-8")
    for file, name in TEST.findall(text):
        path = ROOT / file
        assert path.is_file() and f"def {name}(" in path.read_text(encoding="utf-8"), (file, name)
    rows = [line for line in text.splitlines() if re.match(r"\|\s*[^-|\s]", line)]
    bare = [row for row in rows if not re.search(r"::test_|the same|declined|held by", row)]
    assert bare == []


def test_no_number_of_the_round_is_left_out() -> None:
    """Forty-five inputs and twenty-five differences of the bus, in their order."""
    numbers = re.findall(r"^\| (\d+) \|", CHECKED.read_text(encoding="utf-8"), re.MULTILINE)
    assert [int(n) for n in numbers] == [*range(1, 46), *range(1, 26)]


WORDS = 450  # of the README, at most


def test_the_readme_stays_short() -> None:
    """A stranger reads it to the end, and finds how to install."""
    text = re.sub(r"<!--.*?-->", "", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(text.split()) <= WORDS
    assert "pip install" in text


def test_the_site_has_contents_and_a_search() -> None:
    """Every page is in the menu; long ones show their contents beside the text."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert "toc.follow" in text and "- search" in text
    for page in (ROOT / "docs").rglob("*.md"):
        assert str(page.relative_to(ROOT / "docs")) in text, page


SAMPLES = sorted((ROOT / "docs" / "samples").glob("*.html"))
LARGEST = 500_000  # bytes of a sample report


def test_sample_reports_are_shown() -> None:
    """The first tutorial links to each, README's picture to the first."""
    text = (ROOT / "docs" / "tutorials" / "first_diagnosis.md").read_text(encoding="utf-8")
    linked = {target for target, _ in LINK.findall(text) if target.endswith(".html")}
    assert len(SAMPLES) >= 2
    assert linked == {f"../samples/{path.name}" for path in SAMPLES}
    assert "](docs/samples/demo.html)" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", SAMPLES, ids=lambda p: p.name)
def test_a_sample_report_is_small_and_offline(path: Path) -> None:
    """It loads nothing, says which command made it, and tells nothing of the machine."""
    page = path.read_text(encoding="utf-8")
    assert len(page.encode()) < LARGEST
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=[\"']?https?:", page)
    assert "diagnose" in page
    assert not re.search(r"/(work|home|root|Users)/\w", page)
