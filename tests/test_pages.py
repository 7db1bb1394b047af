"""The pages for users: generated ones are up to date, old addresses lead on, words and messages."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from benchmarks.pages import REFERENCE, pages

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("name", pages())
def test_a_generated_page_is_up_to_date(name: str) -> None:
    """It is what its classes and files say: `python -m benchmarks.pages` writes it."""
    assert (REFERENCE / name).read_text(encoding="utf-8") == pages()[name]


def test_addresses_of_moved_pages_lead_to_new_ones() -> None:
    """Each page of 0.1 is redirected to a page that is there."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    moved = dict(re.findall(r"^ {8}(\w+)\.md: (\S+\.md)$", text, re.MULTILINE))
    assert len(moved) == 24
    assert not any((ROOT / "docs" / f"{page}.md").exists() for page in moved)
    assert all((ROOT / "docs" / page).is_file() for page in moved.values())


LABELS = re.compile(  # what belongs into benchmarks/notebook: a commit, a seed, a case
    r"\b(?=[0-9a-f]*[a-f])(?=[0-9a-f]*\d)[0-9a-f]{7,40}\b|\bseeds? \d+|\bcase[ _]?\d{2,}",
    re.IGNORECASE,
)
LAB = {"docs/seeds.md", "docs/explanation/evidence.md"}  # a generated table; sources of public logs
USER_PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", USER_PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_page_for_users_names_no_commit_seed_or_case(page: Path) -> None:
    """They stand in the notebook and in claims.yaml; `seed=0` of a command is another thing."""
    if str(page.relative_to(ROOT)) not in LAB:
        assert LABELS.findall(page.read_text(encoding="utf-8")) == []


def test_a_label_is_found() -> None:
    """The pattern sees each kind, and neither a number nor a word."""
    for label in ("at 4b30d72", "of seed 41", "case_153", "Case 12"):
        assert LABELS.search(label), label
    for other in ("seed=0", "1081000 steps", "in this case 3 of 4", "defaced"):
        assert not LABELS.search(other), other


EVERYDAY = re.compile(r"\b(told|beside|hears|tells? apart)\b", re.IGNORECASE)
QUOTED = {
    "docs/seeds.md",
    *(f"docs/reference/{name}" for name in pages()),  # the program's own words
}
WRITTEN = [page for page in USER_PAGES if str(page.relative_to(ROOT)) not in QUOTED]


@pytest.mark.parametrize("page", WRITTEN, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_page_for_users_uses_the_field_s_words(page: Path) -> None:
    """None of the everyday words that stand for a term: receives, next to, distinguishes."""
    assert EVERYDAY.findall(page.read_text(encoding="utf-8")) == []


WORDS = 24_000  # of README and all pages that are not generated, as `wc -w` counts


def test_the_pages_for_users_stay_short() -> None:
    """What is added has to replace something."""
    generated = {"docs/seeds.md", *(f"docs/reference/{name}" for name in pages())}
    written = [page for page in USER_PAGES if str(page.relative_to(ROOT)) not in generated]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in written) <= WORDS


STOOD_FOR = re.compile(  # what a message of the page fills in
    r"\.\.\.|;|'[^']*'|\d+(?:\.\d+)?|\[[^]]*\]|%|\bN\b|\bn\b|quad8|Quad8|Hopper|bench1|knee|lost$|position,?"
)
MESSAGE = re.compile(r"^\| `([^`]+)`", re.MULTILINE)


@cache
def sources() -> str:
    """Return the text of hardware/ and sim2real/, strings that go on in the next line joined."""
    folders = [ROOT / "hardware", ROOT / "sim2real"]
    text = "".join(p.read_text("utf-8") for folder in folders for p in folder.rglob("*.py"))
    return re.sub(r"[\"']\s*\n\s*f?[\"']", "", text)


@pytest.mark.parametrize("message", MESSAGE.findall((REFERENCE / "messages.md").read_text("utf-8")))
def test_a_message_of_the_page_is_one_of_the_program(message: str) -> None:
    """Between what is filled in, one of its longest pieces stands in the sources."""
    pieces = [piece.strip(" '\":,.") for piece in STOOD_FOR.split(message)]
    assert any(piece in sources() for piece in pieces if len(piece) >= 6), pieces
