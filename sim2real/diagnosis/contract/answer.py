"""What a check of the policy's interface answers: `contract.json`.

answer = check_contract(logs, about, actor)
answer.verdict, [(f.fault, f.where, f.fix) for f in answer.findings], answer.cannot_tell
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from sim2real.runs.files import write_text

SCHEMA = 1
Verdict = Literal["holds", "broken", "cannot_tell"]
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
