"""What the pictures of a report show and `report.json` does not hold: traces, ladder, candidates.

    report.evidence.traces[0].corrected          # held out, (T,)

It stays in memory: a report that was read has none.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from sim2real.diagnosis.settings import Row

Kind = Literal["command", "current", "voltage"]
Pair = tuple[float, float]


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
    """One effect alone: its value, and the share of the closable gap that it closes."""

    effect: str
    where: str | None
    side: str | None
    value: float
    unit: str
    closed: float
    ci: Pair  # its 90 % interval


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
class ChannelGap:
    """How far the simulation is from a channel that nothing was fitted to, root mean square.

    Args:
        column: of the log.
        unit: of the numbers.
        noise: of the channel itself.
        before: with the model as given.
        after: with the causes.
    """

    column: str
    unit: str
    noise: float
    before: float
    after: float


@dataclass(frozen=True)
class Evidence:
    """What the pictures show and `report.json` does not hold.

    Args:
        traces: every joint of every episode.
        ladder: before, after each effect that was added, all together; the last one is the floor.
        singles: every effect that was fitted alone, the best first.
        bands: joint by joint, low frequencies first.
        inputs: names of logs and models, seed, versions, how the data was divided.
        settings: every number that steered the answer.
        signals: commands, currents and voltages of every episode.
        channels: every channel other than the positions.
        correlations: the correlations of the causes' first values over resampled blocks, (n, n).
    """

    traces: tuple[Trace, ...] = ()
    ladder: tuple[Rung, ...] = ()
    singles: tuple[SingleFit, ...] = ()
    bands: tuple[Band, ...] = ()
    inputs: Mapping[str, Any] = field(default_factory=dict)
    settings: tuple[Row, ...] = ()
    signals: tuple[Signal, ...] = ()
    correlations: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    channels: tuple[ChannelGap, ...] = ()
