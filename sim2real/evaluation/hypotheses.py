"""Claims that an experiment registers before it runs, and whether they held.

    claim = Claim.of({"claim": "randomizing helps on the target", "is": "above",
                      "left": {"experiment": "udr", "robot": "target"},
                      "right": {"experiment": "ppo_source", "robot": "target"},
                      "probability": 0.75, "seeds": 10})
    verdict = judge(claim, study, seed=0, draws=2000)
    verdict.verdict, verdict.found          # "held", "P = 0.87 [0.71, 0.98], IQM 1103 against 871"

Both sides are one number a training run: a mean return on a robot, or a column of metrics.csv. They
are compared after the same number of steps, the largest that both have. The rules, all over
training runs:

* `above`, `below`: P(left > times x right), or <, is at least `probability`, and its 95 % interval
  is above 0.5;
* `not_above`: that interval is not above 0.5; `similar`: it contains 0.5;
* `within`: the interquartile mean of left is in `range`.

P is the share of pairs of runs, ties counted half; if both sides are of the same runs, each is
paired with itself. With fewer than `seeds` runs on a side nothing is decided.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, NamedTuple

import numpy as np

from envs.errors import did_you_mean
from sim2real.evaluation.study import Group, Run, RunsError, Study, Take
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.statistics import (
    Interval,
    bootstrap,
    iqm,
    mean,
    probability_of_improvement,
    wins,
)
from sim2real.runs.tables import format_cell

RELATIONS = ("above", "below", "not_above", "similar", "within")
TAKES = ("max", "last")
Outcome = Literal["held", "failed", "not enough seeds", "ambiguous"]


class ClaimError(Sim2RealError):
    """An `expect` block that says no claim."""


@dataclass(frozen=True)
class Operand:
    """One number for each training run.

    Raises:
        ClaimError: neither or both of robot and metric; an unknown `take`.
    """

    experiment: str  # whose runs
    # settings that they have, as {"params.width": 0.075}; empty takes all it has
    when: Mapping[str, Any] = field(default_factory=dict)
    robot: str | None = None  # their mean return on this robot; None: `take` of `metric`
    metric: str | None = None  # a column of metrics.csv
    take: Take = "last"  # of its values

    def __post_init__(self) -> None:
        if (self.robot is None) == (self.metric is None):
            raise ClaimError(f"expect: {self.experiment} needs either a robot or a metric")
        if self.take not in TAKES:
            raise ClaimError(f"expect: take={self.take!r} is not one of {', '.join(TAKES)}")

    @property
    def words(self) -> str:
        """The side in words."""
        return " ".join([self.experiment, *(f"{k}={v}" for k, v in self.when.items())])

    def values(self, study: Study, group: Group, budget: int) -> np.ndarray:
        """Return the numbers of a group's runs, (runs,)."""
        if self.metric is not None:
            return study.metric(group, self.metric, self.take, budget)
        if self.robot not in study.robots:
            raise ClaimError(
                f"expect: unknown robot {self.robot!r}; choose one of: {', '.join(study.robots)}"
            )
        return study.returns(group, self.robot, budget)


@dataclass(frozen=True)
class Claim:
    """An expectation; the module's docstring gives the rules.

    Raises:
        ClaimError: an unknown relation, or one without what it needs.
    """

    text: str  # the claim in words
    left: Operand  # what it is about
    relation: str  # "above", "below", "not_above", "similar" or "within"
    right: Operand | None  # what it is compared with; of "within" there is none
    seeds: int  # runs that each side needs
    times: float = 1.0  # factor on the right side
    probability: float = 0.5  # that "above" and "below" need
    range: tuple[float, float] | None = None  # the range of "within"

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise ClaimError(
                f"expect: is={self.relation!r}{did_you_mean(str(self.relation), RELATIONS)}; "
                f"choose one of: {', '.join(RELATIONS)}"
            )
        needs = ("range", self.range) if self.relation == "within" else ("right", self.right)
        if needs[1] is None:
            raise ClaimError(f"expect: {self.text!r} says {self.relation} and needs {needs[0]}")

    @classmethod
    def of(cls, tree: Mapping[str, Any]) -> Claim:
        """Make a claim of a mapping with the keys claim, left, is, right and so on.

        Raises:
            ClaimError: a key that is unknown or missing.
        """
        names = {"claim": "text", "is": "relation"} | {
            f.name: f.name for f in fields(cls) if f.name not in ("text", "relation")
        }
        _check_keys(tree, names, ("claim", "left", "is", "seeds"), "a claim")
        given = {names[key]: value for key, value in tree.items()}
        for side in ("left", "right"):
            if given.get(side) is not None:
                known = [f.name for f in fields(Operand)]
                _check_keys(given[side], known, ("experiment",), f"{side} of {tree['claim']!r}")
                given[side] = Operand(**given[side])
        limits = given.get("range")
        return cls(**{"right": None, **given, "range": tuple(limits) if limits else None})


