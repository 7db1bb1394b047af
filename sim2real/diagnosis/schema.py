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
Verdict = Literal["explained", "partly_explained", "fitted", "unexplained", "no_gap"]
Kind = Literal["robot", "log", "world"]
Form = Literal["holds", "contradicted"]
ClosedLoopVerdict = Literal["within_floor", "nearer", "as_far", "farther", "apart"]


@dataclass(frozen=True)
class GapMetrics:
    """Error of the simulation: root mean square over joints and held-out rows."""

    unit: str  # rad or m; "spread" of a joint's motion if the robot has both kinds of joints
    before: float  # the gap with the model as given
    after: float | None  # the gap with the causes in the model; None if there is no gap
    noise_floor: float  # the part of the gap that is sensor noise
    closed: float | None  # fraction of the closable gap that is closed; None if there is no gap
    closed_ci: Pair | None  # its 90 % interval, by a block bootstrap
    held_out: bool  # whether the segments were held out from every fit


@dataclass(frozen=True)
class WholeReplay:
    """Error of `sim2real replay` on the same logs: root mean square over all joints and rows.

    Whole episodes from their starts, nothing held out or left out; [rad], of slides [m].
    """

    before: float | None  # the error with the model as given; None if it diverges
    after: float | None  # the error with `effects.yaml`; None if it diverges or has no causes


@dataclass(frozen=True)
class Regime:
    """A kind of motion and its fraction of a joint's gap."""

    name: str  # such as `reversal` or `hold`
    share: float  # its fraction of the joint's gap


@dataclass(frozen=True)
class JointGap:
    """A joint's fraction of the gap, and its errors."""

    joint: str  # its name
    share: float  # its fraction of the gap
    before: float  # its error with the model as given [rad or m]
    after: float | None = None  # its error with the causes in the model; None if there are none
    regimes: tuple[Regime, ...] = ()  # kinds with a larger fraction of the gap than of the time


@dataclass(frozen=True)
class Equivalent:
    """An effect that the data cannot distinguish from a cause."""

    effect: str  # its standard name
    where: str | None  # its location
    inseparable: bool = False  # whether no recording can tell it from the cause or an equivalent
    kind: Kind = "robot"  # see `Cause`


@dataclass(frozen=True)
class Cause:
    """An effect that the robot has and the model lacks, or one of many fitted values.

    Args:
        effect: its standard name.
        where: joint, actuator or geom; for a body effect the joint that moves the body; None: the
            whole robot.
        side: for backlash and compliance, the side of the servo's and the log's encoder.
        value: the value in `unit`; the first of several.
        value_ci: its 90 % interval.
        unit: SI, "" for a factor.
        extra: further scalars of the effect, and the `body` that it acts on.
        confidence: probability that this effect, or an equivalent, is at this location.
        closed: fraction of the closable gap that it closes, among all causes (Shapley value).
        form: `contradicted` if it helps some held-out parts and harms others.
        equivalent: effects that the data cannot distinguish from it, at most two separable ones.
        shared: whether one value holds for all joints or actuators.
        encoder: side of the log's encoder if it differs from `side`; otherwise None.
        kind: `robot` (an effect, written to `effects.yaml`), `log` or `world`.
        seconds: when it acts in an episode; None: throughout.
        remedy: how to fix the log; None for other kinds.
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
    """The remaining gap."""

    share: float  # its fraction of the closable gap
    structure: str  # where the remaining error is largest; "none": it looks like noise


@dataclass(frozen=True)
class Finding:
    """A finding of the preflight, and its remedy."""

    check: str  # name of the check
    where: str | None  # joint, actuator or column; None: the whole log
    finding: str  # what the check found, as a sentence
    fix: str  # how to fix it


@dataclass(frozen=True)
class Estimate:
    """A number and its 90 % interval, by subsampling of episodes."""

    value: float  # the number
    ci: Pair  # its interval


@dataclass(frozen=True)
class Distance:
    """Distance between the robot's measurements in closed loop and a simulator's."""

    measure: str  # `sliced_wasserstein` (in deviations of each channel) or `mmd`
    floor: Estimate  # between two halves of the robot's own episodes
    nominal: Estimate  # between the robot and the training simulator
    corrected: Estimate | None  # from the robot to the corrected simulator; None without effects
    nearer: Estimate | None  # nominal minus corrected; None without effects


@dataclass(frozen=True)
class Returns:
    """Mean return of an episode, on the robot and in both simulators."""

    robot: Estimate  # on the robot
    nominal: Estimate  # in the training simulator
    corrected: Estimate | None  # in that simulator with the effects; None without effects


@dataclass(frozen=True)
class ClosedLoop:
    """The policy on the robot, in the simulator as given and in the corrected simulator.

    Args:
        verdict: by the first distance. `within_floor`: as close to the robot as the robot to
            itself; `nearer`, `as_far`, `farther`: the corrected simulator, compared with the one as
            given; `apart`: no effects, and beyond the floor.
    """

    policy: str  # its file
    channels: tuple[str, ...]  # columns that are compared; `gravity.<site>`: an orientation
    episodes: int  # episodes of the robot
    simulated: int  # episodes in each simulator
    verdict: ClosedLoopVerdict
    distances: tuple[Distance, ...]  # sliced Wasserstein, then maximum mean discrepancy
    returns: Returns | None = None  # None if the log lacks what the reward needs


@dataclass(frozen=True)
class Report:
    """A diagnosis's answer, schema 3.

    Args:
        verdict: `no_gap`, `explained`, `partly_explained`, `fitted` or `unexplained`.
        gap: size of the gap, before and after.
        where: joints, sorted by their fraction of the gap.
        causes: causes, sorted by the fraction that each closes.
        unexplained: the remaining gap.
        preflight: findings of the preflight.
        numerics: numerical tests of the simulator: "ok", or the result.
        next_experiment: recording that separates equivalent causes.
        failed: what could not be added after the verdict, and why.
        fitted: more than four values, which are not causes (schema 2).
        calibrated: exam that `confidence` was calibrated on; None: none.
        seconds: duration of the diagnosis.
        replay: `sim2real replay` of the same logs; None in older reports.
        closed_loop: the policy in both simulators; None if the logs name no policy.
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
        if tree.get("schema") not in READ:
            known, found = f"{', '.join(map(str, READ[:-1]))} or {SCHEMA}", tree.get("schema")
            raise Sim2RealError(f"expected a report of schema {known}, got {found!r}")
        return _read(Report, {key: value for key, value in tree.items() if key != "schema"})

    def write(self, path: str | Path) -> Path:
        """Write report.json, whole or not at all; return its path."""
        text = json.dumps(self.to_json(), indent=1, ensure_ascii=False, allow_nan=False)
        return write_text(path, text + "\n")

    def save_html(self, path: str | Path) -> Path:
        """Write the HTML page, whole or not at all; return its path."""
        return _page().write_html(path, self)

    def save_comparison(self, path: str | Path, earlier: Report) -> Path:
        """Write a page that compares this diagnosis with an earlier one; return its path."""
        module = import_module(f"{__package__}.report.comparison")
        return module.write_comparison(path, earlier, self)

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, for a notebook."""
        return _page().framed(self)


def _page() -> Any:
    """Return the module that draws pages: it stands above this one and is found when asked for."""
    return import_module(f"{__package__}.report.html")


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
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(f"{float(value):.6g}") if math.isfinite(value) else None
    return value
