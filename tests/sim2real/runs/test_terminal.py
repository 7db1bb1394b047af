"""Colours of a terminal, and pages in a browser."""

import io
import webbrowser
from pathlib import Path

import pytest

from sim2real.runs.errors import Sim2RealError
from sim2real.runs.terminal import has_colours, is_page, open_page


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        """Say that it is one."""
        return True


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, True),
        ({"NO_COLOR": "1"}, False),
        ({"NO_COLOR": ""}, True),  # no-color.org: an empty one says nothing
        ({"TERM": "dumb"}, False),
    ],
)
def test_a_terminal_has_colours_unless_it_or_its_user_has_none(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], expected: bool
) -> None:
    """NO_COLOR is respected; a file or a pipe never gets escape sequences."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert has_colours(Terminal()) == expected
    assert not has_colours(io.StringIO())


def test_a_page_is_opened_as_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The browser gets the file's address; if none starts, the person does."""
    page = tmp_path / "my report #1.html"
    page.write_text("<p>", encoding="utf-8")
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: bool(opened.append(url)) or True)
    assert open_page(page) == f"opened {page.as_uri()}"
    assert opened == [page.as_uri()] and opened[0].startswith("file:///")
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    assert open_page(page) == f"no browser could be started; open {page.as_uri()}"


def test_a_page_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    """The nearest name of its folder is offered."""
    (tmp_path / "report.html").touch()
    with pytest.raises(Sim2RealError, match=r"did you mean 'report\.html'"):
        open_page(tmp_path / "reprot.html")


def test_a_page_is_known_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An override whose value ends so is none, unless it is a file's name."""
    monkeypatch.chdir(tmp_path)
    assert is_page("out/report.html") and is_page("REPORT.HTM")
    assert not is_page("report.json") and not is_page("out=report.html")
    Path("a=1.html").touch()
    assert is_page("a=1.html")
