"""What a diagnosis answers: `report.json`.

    report = diagnose("logs/", "arm.xml")
    report.verdict, report.causes[0].effect, report.gap.closed
    report.write("report.json")
    Report.from_json(json.loads(Path("report.json").read_text()))

A report is plain numbers and words. `closed` is (before - after) / (before - noise floor) on
segments that no parameter was fitted to. `evidence` stays in memory: a read report has none.

More than four effects are a fit and no explanation: the verdict is then `fitted`, `causes` is empty
and the values stand under `fitted`. `report.values` are all whose values were found;
`report.effects` those that every verb knows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from envs.effects import EFFECTS
from sim2real.diagnosis.evidence import Evidence, Pair
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

SCHEMA = 3  # written; 1 knows neither `fitted` nor `shared`, 2 no `kind` of a cause: both are read
READ = (1, 2, SCHEMA)
LOG_UNITS = "log units"  # of errors, where the unit of the log's positions is itself a mistake
Verdict = Literal["explained", "partly_explained", "fitted", "unexplained", "no_gap"]
Kind = Literal["robot", "log", "world"]
Form = Literal["holds", "contradicted"]
ClosedLoopVerdict = Literal["within_floor", "nearer", "as_far", "farther", "apart"]


@dataclass(frozen=True)
class GapMetrics:
    """Error of the simulation: root mean square over joints and held-out rows.

    Args:
        unit: rad or m; "spread" if the robot has both kinds of joints: errors are then relative to
            the standard deviation of a joint's positions; "log units" if the unit of the log's
            positions is itself a mistake.
        closed: fraction of the closable gap, `before` minus `noise_floor`, that is closed; None if
            there is no gap.
    """

    unit: str
    before: float  # the error with the model as given, which is the gap
    after: float | None  # the error with the causes in the model; None if there is no gap
    noise_floor: float  # the part of the error that is sensor noise
    closed: float | None
    closed_ci: Pair | None  # 90 % interval of `closed`, by a block bootstrap
    held_out: bool  # whether the rows were held out from every fit


@dataclass(frozen=True)
class WholeReplay:
    """Error of `sim2real replay` on the same logs: root mean square over all joints and rows.

    Whole episodes from their starts, nothing held out or left out; [rad], of slides [m].
    """

    before: float | None  # the error with the model as given; None if it diverges
    after: float | None  # the error with `effects.yaml`; None if it diverges or there are no causes


@dataclass(frozen=True)
class Regime:
    """A regime of motion, and its fraction of a joint's gap."""

    name: str  # name of the regime, such as `reversal` or `hold`
    share: float  # fraction of the joint's gap in this regime


@dataclass(frozen=True)
class JointGap:
    """A joint's fraction of the gap, and its errors."""

    joint: str  # name of the joint
    share: float  # fraction of the gap at this joint
    before: float  # RMS error with the model as given [rad or m]
    after: float | None = None  # RMS error with the causes in the model; None if there are none
    regimes: tuple[Regime, ...] = ()  # regimes with more of the gap than of the time


@dataclass(frozen=True)
class Equivalent:
    """An effect that the data cannot distinguish from a cause.

    Args:
        inseparable: whether the predictions of both agree within 1 % on these recordings.
    """

    effect: str  # name of the effect
    where: str | None  # its location, as in `Cause`
    inseparable: bool = False
    kind: Kind = "robot"  # as in `Cause`


@dataclass(frozen=True)
class Cause:
    """A cause of the gap: an effect, a mistake in the log, or an external influence.

    Args:
        effect: name of the effect.
        where: joint, actuator or geom; for an effect on a body, the joint that moves it; None: the
            whole robot.
        side: for backlash and compliance, the side (motor or link) of the servo's encoder.
        value: fitted value in `unit`; the largest, if there are several, as for a tilt.
        value_ci: 90 % interval of `value`.
        unit: SI unit; "" for a factor.
        extra: further parameters and options of the effect, and the `body` on which it acts.
        confidence: probability that this effect, or an equivalent, exists at this location.
        closed: fraction of the closable gap that it closes (causes share it in
            proportion to the score that is lost without each).
        form: `holds`; in older reports also `contradicted`: it improves only some held-out rows.
        equivalent: effects that the data cannot distinguish from it, at most two.
        shared: whether one value holds for all joints or actuators.
        encoder: side of the log's encoder, if it differs from `side`; otherwise None.
        kind: `robot` (an effect, written to `effects.yaml`), `log` (a mistake in the log) or
            `world` (an external influence, such as a push).
        seconds: start and end of its action in an episode [s]; None: throughout.
        remedy: how to correct the log, if `kind` is `log`; otherwise None.
    """

    effect: str
    where: str | None
    side: str | None
    value: float
    value_ci: Pair
    unit: str
    extra: Mapping[str, Any]
    confidence: float
    closed: float
    form: Form = "holds"
    equivalent: tuple[Equivalent, ...] = ()
    shared: bool = False
    encoder: str | None = None
    kind: Kind = "robot"
    seconds: Pair | None = None
    remedy: str | None = None


