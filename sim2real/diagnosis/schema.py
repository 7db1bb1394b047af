"""What a diagnosis answers: `report.json`, and the evidence that pictures need besides.

    report = diagnose("logs/", "arm.xml")
    report.verdict, report.causes[0].effect, report.gap.closed
    report.write("report.json")
    Report.from_json(json.loads(Path("report.json").read_text()))

A report is plain numbers and words. `closed` is (before - after) / (before - noise floor) on
segments that no parameter was fitted to. `evidence` stays in memory: `report.json` does not hold
it, and a report that was read has none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sim2real.diagnosis.settings import Row
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

SCHEMA = 1
Verdict = Literal["explained", "partly_explained", "unexplained", "no_gap"]
Form = Literal["holds", "contradicted"]
Kind = Literal["command", "current", "voltage"]
Pair = tuple[float, float]


@dataclass(frozen=True)
class GapNumbers:
    """How far simulation and robot are apart, root mean square over joints and held-out rows.

    Args:
        unit: of before, after and noise_floor: rad or m; "spread" where a robot has both kinds of
            joints (1 is the spread of a joint's own motion).
        before: with the model as given.
        after: with the causes put into it; None where there is no gap.
        noise_floor: what nothing can close.
        closed: share of the closable gap that is closed; None where there is no gap.
        closed_ci: its 90 % interval, by a block bootstrap.
        held_out: whether all of this was measured on segments that no parameter was fitted to.
    """

    unit: str
    before: float
    after: float | None
    noise_floor: float
    closed: float | None
    closed_ci: Pair | None
    held_out: bool


@dataclass(frozen=True)
class WholeReplay:
    """What `run=replay` says of the same logs: root mean square over all joints and rows.

    Whole episodes from their starts, nothing held out or left out; [rad], of slides [m].

    Args:
        before: with the model as given; None where it diverges in a whole episode.
        after: with `effects.yaml`; None where it diverges, or where there are no causes.
    """

    before: float | None
    after: float | None


@dataclass(frozen=True)
class Regime:
    """A kind of moment, such as `reversal` or `hold`, and its share of a joint's gap."""

    name: str
    share: float


@dataclass(frozen=True)
class Where:
    """A joint's share of the gap, its error [rad or m] before and after, and where it lies."""

    joint: str
    share: float
    before: float
    after: float | None = None
    regimes: tuple[Regime, ...] = ()


@dataclass(frozen=True)
class Equivalent:
    """An effect that the data cannot tell from a cause."""

    effect: str
    where: str | None


@dataclass(frozen=True)
class Cause:
    """An effect that the robot has and the model lacks.

    Args:
        effect: its standard name.
        where: joint, actuator or geom; for a body effect the joint that moves the body; None for
            the whole robot.
        side: for backlash and compliance, where the encoder sits.
        value: in `unit`; the first one of an effect with several.
        value_ci: its 90 % interval.
        unit: SI, "" for a factor.
        extra: the effect's further scalars, and `body` where the effect acts on one.
        confidence: probability that this effect, or an equivalent of it, is at this place.
        closed: share of the closable gap that it closes, among all causes (their Shapley value).
        form: `contradicted` where it helps some held-out parts and harms others.
        equivalent: effects that the data cannot tell from it, at most two.
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


@dataclass(frozen=True)
class Unexplained:
    """The share of the closable gap that stays, and what it looks like ("none": like noise)."""

    share: float
    structure: str


@dataclass(frozen=True)
class Finding:
    """A mistake found before any physics was blamed, and its remedy."""

    check: str
    where: str | None
    finding: str
    fix: str


@dataclass(frozen=True)
class Trace:
    """One joint in one episode, as measured and as simulated: what the gap's numbers are made of.

    Args:
        log: name of the log's file.
        episode: its number in the log.
        joint: the joint.
        unit: rad or m.
        time: s, (T,).
        measured: (T,).
        nominal: replayed in the model as given, (T,); NaN where nothing is compared.
        corrected: replayed with the causes, (T,); no value was fitted to the rows it is shown in.
        floor: noise floor of this joint.
        starts: rows at which the replay starts again from the measured state, (n,).
        subsets: replayed with only these causes (their places in `Report.causes`), fitted anew,
            (T,) each; {} where not all subsets were tried.
    """

    log: str
    episode: int
    joint: str
    unit: str
    time: np.ndarray
    measured: np.ndarray
    nominal: np.ndarray
    corrected: np.ndarray
    floor: float
    starts: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    subsets: Mapping[frozenset[int], np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Signal:
    """What else was logged in one episode of an actuator.

    Args:
        log: name of the log's file.
        episode: its number in the log.
        kind: command, current or voltage.
        actuator: its name.
        unit: rad, m, A or V; "" for a command that is no position.
        joint: whose position a command is; None for none.
        time: s, (T,).
        values: (T,).
    """

    log: str
    episode: int
    kind: Kind
    actuator: str
    unit: str
    joint: str | None
    time: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Rung:
    """A held-out gap on the way from the model as given to the corrected one, and its interval."""

    label: str
    gap: float
    ci: Pair


@dataclass(frozen=True)
class SingleFit:
    """One effect alone: its value and the share of the closable gap that it closes.

    `ci` is that share's 90 % interval; None where the effect was not fitted but only screened: then
    value and share are estimates.
    """

    effect: str
    where: str | None
    side: str | None
    value: float
    unit: str
    closed: float
    ci: Pair | None


@dataclass(frozen=True)
class Band:
    """The held-out gap of a joint in a band of frequencies `low` to `high` [Hz]."""

    joint: str
    low: float
    high: float
    before: float
    after: float
    floor: float


@dataclass(frozen=True)
class Evidence:
    """What the pictures show and `report.json` does not hold.

    Args:
        traces: every joint of every episode.
        ladder: before, after each effect that was added, all together; the last one is the floor.
        singles: every effect alone: the causes in their order, then those that were fitted, then
            those that were screened, best first.
        bands: joint by joint, low frequencies first.
        inputs: names of logs and models, seed, versions, how the data was divided.
        settings: every number that steered the answer.
        signals: commands, currents and voltages of every episode.
        correlations: of the causes' first values, over blocks that are drawn again, (n, n).
    """

    traces: tuple[Trace, ...] = ()
    ladder: tuple[Rung, ...] = ()
    singles: tuple[SingleFit, ...] = ()
    bands: tuple[Band, ...] = ()
    inputs: Mapping[str, Any] = field(default_factory=dict)
    settings: tuple[Row, ...] = ()
    signals: tuple[Signal, ...] = ()
    correlations: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True)
class Report:
    """A diagnosis's answer, schema 1.

    Args:
        verdict: `no_gap`, `explained`, `partly_explained` or `unexplained`.
        gap: its size before and after.
        where: joints, the largest share first.
        causes: the effects found, the one that closes most first.
        unexplained: what stays.
        preflight: mistakes found before.
        numerics: what the simulator itself was tested for, and "ok" or what was found.
        next_experiment: what to record to tell equivalent causes apart.
        failed: what could not be added after the verdict, and why.
        seconds: that it took.
        replay: what `run=replay` says of the same logs; None in reports of older versions.
        evidence: what the pictures need; not in `report.json`.
    """

    verdict: Verdict
    gap: GapNumbers
    where: tuple[Where, ...]
    causes: tuple[Cause, ...]
    unexplained: Unexplained
    preflight: tuple[Finding, ...] = ()
    numerics: Mapping[str, str] = field(default_factory=lambda: {"timestep": "ok"})
    next_experiment: str | None = None
    seconds: float = 0.0
    replay: WholeReplay | None = None
    failed: tuple[str, ...] = ()
    evidence: Evidence = field(default_factory=Evidence, compare=False, repr=False)

    def to_json(self) -> dict[str, Any]:
        """Return the content of report.json: plain tables, lists, numbers, words."""
        tree = {name: value for name, value in asdict(self).items() if name != "evidence"}
        return {"schema": SCHEMA, **_plain(tree)}

    @staticmethod
    def from_json(tree: Mapping[str, Any]) -> Report:
        """Return the report that `to_json` turned into this table.

        Raises:
            Sim2RealError: another schema, or a key that is missing or unknown.
        """
        if tree.get("schema") != SCHEMA:
            found = tree.get("schema")
            raise Sim2RealError(f"a report has schema {SCHEMA}, this one has {found!r}")
        given = {key: value for key, value in tree.items() if key != "schema"}
        causes = tuple(
            _make(Cause, {**one, "equivalent": _each(Equivalent, one["equivalent"])})
            for one in given["causes"]
        )
        where = tuple(
            _make(Where, {**one, "regimes": _each(Regime, one["regimes"])})
            for one in given["where"]
        )
        parts: dict[str, Any] = {
            "gap": _make(GapNumbers, given["gap"]),
            "where": where,
            "causes": causes,
            "unexplained": _make(Unexplained, given["unexplained"]),
            "preflight": _each(Finding, given["preflight"]),
        }
        if given.get("replay") is not None:
            parts["replay"] = _make(WholeReplay, given["replay"])
        return _make(Report, {**given, **parts})

    def write(self, path: str | Path) -> Path:
        """Write report.json, whole or not at all; return its path."""
        text = json.dumps(self.to_json(), indent=1, ensure_ascii=False, allow_nan=False)
        return write_text(path, text + "\n")

    def save_html(self, path: str | Path) -> Path:
        """Write the page for a person, whole or not at all; return its path."""
        return _page().write_html(path, self)

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, for a notebook."""
        return _page().framed(self)


def _page() -> Any:
    """Return the module that draws pages: it stands above this one and is found when asked for."""
    return import_module(f"{__package__}.report.html")


def _make(kind: type, values: Mapping[str, Any]) -> Any:
    """Return a record of these values; pairs come back from lists."""
    known = {f.name for f in fields(kind)}
    for name in values:
        if name not in known:
            raise Sim2RealError(f"a report's {kind.__name__} has no key {name!r}")
    pairs = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    try:
        return kind(**pairs)
    except TypeError as error:
        raise Sim2RealError(f"a report's {kind.__name__} is incomplete: {error}") from None


def _each(kind: type, tables: Any) -> tuple[Any, ...]:
    return tuple(_make(kind, table) for table in tables)


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
