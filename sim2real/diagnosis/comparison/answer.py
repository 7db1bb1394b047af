"""What a comparison answers: `compare.json`.

answer = compare(before, after, "arm.xml")
answer.verdict, [(c.effect, c.where, c.change, c.interval) for c in answer.changes]
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from sim2real.runs.files import write_text

SCHEMA = 1
Verdict = Literal["unchanged", "changed", "cannot_tell"]
EXIT = {"unchanged": 0, "changed": 3, "cannot_tell": 4}


@dataclass(frozen=True)
class Value:
    """A value that both sides have."""

    effect: str
    where: str | None
    side: str | None
    value: float
    unit: str


@dataclass(frozen=True)
class Alike:
    """Another effect whose change would look the same."""

    effect: str
    where: str | None


@dataclass(frozen=True)
class Change:
    """How much an effect changed."""

    effect: str  # its standard name
    where: str | None  # its place; None for the whole robot
    side: str | None  # of the servo's encoder, for play and springs
    change: float  # after less before, in `unit`; of a factor by what share it is larger
    interval: tuple[float, float]  # of the change; all of an answer hold together with 98 %
    unit: str  # SI; "" for a factor
    p: float  # probability of so large a change of any effect by chance
    alike: tuple[Alike, ...] = ()  # effects whose change the logs cannot tell from this one
    limit: float | None = None  # what the change may be; None where none was given
    source: str = "motion"  # "motion", or "measured" where a sensor says it
    body: str | None = None  # of a body effect, whose `where` is the joint that moves it


@dataclass(frozen=True)
class Confounder:
    """Something else that may differ between the two sides."""

    name: str  # "temperature", "supply voltage" or "mounting"
    before: float | None  # its median before, in `unit`; None where it is not known
    after: float | None  # its median after
    unit: str  # of both
    text: str  # what was made of it


@dataclass(frozen=True)
class Comparison:
    """Answer to whether a robot has changed."""

    verdict: Verdict  # "unchanged", "changed" or "cannot_tell"
    reason: str  # why, in a sentence
    changes: tuple[Change, ...]  # what changed, the clearest first
    tolerated: tuple[Change, ...]  # what changed within its limit
    watched: tuple[Change, ...]  # the change of every effect that was tested
    shared: tuple[Value, ...]  # effects that both sides have in addition to the model's
    confounders: tuple[Confounder, ...]  # other differences between the sessions
    untold: tuple[tuple[str, str], ...]  # effects that these logs cannot show, and why
    numbers: Mapping[str, Any]  # pieces, what they are of, RMS between both sides by joint
    inputs: Mapping[str, Any]  # logs, model, seed

    @property
    def exit_status(self) -> int:
        """0 where nothing changed, 3 where something did, 4 where the logs cannot tell."""
        return EXIT[self.verdict]

    def facts(self) -> dict[str, Any]:
        """Return plain data, as in the file."""
        return {"schema": SCHEMA, **asdict(self)}

    def write(self, path: str | Path) -> Path:
        """Write `compare.json`."""
        return write_text(path, json.dumps(self.facts(), indent=1, ensure_ascii=False) + "\n")


@dataclass(frozen=True)
class Fleet:
    """Several robots of one kind, each compared with all others."""

    units: Mapping[str, Comparison]  # what was found of each, by its name
    mean: tuple[Value, ...]  # effects that all have in addition to the model's

    @property
    def verdict(self) -> Verdict:
        """`changed` if a robot deviates, else `cannot_tell` if one cannot be judged."""
        said = {one.verdict for one in self.units.values()}
        return next(v for v in ("changed", "cannot_tell", "unchanged") if v in said)

    @property
    def exit_status(self) -> int:
        """As of the verdict."""
        return EXIT[self.verdict]

    def write(self, path: str | Path) -> Path:
        """Write `compare.json`."""
        facts = {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "mean": [asdict(one) for one in self.mean],
            "units": {name: one.facts() for name, one in self.units.items()},
        }
        return write_text(path, json.dumps(facts, indent=1, ensure_ascii=False) + "\n")
