"""`contract.html`: the answer for a person, one file without scripts; all names are escaped."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from sim2real.diagnosis.contract.answer import Answer
from sim2real.runs.files import write_text

FOLDER = Path(__file__).parent / "page"


def write_page(answer: Answer, path: str | Path) -> Path:
    """Write the page of an answer."""
    loader = FileSystemLoader(FOLDER)
    made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    template = made.get_template("contract.html")
    verdict = answer.verdict.replace("_", " ")
    return write_text(
        path, template.render(answer=answer, verdict=verdict, headline=_headline(answer))
    )


def _headline(answer: Answer) -> str:
    count = len(answer.findings)
    if answer.verdict == "broken":
        noun = "fault" if count == 1 else "faults"
        return f"Broken: {count} {noun} between the policy and the robot."
    if answer.verdict == "holds":
        return "Holds: the policy saw and did what it was trained on, as far as the log shows."
    return "Cannot tell: the log holds nothing that could be compared."
