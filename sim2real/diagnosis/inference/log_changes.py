"""What may be wrong with a log: hypotheses like any other, and what mends each.

    for change in log_changes(data):
        change.label, change.probes, change.mended(log, values)

A change says what the log's columns would be without the mistake. It has values, within bounds, or
none: a column is reversed or it is not. Readings are never interpolated: one that was taken at
another time goes to the row of that time, and its stamp says by how much it is still off; what was
read before an episode's first row is continued from its first two.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data

TURN = 2 * math.pi
DEGREE = math.pi / 180
ROWS = 3  # rows by which commands are shifted at most
LATE = 6.0  # rows by which readings are late or early at most
LATES = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)  # rows that are looked at first
SCALES = (0.25, 0.5, 2.0, 4.0)  # factors that are looked at first
RATES = (0.5, 0.8, 1.25, 2.0)
SHIFT = 0.1  # rad or m: an offset that is looked at first
FARTHEST, LARGEST = 7.0, 20.0  # bounds: of an offset [rad or m], of a factor

Columns = Mapping[str, np.ndarray]
Mend = Callable[[Log, np.ndarray], Columns]


@dataclass(frozen=True)
class LogChange:
    """A mistake that a log may have.

    Args:
        effect: its name, such as `rows_shifted`.
        where: the column, or the joint where it is in all of its columns; None: the whole log.
        mend: returns the columns that would be others without it, from a log and values (P,).
        remedy: what to do, with `{0}` for the first value.
        probes: values to look at first, (K, P); (1, 0) where it has none.
        neutral: values at which nothing is wrong, (P,).
        low: smallest values, (P,).
        high: largest values, (P,).
        unit: of the first value.
        whole: whether values are whole numbers.
        read: the joints whose readings it scales.
        factor: that factor, where it is no value.
    """

    effect: str
    where: str | None
    mend: Mend = field(compare=False)
    remedy: str = field(compare=False)
    probes: np.ndarray = field(compare=False)
    neutral: np.ndarray = field(compare=False)
    low: np.ndarray = field(compare=False)
    high: np.ndarray = field(compare=False)
    unit: str = ""
    whole: bool = False
    read: tuple[str, ...] = ()
    factor: float | None = None

    @property
    def label(self) -> str:
        """What tells it apart."""
        return ".".join(["log", self.effect, *([self.where] if self.where else [])])

    def mended(self, log: Log, values: np.ndarray) -> Log:
        """Return a log without the mistake."""
        return Log({**log.columns, **self.mend(log, values)}, log.meta, log.path)

    def log_scale(self, values: np.ndarray) -> Mapping[str, float]:
        """Return log |d mended reading / d reading| of the joints whose readings it scales.

        Densities of other readings are compared: shrinking them all would make any model right.
        """
        factor = self.factor if self.factor is not None else float(values[0]) if self.read else 1.0
        return dict.fromkeys(self.read, math.log(abs(factor)))


def log_changes(data: Data) -> list[LogChange]:
    """Return the mistakes that the logs of this robot may have."""
    log, model = data.logs[0], data.models[0]
    joints = [joint.name for joint in data.joints if f"qpos.{joint.name}" in log.columns]
    commands = _commands(model, log)
    every = [f"ctrl.{name}" for name in log.actuators]
    step = float(np.median(np.diff(log.time)))
    found = [*_clocks(joints, every, step), *_units(joints, every), _increments(every)]
    found += [_mapped("ctrl", every)] if len(every) > 1 else []
    for joint in joints:
        found += _of_joint(data.logs, joint, commands.get(joint))
    for one, other in itertools.combinations(joints, 2):
        found += _of_pair(one, other, commands)
    return found


def _commands(model: mujoco.MjModel, log: Log) -> dict[str, str]:
    """Return the command column of each joint that an actuator drives."""
    return {
        model.joint(int(model.actuator_trnid[i, 0])).name: f"ctrl.{model.actuator(i).name}"
        for i in range(model.nu)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        and model.actuator(i).name in log.actuators
    }


def _single(
    effect: str,
    where: str | None,
    mend: Mend,
    remedy: str,
    probes: Sequence[float],
    bounds: tuple[float, float],
    neutral: float = 0.0,
    unit: str = "",
    whole: bool = False,
    read: Sequence[str] = (),
) -> LogChange:
    """Return a change of one value."""
    points = np.array(probes, float)[:, None]
    absent, low, high = (np.array([value]) for value in (neutral, *bounds))
    own = (points, absent, low, high, unit, whole, tuple(read))
    return LogChange(effect, where, mend, remedy, *own)


def _plain(
    effect: str,
    where: str | None,
    mend: Callable[[Log], Columns],
    remedy: str,
    read: Sequence[str] = (),
    factor: float | None = None,
) -> LogChange:
    """Return a change without values."""
    none = np.zeros(0)
    read, probes = tuple(read) if factor is not None else (), np.zeros((1, 0))
    return LogChange(
        effect,
        where,
        lambda log, values: mend(log),
        remedy,
        probes,
        none,
        none,
        none,
        read=read,
        factor=factor,
    )


def _clocks(joints: Sequence[str], commands: Sequence[str], step: float) -> Iterator[LogChange]:
    """Yield what may be wrong with rows and times."""
    yield _single(
        "rows_shifted",
        "ctrl",
        lambda log, v: {c: _held(log, log.columns[c], round(float(v[0]))) for c in commands},
        "move the columns ctrl.* up by {0:g} rows within each episode",
        [rows for rows in range(-ROWS, ROWS + 1) if rows],
        (-ROWS, ROWS),
        unit="rows",
        whole=True,
    )
    places: dict[str, Sequence[str]] = {"qpos": joints}
    places |= {joint: [joint] for joint in joints} if len(joints) > 1 else {}
    for where, own in places.items():
        yield _single(
            "readings_late",
            where,
            lambda log, v, own=own: _earlier(log, own, float(v[0])),
            "take {0:.4g} s off the stamps of these readings",
            [late * step for late in LATES],
            (-LATE * step, LATE * step),
            unit="s",
        )
    yield _single(
        "clock_rate",
        None,
        _faster,
        "multiply time by {0:.4g}",
        RATES,
        (1 / LARGEST, LARGEST),
        neutral=1.0,
    )


def _faster(log: Log, values: np.ndarray) -> Columns:
    """Return the columns of a log whose clock counts in other units."""
    times = [n for n in log.columns if n == "time" or n.startswith("stamp.")]
    speeds = [n for n in log.columns if n.startswith("qvel.")]
    rate = float(values[0])
    found = {name: log.columns[name] * rate for name in times}
    return found | {name: log.columns[name] / rate for name in speeds}


def _units(joints: Sequence[str], commands: Sequence[str]) -> Iterator[LogChange]:
    """Yield angles in degrees: the commands, the readings, both."""
    readings = [f"{kind}.{joint}" for joint in joints for kind in ("qpos", "qvel")]
    for where, own in (("ctrl", commands), ("qpos", readings), (None, [*commands, *readings])):
        read = () if where == "ctrl" else joints
        yield _plain(
            "degrees",
            where,
            lambda log, own=own: {n: DEGREE * log.columns[n] for n in _there(log, own)},
            "multiply by pi / 180",
            read,
            DEGREE,
        )


def _increments(commands: Sequence[str]) -> LogChange:
    """Return commands that say by how much to move on."""

    def mend(log: Log) -> Columns:
        found = {name: np.empty(len(log)) for name in commands}
        for own in _episodes(log):
            for name in commands:
                found[name][own] = np.cumsum(log.columns[name][own])
        return found

    return _plain("increments", "ctrl", mend, "sum them up from the first position on")


def _mapped(where: str, commands: Sequence[str]) -> LogChange:
    """Return commands that are off by one factor, and by an offset each."""

    def mend(log: Log, values: np.ndarray) -> Columns:
        pairs = zip(commands, values[1:], strict=True)
        return {name: values[0] * log.columns[name] + offset for name, offset in pairs}

    def row(factor: float, offset: float) -> np.ndarray:
        return np.array([factor, *np.full(len(commands), offset)])

    return LogChange(
        "mapped",
        where,
        mend,
        "multiply by {0:.4g} and add the default pose",
        np.stack([row(scale, 0.0) for scale in SCALES]),
        row(1.0, 0.0),
        row(1 / LARGEST, -FARTHEST),
        row(LARGEST, FARTHEST),
    )


def _of_joint(logs: Sequence[Log], joint: str, command: str | None) -> Iterator[LogChange]:
    """Yield what may be wrong with the columns of one joint: its readings, its command, both."""
    reading = [f"qpos.{joint}", f"qvel.{joint}"]
    places = {f"qpos.{joint}": reading}
    if command is not None:
        places |= {command: [command], joint: [*reading, command]}
        yield _mapped(command, [command])
    for where, own in places.items():
        read = () if where == command else (joint,)
        angles = [name for name in own if not name.startswith("qvel.")]
        yield _plain(
            "reversed",
            where,
            lambda log, own=own: {n: -log.columns[n] for n in _there(log, own)},
            "multiply by -1",
        )
        yield _single(
            "scaled",
            where,
            lambda log, v, own=own: {n: v[0] * log.columns[n] for n in _there(log, own)},
            "multiply by {0:.4g}",
            SCALES,
            (1 / LARGEST, LARGEST),
            neutral=1.0,
            read=read,
        )
        yield _single(
            "offset",
            where,
            lambda log, v, own=angles: {n: log.columns[n] + v[0] for n in own},
            "add {0:.4g}",
            (-SHIFT, SHIFT, -TURN, TURN),
            (-FARTHEST, FARTHEST),
            unit="rad",
        )
        if any(_jumps(log, angles[0]) for log in logs):
            yield _plain(
                "turns",
                where,
                lambda log, own=angles: {n: _unwrapped(log, n) for n in own},
                "unwrap: it jumps by whole turns",
            )


def _of_pair(one: str, other: str, commands: Mapping[str, str]) -> Iterator[LogChange]:
    """Yield what may be wrong with the columns of two joints."""
    pairs = [(f"qpos.{one}", f"qpos.{other}")]
    both = one in commands and other in commands
    pairs += [(commands[one], commands[other])] if both else []
    for a, b in pairs:
        yield _plain(
            "swapped",
            f"{a}/{b}",
            lambda log, a=a, b=b: {a: log.columns[b], b: log.columns[a]},
            f"exchange {a} and {b}",
        )
    for joint, base in ((one, other), (other, one)):
        ahead = {f"qpos.{joint}": f"qpos.{base}"}
        ahead |= {commands[joint]: commands[base]} if both else {}
        yield _single(
            "mixed",
            f"{joint}/{base}",
            lambda log, v, ahead=ahead: {
                n: log.columns[n] + v[0] * log.columns[m] for n, m in ahead.items()
            },
            f"add {{0:.3g}} times {base}'s angle to {joint}'s",
            (-1.0, 1.0),
            (-FARTHEST, FARTHEST),
        )


def _there(log: Log, names: Sequence[str]) -> list[str]:
    """Return which of some columns a log has."""
    return [name for name in names if name in log.columns]


def _episodes(log: Log) -> list[np.ndarray]:
    """Return the rows of each episode."""
    return np.split(np.arange(len(log)), np.flatnonzero(np.diff(log.episode)) + 1)


def _moved(log: Log, column: np.ndarray, later: int) -> np.ndarray:
    """Return a column as it is so many rows later; at an episode's ends it goes on straight."""
    found = np.empty(len(log))
    for own in _episodes(log):
        ends = np.clip(own + later, own[0], own[-1])
        slopes = np.diff(column[own])[[0, -1]]
        beyond = own + later - ends
        found[own] = column[ends] + beyond * np.where(beyond < 0, *slopes)
    return found


def _held(log: Log, column: np.ndarray, later: int) -> np.ndarray:
    """Return a column as it is so many rows later, held at an episode's ends."""
    rows = [np.clip(own + later, own[0], own[-1]) for own in _episodes(log)]
    return column[np.concatenate(rows)]


def _earlier(log: Log, joints: Sequence[str], late: float) -> Columns:
    """Return readings that were taken so many seconds before their stamps at the rows of then."""
    rows = round(late / float(np.median(np.diff(log.time))))
    found = {}
    for joint in joints:
        for name in _there(log, [f"qpos.{joint}", f"qvel.{joint}"]):
            found[name] = _moved(log, log.columns[name], rows)
        stamps = log.columns.get(f"stamp.{joint}", log.time)
        found[f"stamp.{joint}"] = _moved(log, stamps, rows) - late
    return found


def _jumps(log: Log, name: str) -> bool:
    """Return whether a column moves by more than half a turn between two rows of an episode."""
    return any(np.abs(np.diff(log.column(name)[own])).max() > TURN / 2 for own in _episodes(log))


def _unwrapped(log: Log, name: str) -> np.ndarray:
    return np.concatenate([np.unwrap(log.columns[name][own]) for own in _episodes(log)])
