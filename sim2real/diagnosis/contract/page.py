"""`contract.html`: the answer for a person, one file without scripts; all names are escaped."""

from pathlib import Path

from sim2real.diagnosis.contract.answer import Answer
from sim2real.runs.files import write_text
from sim2real.runs.pages import template

PAGE = Path(__file__).parent / "page" / "contract.html"


def write_page(answer: Answer, path: str | Path) -> Path:
    """Write the page of an answer."""
    return write_text(path, template(PAGE).render(answer=answer))