@dataclass(frozen=True)
class Unexplained:
    """The part of the gap that the causes do not close."""

    share: float  # remaining fraction of the closable gap
    structure: str  # where the remaining error is largest; "none" if it looks like noise


@dataclass(frozen=True)
class Finding:
    """A finding of the preflight checks, and its remedy."""

    check: str  # name of the check
    where: str | None  # joint, actuator or column; None: the whole log
    finding: str  # what the check found, as a sentence
    fix: str  # the remedy, as a sentence


@dataclass(frozen=True)
class Estimate:
    """An estimate and its 90 % interval, from resampled episodes."""

    value: float  # the estimate
    ci: Pair  # its 90 % interval


@dataclass(frozen=True)
class Distance:
    """Distances between the robot's measurements and those of a simulator, in closed loop.

    Args:
        measure: `sliced_wasserstein` (in standard deviations of the channels), or `mmd` (maximum
            mean discrepancy).
        corrected: distance between the robot and the corrected simulator; None without effects.
    """

    measure: str
    floor: Estimate  # distance between two halves of the robot's own episodes
    nominal: Estimate  # distance between the robot and the simulator as given
    corrected: Estimate | None
    nearer: Estimate | None  # `nominal` minus `corrected`; None without effects


@dataclass(frozen=True)
class Returns:
    """Mean returns of the policy, on the robot and in both simulators."""

    robot: Estimate  # mean return on the robot
    nominal: Estimate  # mean return in the simulator as given
    corrected: Estimate | None  # mean return in the corrected simulator; None without effects


@dataclass(frozen=True)
class ClosedLoop:
    """Comparison of the robot with both simulators while the policy controls them.

    Args:
        verdict: result for the first distance. `within_floor`: the distance to the corrected
            simulator is within the floor. `nearer`, `as_far`, `farther`: the corrected simulator,
            compared with the simulator as given. `apart`: without effects, a distance above the
            floor.
    """

    policy: str  # file or run folder of the policy
    channels: tuple[str, ...]  # compared columns; `gravity.<site>` represents an orientation
    episodes: int  # number of episodes on the robot
    simulated: int  # number of episodes in each simulator
    verdict: ClosedLoopVerdict
    distances: tuple[Distance, ...]  # sliced Wasserstein distance, then maximum mean discrepancy
    returns: Returns | None = None  # mean returns; None if the log lacks an input of the reward


@dataclass(frozen=True)
class Deviation:
    """A parameter of the model whose error, too small for a cause, would account for what is left.

    Args:
        effect: name of the effect that scales the parameter.
        where: joint, actuator or body; None: the whole robot.
        change: relative difference between the robot's value and the model's.
        change_ci: 90 % interval of `change`, provided that nothing else is missing in the model.
        variant: option of the effect, such as `braking kept`; "" if it has none.
    """

    effect: str
    where: str | None
    change: float
    change_ci: Pair
    variant: str = ""


