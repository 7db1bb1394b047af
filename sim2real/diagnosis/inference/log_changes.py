"""What may be wrong with a log: hypotheses like any other, and what mends each.

    for change in list_log_changes(data):
        change.label, change.probes, change.mended(log, values)

Values say what the log has:

| effect | value | the log has |
|---|---|---|
| `row_shift` | rows | in row i what belongs into row i - value |
| `reversal` | -1 | the negative |
| `scale` | factor | the true value times it; of all commands also less a default pose |
| `offset` | rad or m | the true value plus it |
| `turn` | turns | the true value plus 2 pi of each, from `seconds` on |
| `unit` | 180/pi | degrees in place of radians; or counts of a turn, from a zero on |
| `clock` | factor | the true time times it |
| `swap` | 1 | two joints' columns exchanged |
| `column_map` | factor | the true value plus so much of another joint's |
| `increments` | 1 | by how much to move on |
| `observation_delay` | s | readings that are so old: the robot's effect, undone in its log |

Readings are never interpolated: one that was taken at another time goes to the row of that time,
and its stamp says by how much it is still off; what was read before an episode's first row is
continued from its first two.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import mujoco
import numpy as np

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.columns import (
    COMMAND,
    READING,
    SPEED,
    TIME,
    TURN,
    Columns,
    find_bases,
    find_jump,
    map_episodes,
    shift_held,
    shift_readings,
    unwrap_turns,
)
from sim2real.diagnosis.inference.log_change import LogChange, Mend
from sim2real.diagnosis.preflight.speeds import speed_laws
from sim2real.diagnosis.settings import TINY

DEGREES = 180 / math.pi
LATE = (0.5, 1.0, 2.5)  # rows by which readings may be old that are looked at first
MOST = 6.0  # rows of a shift at most
OLDEST = 0.12  # s: age of a reading at most; `observation_delay` reaches 0.1 s
SCALES = (0.5, 2.0)
SHIFT = 0.1  # rad or m
COUNTS = (1024, 4096)  # of a turn, of the encoders of hobby and smart servos
FARTHEST, LARGEST = 7.0, 20.0  # bounds: of an offset [rad or m], of a factor
FACTOR = (1.0, 1 / LARGEST, LARGEST)
KINDS = ((COMMAND,), (READING,), (COMMAND, READING))  # of columns that one thing can be wrong with


class _Value(NamedTuple):
    """The value of a mistake that has one."""

    remedy: str  # see `LogChange`
    probes: Sequence[float]
    bounds: tuple[float, float, float]  # neutral, smallest and largest
    unit: str = ""
    whole: bool = False


LATER = "put the value of row i{0:+g} into row i, within each episode"
VALUES = {
    "row_shift": _Value(LATER, (-2.0, -1.0, 1.0, 2.0), (0.0, -MOST, MOST), "rows", True),
    "scale": _Value("divide by {0:.4g}", SCALES, FACTOR),
    "offset": _Value("subtract {0:.4g}", (-SHIFT, SHIFT), (0.0, -FARTHEST, FARTHEST), "rad"),
    "turn": _Value("subtract {0:g} turns", (-1.0, 1.0), (0.0, -1.0, 1.0), "turns", True),
    "clock": _Value("divide by {0:.4g}", (0.85, 1.2), FACTOR),
    "column_map": _Value(
        "subtract {0:.3g} times {other}'s", (-1.0, 1.0), (0.0, -FARTHEST, FARTHEST)
    ),
}


def list_log_changes(data: Data) -> list[LogChange]:
    """Return the mistakes that the logs of this robot may have."""
    log = data.logs[0]
    joints = [joint.name for joint in data.joints if f"{READING}.{joint.name}" in log.columns]
    commands = _commands(data.models[0], log)
    found = [_posed(log.actuators), _increments(log.actuators)]
    found += _clocks(data)
    found.append(_late_readings(joints, log))
    found += _in_counts(log, joints, [commands[j] for j in joints if j in commands])
    for joint in [None, *joints] if len(joints) > 1 else joints:
        own = joints if joint is None else [joint]
        named = {
            COMMAND: [commands[j] for j in own if j in commands],
            READING: [f"{READING}.{j}" for j in own],
            SPEED: [f"{SPEED}.{j}" for j in own if f"{SPEED}.{j}" in log.columns],
        }
        found += _of_place(joint, own, named, len(own) == len(joints))
        if joint is not None:
            found += _of_joint(data.logs, joint, named)
    for one, other in combinations(joints, 2):
        found += _swaps(one, other, commands)
    for joint, base in find_bases(data.models[0], joints):
        found += _maps(joint, base, commands)
    return found


def find_reach(log: Log) -> int:
    """Return by how many rows commands or readings of a log may be late at most."""
    return math.ceil(max(MOST, OLDEST / _step(log) - TINY))


def _step(log: Log) -> float:
    """Return the time between two rows [s]."""
    return float(np.median(np.diff(log.time)))


def _commands(model: mujoco.MjModel, log: Log) -> dict[str, str]:
    """Return the command column of each joint that an actuator drives."""
    return {
        model.joint(int(model.actuator_trnid[i, 0])).name: f"{COMMAND}.{model.actuator(i).name}"
        for i in range(model.nu)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        and model.actuator(i).name in log.actuators
    }


def _single(
    name: str,
    columns: tuple[str, ...],
    place: str | None,
    mend: Mend,
    value: _Value | None = None,
    **more: Any,
) -> LogChange:
    """Return a change of one value; None: that of `VALUES`."""
    about = value or VALUES[name]
    points = np.array(about.probes, float)[:, None]
    neutral, low, high = (np.array([bound]) for bound in about.bounds)
    more |= {"unit": about.unit, "whole": about.whole}
    return LogChange(name, columns, place, mend, about.remedy, points, neutral, low, high, **more)


def _late_readings(joints: Sequence[str], log: Log) -> LogChange:
    """Return readings that are older than their rows.

    A window starts with its first reading, which is as old: only the log can be set right.
    """
    step = _step(log)
    oldest = find_reach(log) * step
    effect = make("observation_delay", longest=oldest)
    probes = [*(rows * step for rows in LATE), OLDEST / 2]
    return _single(
        effect.name,
        (READING,),
        None,
        lambda log, v: shift_readings(log, joints, float(v[0]) / step),
        _Value("", probes, (0.0, 0.0, oldest), effect.unit),
        late=lambda v: float(v[0]) / step,
        effect=effect,
    )


def _clocks(data: Data) -> list[LogChange]:
    """Return a clock that counts in another unit; none where measured speeds say that it is right.

    They are the change of positions over the log's time. If they are far from that by one factor at
    all joints, the log shows its clock's. Without them a robot that moves faster or slower than
    its model may have another clock.
    """
    limits = data.settings.preflight
    laws = speed_laws([(log, data.models[0]) for log in data.logs], limits).values()
    scales = np.array([law.scale for law in laws])
    if (abs(scales - 1) < limits.clock).any():
        return []

    def mend(log: Log, values: np.ndarray) -> Columns:
        times = [n for n in log.columns if n == TIME or n.startswith("stamp.")]
        return {name: log.columns[name] / values[0] for name in times}

    value, shown = VALUES["clock"], False
    if len(scales):
        factor, (low, high) = float(np.median(scales)), limits.ratio
        alike = bool(((low < scales / factor) & (scales / factor < high)).all())
        shown = alike and not low < factor < high and 1 / LARGEST < factor < LARGEST
    if shown:
        bounds = (1.0, factor * (1 - limits.clock), factor * (1 + limits.clock))
        value = value._replace(probes=(factor,), bounds=bounds)
    return [_single("clock", (TIME,), None, mend, value, shown=shown)]


def _posed(actuators: Sequence[str]) -> LogChange:
    """Return commands that are a policy's outputs: scaled, and less a default pose."""
    names = [f"{COMMAND}.{name}" for name in actuators]

    def mend(log: Log, values: np.ndarray) -> Columns:
        pairs = zip(names, values[1:], strict=True)
        return {name: log.columns[name] / values[0] + pose for name, pose in pairs}

    def row(factor: float, pose: float) -> np.ndarray:
        return np.array([factor, *np.full(len(names), pose)])

    return LogChange(
        "scale",
        (COMMAND,),
        None,
        mend,
        "divide by {0:.4g} and add the default pose",
        np.stack([*(row(scale, 0.0) for scale in SCALES), row(1.0, SHIFT)]),
        row(1.0, 0.0),
        row(1 / LARGEST, -FARTHEST),
        row(LARGEST, FARTHEST),
        variant="posed",
    )


