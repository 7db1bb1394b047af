"""Figures of README and docs: each is an entry of claims.yaml, and stands in the table it names."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from scipy.stats import binomtest

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
CLAIMS: dict[str, dict[str, Any]] = yaml.safe_load((RESULTS / "claims.yaml").read_text("utf-8"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
MARK = re.compile(r"(.{0,40}?)<!-- claim: (\w+) -->")
COUNT = re.compile(r"(\d+) of (?:these )?(\d+)")
KEYS = ["question", "figure", "interval", "method", "n", "command", "revision", "file", "text"]


def printed() -> list[tuple[str, str, str]]:
    """Return page, claim and the text in front of each mark."""
    return [
        (str(page.relative_to(ROOT)), name, before)
        for page in PAGES
        for before, name in MARK.findall(page.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize(("page", "name", "before"), printed())
def test_a_page_prints_the_claim_s_figure(page: str, name: str, before: str) -> None:
    """The text in front of a mark ends in the figure of the entry, digit by digit."""
    assert name in CLAIMS, page
    figure = CLAIMS[name]["figure"]
    assert re.search(rf"(^|[^\d.,]){re.escape(figure)}$", before), (page, figure, before)


@pytest.mark.parametrize("name", CLAIMS)
def test_a_claim_is_whole_and_stands_in_its_table(name: str) -> None:
    """Every key is there, a page prints the figure, and the table that it names holds the text."""
    claim = CLAIMS[name]
    assert list(claim) == [*KEYS, "limit"]
    assert name in {used for _, used, _ in printed()}
    table = (RESULTS / claim["file"]).read_text(encoding="utf-8").replace("\xa0", " ")
    assert claim["text"] in table


@pytest.mark.parametrize(
    "name", [n for n, c in CLAIMS.items() if c["method"] in ("wilson", "exact")]
)
def test_an_interval_of_a_count_is_computed(name: str) -> None:
    """Wilson's or the exact binomial interval of k of n, at two digits."""
    claim = CLAIMS[name]
    match = COUNT.fullmatch(claim["figure"])
    assert match is not None
    found = binomtest(int(match[1]), int(match[2])).proportion_ci(0.95, method=claim["method"])
    assert [round(found.low, 2), round(found.high, 2)] == claim["interval"]


def test_the_evidence_tables_hold_no_other_figures() -> None:
    """Each row of README's and the evidence page's table: marked figures, their intervals."""
    for page, head in (
        ("README.md", "| question |"),
        ("docs/explanation/evidence.md", "| question |"),
    ):
        lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
        start = next(i for i, line in enumerate(lines) if line.startswith(head))
        body = [line for line in lines[start + 2 :]]
        rows = body[: next((i for i, line in enumerate(body) if not line.startswith("|")), None)]
        assert len(rows) >= 5
        for row in rows:
            marks = MARK.findall(row)
            assert marks, row
            for _, name in marks:
                low, high = CLAIMS[name]["interval"]
                assert f"<!-- claim: {name} --> [{100 * low:.0f}, {100 * high:.0f}] %" in row
