"""The generated pages of docs/reference: effects, configuration, settings, report.json.

    python -m benchmarks.pages          # writes them; tests/test_docs.py compares

Each page is made of the text that the program itself uses: comments of conf/, declarations of
settings, docstrings of the report's classes and of the effects.
"""

import dataclasses
import inspect
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from envs.effects import table
from sim2real.config import catalogue
from sim2real.diagnosis import schema
from sim2real.diagnosis.settings import DEFAULT
from sim2real.diagnosis.settings.base import rows, rows_of
from sim2real.identification import settings as identification
from sim2real.runs.files import write_text

REFERENCE = Path(__file__).resolve().parents[1] / "docs" / "reference"
KEY = re.compile(r"^(\w+): +(.*?) +# (.*)$")  # of conf/config.yaml: name, value, comment
GROUP = re.compile(r"^  - (\w+): (\w+) +# (.*)$", re.MULTILINE)  # name, default, comment
EXPERIMENT = "A complete run: choices of other groups, and values. Add it as `+experiment=NAME`."
JSON = (  # types of Python, and what they are in a file
    (r"Mapping\[.*\]", "table"),
    (r"tuple\[(\w+), \.\.\.\]", r"list of \1"),
    (r"\bPair\b", "[low, high]"),
    (r"\bfloat\b|\bint\b", "number"),
    (r"\bstr\b|\w*Verdict\b|\bForm\b|\bKind\b", "text"),
    (r"\bbool\b", "true or false"),
    (r" \| None", " or null"),
)
REPORT = (  # classes of report.json, outermost first
    *(schema.Report, schema.GapMetrics, schema.WholeReplay, schema.JointGap, schema.Regime),
    *(schema.Cause, schema.Equivalent, schema.Deviation, schema.Unexplained, schema.Finding),
    *(schema.ClosedLoop, schema.Distance, schema.Returns, schema.Estimate),
)


def pages() -> dict[str, str]:
    """Return the text of every generated page by its path below docs/reference."""
    return {
        **{f"effects/{name}": text for name, text in table.pages().items()},
        "configuration.md": configuration(),
        "settings.md": settings(),
        "report_json.md": report_json(),
    }


def configuration() -> str:
    """Return the page of all root keys, and of all groups with their choices."""
    text = (catalogue.CONF / "config.yaml").read_text(encoding="utf-8")
    found = [match for line in text.splitlines() if (match := KEY.match(line))]
    keys = [(f"`{m[1]}`", f"`{m[2]}`", m[3]) for m in found if m[1] != "hydra"]
    parts = [
        "# Configuration",
        "Generated from `conf/`. `sim2real +experiment=NAME --cfg job` prints all keys of a run.",
        "## Keys",
        markdown(("key", "default", "meaning"), keys),
    ]
    about = {m[1]: f"{m[3][0].upper()}{m[3][1:]}. Default: `{m[2]}`." for m in GROUP.finditer(text)}
    about[catalogue.EXPERIMENT] = EXPERIMENT
    for group in catalogue.groups():
        choices = [
            (f"`{name}`", catalogue.summary(path))
            for name, path in sorted(catalogue.files(group).items())
        ]
        parts += [f"## {group}", about[group], markdown((f"`{group}=`", "meaning"), choices)]
    return "\n\n".join(parts) + "\n"


def settings() -> str:
    """Return the page of every number that steers a diagnosis, a comparison or `identify`."""
    parts = [
        "# Settings",
        "This page is generated from the declarations of all numbers on which a diagnosis,"
        " `compare`, `contract` or `identify` depends. A unit of 1 is a fraction, a factor or"
        " a count; rad stands for m at slides. A report lists the origin of each under"
        ' "How this was made".'
        " [How to change one](../how-to/exclude_and_correct.md).",
        "**Spread** is the standard deviation of a joint's positions. A **probe** is a value of an"
        " effect that is simulated first, before anything is fitted. The **discrepancy** is the"
        " part of the error that the model cannot explain.",
    ]
    stages: dict[str, list[tuple[str, ...]]] = {}
    own = identification.DEFAULT
    for row in [*rows(DEFAULT), *rows_of("identification", own)]:
        line = (f"`{row.name}`", f"`{_rounded(row.value)}`", row.unit, row.meaning)
        stages.setdefault(row.stage, []).append(line)
    about = {f.name: getattr(DEFAULT, f.name).__doc__ for f in dataclasses.fields(DEFAULT)}
    about["identification"] = own.__doc__
    for stage, lines in stages.items():
        parts += [f"## {stage}", str(about[stage])]
        parts += [markdown(("setting", "value", "unit", "meaning"), lines)]
    return "\n\n".join(parts) + "\n"


def _rounded(value: object) -> str:
    """Return a setting's value to six digits."""
    if isinstance(value, tuple):
        return ", ".join(map(_rounded, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def report_json() -> str:
    """Return the page of the report's tables and their fields."""
    parts = [
        "# report.json",
        f"Schema {schema.SCHEMA}, generated from `sim2real/diagnosis/schema.py`. Reports of schema"
        f" {' and '.join(map(str, schema.READ[:-1]))} can be read. Numbers have six significant"
        " digits; non-finite numbers are `null`. `Report.from_json(json.load(file))`"
        " returns a report.",
    ]
    for kind in REPORT:
        lines = [(f"`{name}`", of, about) for name, of, about in _fields(kind)]
        first = (kind.__doc__ or "").split("\n\n")[0].strip()
        parts += [f"## {kind.__name__}", " ".join(first.split())]
        parts += [markdown(("key", "type", "meaning"), lines)]
    return "\n\n".join(parts) + "\n"


def _fields(kind: type) -> Iterator[tuple[str, str, str]]:
    """Yield name, type and meaning of a class's fields that stand in the file."""
    about = dict(re.findall(r"^    (\w+): .*  # (.*)$", inspect.getsource(kind), re.MULTILINE))
    about |= re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", inspect.getdoc(kind) or "", re.MULTILINE)
    for one in dataclasses.fields(kind):
        if one.name != "evidence":
            of = _kind(str(one.type))
            meaning = " ".join(about[one.name].split()).replace("None", "`null`")
            yield one.name, of, meaning.rstrip(".")


def _kind(text: str) -> str:
    """Return a field's type as JSON has it, with links to the tables of this page."""
    for python, json in JSON:
        text = re.sub(python, json, text)
    for kind in REPORT:
        text = re.sub(rf"\b{kind.__name__}\b", f"[{kind.__name__}](#{kind.__name__.lower()})", text)
    return text


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; bars within cells are escaped."""
    every = [head, ["---"] * len(head), *lines]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in every
    )


def main() -> None:
    """Write every page."""
    for name, text in pages().items():
        write_text(REFERENCE / name, text)
        print(f"docs/reference/{name}: {len(text.split())} words")


if __name__ == "__main__":
    main()