def _increments(actuators: Sequence[str]) -> LogChange:
    """Return commands that say by how much to move on."""
    names = [f"{COMMAND}.{name}" for name in actuators]

    def mend(log: Log, values: np.ndarray) -> Columns:
        return {name: map_episodes(log, log.columns[name], np.cumsum) for name in names}

    return LogChange("increments", (COMMAND,), None, mend, "sum them up from the first pose on")


def _in_counts(log: Log, joints: Sequence[str], commands: Sequence[str]) -> Iterator[LogChange]:
    """Yield counts of an encoder, where all readings are whole numbers beyond a turn."""
    readings = [f"{READING}.{joint}" for joint in joints]
    values = np.array([log.columns[name] for name in readings])
    if (values != np.round(values)).any() or np.abs(values).max() < TURN:
        return
    for columns, own in (
        ((READING,), readings),
        ((COMMAND, READING), [*commands, *readings]),
    ):
        for count, zero in ((c, z) for c in COUNTS for z in (0, c // 2)):
            yield LogChange(
                "unit",
                columns,
                None,
                _each(
                    own, lambda column, v, count=count, zero=zero: (column - zero) * TURN / count
                ),
                f"in columns.yaml, `unit: counts/{count}` and `zero: {zero}`",
                value=count / TURN,
                variant=f"{count} from {zero}",
                read=tuple(joints),
            )


def _of_place(
    where: str | None, joints: Sequence[str], named: Mapping[str, Sequence[str]], every: bool
) -> Iterator[LogChange]:
    """Yield shifts, scales and units of one joint's columns, or of all joints': of every one."""

    def hold(log: Log, values: np.ndarray) -> Columns:
        rows = round(float(values[0]))
        return {name: shift_held(log, log.columns[name], rows) for name in named[COMMAND]}

    def shift(log: Log, values: np.ndarray) -> Columns:
        return shift_readings(log, joints, round(float(values[0])))

    yield _single("row_shift", (COMMAND,), where, hold)
    yield _single("row_shift", (READING,), where, shift, late=lambda v: float(v[0]) * every)
    for columns in KINDS:
        own = [name for kind in columns for name in _with_speed(kind, named)]
        read = tuple(joints) if READING in columns else ()
        scaled = _each(own, lambda column, v: column / v[0])
        degrees = _each(own, lambda column, v: column / DEGREES)
        text = "multiply by pi / 180"
        yield _single("scale", columns, where, scaled, read=read)
        yield LogChange("unit", columns, where, degrees, text, value=DEGREES, read=read)


def _each(names: Sequence[str], change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Mend:
    """Return what changes each of some columns, from it and values (P,)."""
    return lambda log, values: {name: change(log.columns[name], values) for name in names}


def _with_speed(kind: str, named: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the columns of a kind; a wrong reading's speed is wrong with it."""
    return [*named[kind], *(named[SPEED] if kind == READING else ())]


def _of_joint(
    logs: Sequence[Log], joint: str, named: Mapping[str, Sequence[str]]
) -> Iterator[LogChange]:
    """Yield signs, offsets and turns of one joint's columns."""
    for columns in KINDS:
        own = [name for kind in columns for name in _with_speed(kind, named)]
        places = [name for kind in columns for name in named[kind]]
        negative = _each(own, lambda column, v: -column)
        yield LogChange("reversal", columns, joint, negative, "multiply by -1", value=-1.0)
        yield _single("offset", columns, joint, _each(places, lambda column, v: column - v[0]))
        turned = _each(places, lambda column, v: column - TURN * round(v[0]))
        yield _single("turn", columns, joint, turned)
        jump = next((j for log in logs for name in places[:1] if (j := find_jump(log, name))), None)
        if jump is not None:
            yield LogChange(
                "turn",
                columns,
                joint,
                lambda log, v, own=places: {n: unwrap_turns(log, log.columns[n]) for n in own},
                "unwrap: it jumps by whole turns",
                value=jump[0],
                unit="turns",
                seconds=jump[1:],
                variant="jump",
            )


def _swaps(one: str, other: str, commands: Mapping[str, str]) -> Iterator[LogChange]:
    """Yield the columns of two joints exchanged."""
    pairs = {READING: (f"{READING}.{one}", f"{READING}.{other}")}
    if one in commands and other in commands:
        pairs[COMMAND] = (commands[one], commands[other])
    for kind, (a, b) in pairs.items():
        yield LogChange(
            "swap",
            (kind,),
            one,
            lambda log, v, a=a, b=b: {a: log.columns[b], b: log.columns[a]},
            f"exchange {a} and {b}",
            other=other,
        )


def _maps(joint: str, base: str, commands: Mapping[str, str]) -> Iterator[LogChange]:
    """Yield a joint's columns with so much of another's in them, all of it from the ground."""
    reading = {f"{READING}.{joint}": f"{READING}.{base}"}
    both = {commands[joint]: commands[base]} if {joint, base} <= set(commands) else {}
    for columns, pairs in (((READING,), reading), ((COMMAND, READING), reading | both)):
        yield _single(
            "column_map",
            columns,
            joint,
            lambda log, v, pairs=pairs: {
                n: log.columns[n] - v[0] * log.columns[m] for n, m in pairs.items()
            },
            other=base,
        )
