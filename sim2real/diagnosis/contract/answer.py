"""What a check of the policy's interface answers: `contract.json`.

answer = check_contract(logs, about, actor)
answer.verdict, [(f.fault, f.where, f.fix) for f in answer.findings], answer.cannot_tell
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from sim2real.diagnosis.contract.decode import Decoded
from sim2real.diagnosis.contract.ways import Change
from sim2real.diagnosis.settings import Contract
from sim2real.runs.files import write_text

SCHEMA = 1
Verdict = Literal["holds", "broken", "cannot_tell"]
SAME_VALUE = 0.05  # two fitted values that differ by less are reported as one
EXIT = {"holds": 0, "broken": 3, "cannot_tell": 4}


@dataclass(frozen=True)
class Rival:
    """Another explanation that the log cannot tell from the named one."""

    fault: str
    where: str
    text: str


@dataclass(frozen=True)
class Finding:
    """One fault of the interface.

    Attributes:
        stage: where it is: "observation", "policy", "action", "gains" or "clock".
        fault: its kind, such as "permutation"; "unexplained" where nothing known explains it.
        where: the term, and the elements if they are not all.
        text: what is wrong.
        fix: what to do, in one line.
        before: misfit of the contract as described, of the spread of what is compared.
        after: the misfit with this and the other faults of the same place.
        sure: share of resampled rows in which the faults explain enough; None where not resampled.
        value: what was fitted or counted, such as an age in steps.
        among: other explanations that the log cannot tell from this one.
    """

    stage: str
    fault: str
    where: str
    text: str
    fix: str
    before: float
    after: float
    sure: float | None = None
    value: float | None = None
    among: tuple[Rival, ...] = ()


@dataclass(frozen=True)
class Open:
    """What the log cannot tell."""

    where: str
    text: str


@dataclass(frozen=True)
class Answer:
    """Whether a policy saw and did what it was trained on.

    Attributes:
        verdict: "holds", "broken", or "cannot_tell" where nothing could be compared.
        findings: the faults, in the order in which data pass them.
        cannot_tell: what the log does not show.
        checked: what was compared, and the misfit that is left, by place.
        inputs: logs, policy and description.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    cannot_tell: tuple[Open, ...]
    checked: dict[str, float]
    inputs: dict[str, Any]

    @property
    def exit_status(self) -> int:
        """0 where the contract holds, 3 where it is broken, 4 where nothing could be compared."""
        return EXIT[self.verdict]

    def write(self, path: str | Path) -> Path:
        """Write `contract.json`."""
        facts = {"schema": SCHEMA, **asdict(self)}
        return write_text(path, json.dumps(facts, indent=1, ensure_ascii=False) + "\n")


def answer_of(
    findings: Sequence[Finding],
    cannot_tell: Sequence[Open],
    checked: dict[str, float],
    inputs: dict[str, Any],
) -> Answer:
    """Put an answer together."""
    verdict: Verdict = "broken" if findings else "holds" if checked else "cannot_tell"
    unique = tuple(dict.fromkeys(cannot_tell))
    return Answer(verdict, tuple(findings), unique, checked, inputs)


def findings_of(
    stage: str, name: str, found: Decoded, elements: Sequence[str], limits: Contract
) -> list[Finding]:
    """Return the findings of one decoded place.

    Args:
        stage: as of `Finding`.
        name: of the term.
        found: what was decoded.
        elements: all of its elements.
        limits: when an unexplained misfit is worth a finding.
    """
    made = []
    for change in found.changes:
        rivals = _rivals(change, found, name, elements, limits.set_max)
        where = _where(name, change, elements)
        size = found.before, found.after, found.sure
        made.append(
            Finding(
                stage, change.fault, where, change.text, change.fix, *size, change.value, rivals
            )
        )
    if found.left > limits.unexplained:
        text = (
            f"{name} differs from what the description makes of the log by {found.left:.0%} of its "
            "spread, and no fault that is looked for explains it"
        )
        fix = "compare the code that fills it with the training's, or correct the description"
        made.append(Finding(stage, "unexplained", name, text, fix, found.before, found.left))
    return made


def open_of(name: str, found: Decoded) -> list[Open]:
    """Return what the log cannot tell of one place."""
    made = []
    if found.static:
        text = "did not move: order, sign, scale and age are unknown"
        made.append(Open(f"{name}: {', '.join(found.static)}", text))
    if found.unseen:
        made.append(Open(f"{name}: {', '.join(found.unseen)}", "too few rows to compare"))
    for group in found.exchangeable:
        text = "moved alike: their order is unknown"
        made.append(Open(f"{name}: {', '.join(group)}", text))
    if found.age_open:
        made.append(Open(name, "changes too slowly for its age to be known to a step"))
    return made


def _where(name: str, change: Change, elements: Sequence[str]) -> str:
    every = tuple(change.elements) == tuple(elements)
    return name if every else f"{name}: {', '.join(change.elements)}"


def _rivals(
    change: Change, found: Decoded, name: str, elements: Sequence[str], most: int
) -> tuple[Rival, ...]:
    """Return what stands in other ways in the place of a change, up to `most` with it."""
    rivals = []
    for other in found.others:
        if any(_same(change, o) for o in other):
            continue
        rivals += [
            Rival(o.fault, _where(name, o, elements), o.text)
            for o in other
            if not any(_same(o, own) for own in found.changes)
        ]
    return tuple(dict.fromkeys(rivals))[: most - 1]


def _same(one: Change, other: Change) -> bool:
    """Return whether two changes are the same, with slightly different values."""
    if one == other or one.value is None or other.value is None:
        return one == other
    alike = one.fault == other.fault and one.elements == other.elements
    return alike and math.isclose(one.value, other.value, rel_tol=SAME_VALUE)
