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

    What was simulated is NaN where nothing is compared.
    """

    log: str  # name of the log's file
    episode: int  # its number in the log
    joint: str
    unit: str  # rad or m
    time: np.ndarray  # (T,) s
    measured: np.ndarray  # (T,)
    nominal: np.ndarray  # (T,) replayed in the model as given
    corrected: np.ndarray  # (T,) replayed with the causes; no value was fitted to its rows
    floor: float  # noise floor of this joint
    starts: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    """Rows at which the replay starts again from the measured state, (n,)."""
    subsets: Mapping[frozenset[int], np.ndarray] = field(default_factory=dict)
    """Replayed with only these causes (their places in `Report.causes`), fitted anew, (T,) each;
    {} where not all subsets were tried."""


@dataclass(frozen=True)
class Signal:
    """What else was logged in one episode of an actuator."""

    log: str  # name of the log's file
    episode: int  # its number in the log
    kind: Kind
    actuator: str
    unit: str  # rad, m, A or V; "" for a command that is no position
    joint: str | None  # whose position a command is; None for none
    time: np.ndarray  # (T,) s
    values: np.ndarray  # (T,)


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
    """How far the simulation is from a channel that nothing was fitted to, root mean square."""

    column: str  # of the log
    unit: str  # of the numbers
    noise: float  # of the channel itself
    before: float  # with the model as given
    after: float  # with the causes


@dataclass(frozen=True)
class Evidence:
    """What the pictures show and `report.json` does not hold."""

    traces: tuple[Trace, ...] = ()  # every joint of every episode
    ladder: tuple[Rung, ...] = ()  # before, after each added effect, all together; the floor
    singles: tuple[SingleFit, ...] = ()  # every effect that was fitted alone, the best first
    bands: tuple[Band, ...] = ()  # joint by joint, low frequencies first
    inputs: Mapping[str, Any] = field(default_factory=dict)  # names, seed, versions, folds
    settings: tuple[Row, ...] = ()  # every number that steered the answer
    signals: tuple[Signal, ...] = ()  # commands, currents and voltages of every episode
    correlations: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    """The correlations of the causes' first values over resampled blocks, (n, n)."""
    channels: tuple[ChannelGap, ...] = ()  # every channel other than the positions
