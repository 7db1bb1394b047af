"""What a check of the policy's interface answers: `contract.json` and `contract.html`.

answer = check_contract(logs, about, actor)
answer.verdict, [(f.fault, f.where, f.fix) for f in answer.findings], answer.cannot_tell
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from sim2real.runs.files import write_text
from sim2real.runs.pages import template

SCHEMA = 1
SAME_VALUE = 0.05  # two fitted values that differ by less are reported as one
PAGE = Path(__file__).parent / "page" / "contract.html"
Verdict = Literal["holds", "broken", "cannot_tell"]
EXIT = {"holds": 0, "broken": 3, "cannot_tell": 4}


@dataclass(frozen=True)
class Fault:
    """One way in which a log differs from the description; see `Finding`."""

    fault: str
    where: str
    text: str
    fix: str
    value: float | None = None

    def same(self, other: Fault) -> bool:
        """Return whether another one is this one, with a slightly different value."""
        if self.value is None or other.value is None:
            return self == other
        alike = (self.fault, self.where) == (other.fault, other.where)
        return alike and math.isclose(self.value, other.value, rel_tol=SAME_VALUE)


@dataclass(frozen=True)
class Finding:
    """One fault of the interface."""

    stage: str  # where it is: "observation", "policy", "action", "gains" or "clock"
    fault: str  # its kind, such as "permutation"; "unexplained" where nothing known explains it
    where: str  # the term, and the elements if they are not all
    text: str  # what is wrong
    fix: str  # what to do, in one line
    before: float  # misfit of the contract as described, of the spread of what is compared
    after: float  # the misfit with this and the other faults of the same place
    sure: float | None = None  # share of resampled rows that faults explain; None: not resampled
    value: float | None = None  # what was fitted or counted, such as an age in steps
    among: tuple[Fault, ...] = ()  # other explanations that the log cannot tell from this one


@dataclass(frozen=True)
class Open:
    """What the log cannot tell."""

    where: str
    text: str


@dataclass(frozen=True)
class Answer:
    """Whether a policy saw and did what it was trained on."""

    verdict: Verdict  # "holds", "broken", or "cannot_tell" where nothing could be compared
    findings: tuple[Finding, ...]  # the faults, in the order in which data pass them
    cannot_tell: tuple[Open, ...]  # what the log does not show
    checked: dict[str, float]  # what was compared, and the misfit that is left, by place
    inputs: dict[str, Any]  # logs, policy and description

    @property
    def exit_status(self) -> int:
        """0 where the contract holds, 3 where it is broken, 4 where nothing could be compared."""
        return EXIT[self.verdict]

    def write(self, folder: Path) -> None:
        """Write `contract.json`, and `contract.html` for a person, whose names are all escaped."""
        facts = {"schema": SCHEMA, **asdict(self)}
        text = json.dumps(facts, indent=1, ensure_ascii=False) + "\n"
        write_text(folder / "contract.json", text)
        write_text(folder / "contract.html", template(PAGE).render(answer=self))


@dataclass
class Stage:
    """What one stage showed."""

    findings: list[Finding] = field(default_factory=list)
    cannot_tell: list[Open] = field(default_factory=list)
    checked: dict[str, float] = field(default_factory=dict)

    def open(self, where: str, text: str) -> None:
        """Add what the log cannot tell."""
        self.cannot_tell.append(Open(where, text))

    def add(self, other: Stage) -> None:
        """Add what another one showed."""
        self.findings += other.findings
        self.cannot_tell += other.cannot_tell
        self.checked |= other.checked