class ClaimResult(NamedTuple):
    """Whether a claim held, and what was found."""

    claim: Claim
    verdict: Outcome
    found: str
    steps: float | None


def load_claims(runs: Iterable[Run]) -> list[Claim]:
    """Return the claims of all experiments, as the newest run of each registered them.

    Raises:
        ClaimError: an `expect` block that says no claim.
    """
    newest = {run.experiment: run.expect for run in runs}  # runs come oldest first
    claims = [Claim.of(tree) for name in sorted(newest) for tree in newest[name].get("claims", ())]
    return list({claim.text: claim for claim in claims}.values())


def evaluate_claim(claim: Claim, study: Study, seed: int, draws: int) -> ClaimResult:
    """Decide a claim by the runs of a study; each interval has `draws` resamples.

    Raises:
        ClaimError: a robot that the runs do not have.
    """
    sides = [side for side in (claim.left, claim.right) if side is not None]
    found = [study.find(side.experiment, side.when) for side in sides]
    for side, groups in zip(sides, found, strict=True):
        if len(groups) > 1:
            names = ", ".join(group.label for group in groups)
            return ClaimResult(claim, "ambiguous", f"{side.experiment} could be: {names}", None)
    missing = [side.words for side, groups in zip(sides, found, strict=True) if not groups]
    if missing:
        return ClaimResult(claim, "not enough seeds", f"no run of {' and '.join(missing)}", None)
    groups = [groups[0] for groups in found]
    budget = _budget(groups, claim.seeds)
    counts = [len(group.runs_at_budget(budget)) for group in groups]
    if min(counts) < max(claim.seeds, 2):
        text = f"{' and '.join(map(str, counts))} of {claim.seeds}"
        return ClaimResult(claim, "not enough seeds", text, budget)
    try:
        values = [s.values(study, group, budget) for s, group in zip(sides, groups, strict=True)]
    except RunsError as error:
        return ClaimResult(claim, "not enough seeds", str(error), budget)
    rng = np.random.default_rng(seed)
    if claim.right is None:
        return _within(claim, values[0], rng, draws, budget)
    return _compare(claim, values[0], values[1], groups[0] is groups[1], rng, draws, budget)


def _within(
    claim: Claim, x: np.ndarray, rng: np.random.Generator, draws: int, budget: int | None
) -> ClaimResult:
    assert claim.range is not None
    found = bootstrap(x[:, None], iqm, rng, draws=draws, resample="rows")
    low, high = claim.range
    held = low <= found.value <= high
    return ClaimResult(claim, "held" if held else "failed", f"IQM {format_cell(found)}", budget)


def _compare(
    claim: Claim,
    x: np.ndarray,
    y: np.ndarray,
    paired: bool,
    rng: np.random.Generator,
    draws: int,
    budget: int,
) -> ClaimResult:
    first, second = x[:, None], claim.times * y[:, None]
    if claim.relation == "below":
        first, second = second, first
    if paired:
        found = bootstrap(wins(first - second), mean, rng, draws=draws, resample="rows")
    else:
        found = probability_of_improvement(first, second, rng, draws=draws)
    factor = "" if claim.times == 1 else f"{claim.times:g} x "
    middle = [float(iqm(values[:, None])) for values in (x, y)]
    ours, theirs = map(format_cell, middle)
    text = f"P = {format_cell(found)}; IQM {ours} against {factor}{theirs}"
    return ClaimResult(claim, "held" if _holds(claim, found) else "failed", text, budget)


def _holds(claim: Claim, found: Interval) -> bool:
    if claim.relation == "similar":
        return found.low <= 0.5 <= found.high
    if claim.relation == "not_above":
        return found.low <= 0.5
    return found.value >= claim.probability and found.low > 0.5


def _budget(groups: list[Group], seeds: int) -> int:
    """Return the largest budget with enough runs in all groups, else with any, else 0."""
    shared = sorted(set.intersection(*(set(group.runs) for group in groups)))
    enough = [b for b in shared if min(len(group.runs[b]) for group in groups) >= seeds]
    return (enough or shared or [0])[-1]


def _check_keys(
    tree: Mapping[str, Any], known: Iterable[str], needed: Iterable[str], where: str
) -> None:
    known = list(known)
    for key in tree:
        if key not in known:
            raise ClaimError(
                f"expect: {where} does not accept {key!r}{did_you_mean(str(key), known)}; "
                f"it accepts: {', '.join(known)}"
            )
    missing = [key for key in needed if key not in tree]
    if missing:
        raise ClaimError(f"expect: {where} also needs {', '.join(missing)}")