@dataclass(frozen=True)
class Report:
    """The result of a diagnosis, schema 3.

    Args:
        verdict: `no_gap`, `explained`, `partly_explained` or `unexplained`; in older reports also
            `fitted`.
        gap: size of the gap, before and after the causes are added to the model.
        where: joints, sorted by their fraction of the gap.
        causes: causes, sorted by the fraction of the gap that each closes.
        unexplained: the remaining gap.
        preflight: findings of the preflight checks.
        numerics: tests of the simulator's numerics by name: "ok", or the result as a sentence.
        next_experiment: recommended recording that would distinguish equivalent causes; None if
            there are none.
        failed: results that could not be computed after the verdict, and why.
        fitted: fitted values if there are more than four, too many to be causes (schema 2).
        deviations: small errors of the model's parameters, no causes, that would account for the
            remaining gap if nothing else is missing; the largest first.
        calibrated: exam with which `confidence` was calibrated; None: not calibrated.
        seconds: computing time of the diagnosis [s].
        replay: error of `sim2real replay` on the same logs; None in older reports.
        closed_loop: comparison of the policy's closed loops; None if the logs name no policy.
        evidence: data of the plots; not in `report.json`.
    """

    verdict: Verdict
    gap: GapMetrics
    where: tuple[JointGap, ...]
    causes: tuple[Cause, ...]
    unexplained: Unexplained
    preflight: tuple[Finding, ...] = ()
    numerics: Mapping[str, str] = field(default_factory=lambda: {"timestep": "ok"})
    next_experiment: str | None = None
    seconds: float = 0.0
    replay: WholeReplay | None = None
    closed_loop: ClosedLoop | None = None
    failed: tuple[str, ...] = ()
    fitted: tuple[Cause, ...] = ()
    deviations: tuple[Deviation, ...] = ()
    calibrated: str | None = None
    evidence: Evidence = field(default_factory=Evidence, compare=False, repr=False)

    @property
    def values(self) -> tuple[Cause, ...]:
        """All causes and fitted values."""
        return self.causes or self.fitted

    @property
    def effects(self) -> tuple[Cause, ...]:
        """Causes and values that are effects: the content of `effects.yaml`."""
        return tuple(c for c in self.values if c.kind != "log" and c.effect in EFFECTS)

    def to_json(self) -> dict[str, Any]:
        """Return the content of report.json as plain dicts, lists, numbers and strings."""
        tree = {name: value for name, value in asdict(self).items() if name != "evidence"}
        return {"schema": SCHEMA, **_plain(tree)}

    @staticmethod
    def from_json(tree: Mapping[str, Any]) -> Report:
        """Return the report from the result of `to_json`.

        Raises:
            Sim2RealError: the schema is not supported, or a key is missing or unknown.
        """
        if (found := tree.get("schema")) not in READ:
            raise Sim2RealError(f"expected a report of schema 1, 2 or 3, got {found!r}")
        return _read(Report, {key: value for key, value in tree.items() if key != "schema"})

    def write(self, path: str | Path) -> Path:
        """Write report.json atomically; return its path."""
        text = json.dumps(self.to_json(), indent=1, ensure_ascii=False, allow_nan=False)
        return write_text(path, text + "\n")

    def save_html(self, path: str | Path) -> Path:
        """Write the HTML page atomically; return its path."""
        return _pages("html").write_html(path, self)

    def save_comparison(self, path: str | Path, earlier: Report) -> Path:
        """Write a page that compares this diagnosis with an earlier one; return its path."""
        return write_text(path, _pages("comparison").render(earlier, self))

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, for a notebook."""
        return _pages("html").framed(self)


def _pages(name: str) -> Any:
    """Return a module that draws pages: it stands above this one and is found when asked for."""
    return import_module(f"{__package__}.report.{name}")


def _read(kind: Any, value: Any) -> Any:
    """Return a value of a type from what JSON holds of it: records, tuples of them, pairs."""
    of = next((part for part in get_args(kind) if is_dataclass(part)), kind)
    if not is_dataclass(of) or value is None:
        return tuple(value) if isinstance(value, list) else value
    if get_origin(kind) is tuple:
        return tuple(_read(of, one) for one in value)
    kinds, name = get_type_hints(of), getattr(of, "__name__", "")
    for key in value:
        if key not in kinds:
            raise Sim2RealError(f"a report's {name} has no key {key!r}")
    parts = {key: _read(kinds[key], one) for key, one in value.items()}
    try:
        return of(**parts)  # type: ignore[operator]
    except TypeError as error:
        raise Sim2RealError(f"a report's {name} is incomplete: {error}") from None


def _plain(value: Any) -> Any:
    """Return the value as JSON can hold it; numbers to six digits, none that is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
