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
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

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
ROWS = (-2.0, -1.0, 1.0, 2.0)  # rows of a shift that are looked at first
MOST = 6.0  # rows of a shift at most
OLDEST = 0.12  # s: age of a reading at most; `observation_delay` reaches 0.1 s
SCALES = (0.5, 2.0)
RATES = (0.85, 1.2)
SHIFTS = (-0.1, 0.1)  # rad or m
COUNTS = (1024, 4096)  # of a turn, of the encoders of hobby and smart servos
FARTHEST, LARGEST = 7.0, 20.0  # bounds: of an offset [rad or m], of a factor


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
    effect: str,
    columns: tuple[str, ...],
    where: str | None,
    mend: Mend,
    remedy: str,
    probes: Sequence[float],
    bounds: tuple[float, float, float],
    **more: object,
) -> LogChange:
    """Return a change of one value; `bounds` are neutral, smallest and largest."""
    ends = (np.array([value]) for value in bounds)
    points = np.array(probes, float)[:, None]
    return LogChange(effect, columns, where, mend, remedy, points, *ends, **more)  # type: ignore[arg-type]


def _late_readings(joints: Sequence[str], log: Log) -> LogChange:
    """Return readings that are older than their rows.

    A window starts with its first reading, which is as old: only the log can be set right.
    """
    step = _step(log)
    oldest = find_reach(log) * step
    effect = make("observation_delay", longest=oldest)
    return _single(
        effect.name,
        (READING,),
        None,
        lambda log, v: shift_readings(log, joints, float(v[0]) / step),
        "",
        [*(rows * step for rows in LATE), OLDEST / 2],
        (0.0, 0.0, oldest),
        unit=effect.unit,
        late=lambda v: float(v[0]) / step,
        robot=effect,
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

    probes, bounds, shown = RATES, (1.0, 1 / LARGEST, LARGEST), False
    if len(scales):
        factor, (low, high) = float(np.median(scales)), limits.ratio
        alike = bool(((low < scales / factor) & (scales / factor < high)).all())
        shown = alike and not low < factor < high and 1 / LARGEST < factor < LARGEST
    if shown:
        probes, bounds = (factor,), (1.0, factor * (1 - limits.clock), factor * (1 + limits.clock))
    text = "divide by {0:.4g}"
    return [_single("clock", (TIME,), None, mend, text, probes, bounds, shown=shown)]


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
        np.stack([*(row(scale, 0.0) for scale in SCALES), row(1.0, SHIFTS[-1])]),
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
                lambda log, v, own=own, count=count, zero=zero: {
                    n: (log.columns[n] - zero) * TURN / count for n in own
                },
                f"in columns.yaml, `unit: counts/{count}` and `zero: {zero}`",
                value=count / TURN,
                variant=f"{count} from {zero}",
                read=tuple(joints),
            )


def _of_place(
    where: str | None, joints: Sequence[str], named: Mapping[str, Sequence[str]], every: bool
) -> Iterator[LogChange]:
    """Yield shifts, scales and units of one joint's columns, or of all joints': of every one."""
    yield _single(
        "row_shift",
        (COMMAND,),
        where,
        lambda log, v: {
            n: shift_held(log, log.columns[n], round(float(v[0]))) for n in named[COMMAND]
        },
        "put the value of row i{0:+g} into row i, within each episode",
        ROWS,
        (0.0, -MOST, MOST),
        unit="rows",
        whole=True,
    )
    yield _single(
        "row_shift",
        (READING,),
        where,
        lambda log, v: shift_readings(log, joints, round(float(v[0]))),
        "put the value of row i{0:+g} into row i, within each episode",
        ROWS,
        (0.0, -MOST, MOST),
        unit="rows",
        whole=True,
        late=lambda v: float(v[0]) * every,
    )
    for columns in ((COMMAND,), (READING,), (COMMAND, READING)):
        own = [name for kind in columns for name in _with_speed(kind, named)]
        read = tuple(joints) if READING in columns else ()
        yield _single(
            "scale",
            columns,
            where,
            lambda log, v, own=own: {n: log.columns[n] / v[0] for n in own},
            "divide by {0:.4g}",
            SCALES,
            (1.0, 1 / LARGEST, LARGEST),
            read=read,
        )
        yield LogChange(
            "unit",
            columns,
            where,
            lambda log, v, own=own: {n: log.columns[n] / DEGREES for n in own},
            "multiply by pi / 180",
            value=DEGREES,
            read=read,
        )


def _with_speed(kind: str, named: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the columns of a kind; a wrong reading's speed is wrong with it."""
    return [*named[kind], *(named[SPEED] if kind == READING else ())]


def _of_joint(
    logs: Sequence[Log], joint: str, named: Mapping[str, Sequence[str]]
) -> Iterator[LogChange]:
    """Yield signs, offsets and turns of one joint's columns."""
    for columns in ((COMMAND,), (READING,), (COMMAND, READING)):
        own = [name for kind in columns for name in _with_speed(kind, named)]
        places = [name for kind in columns for name in named[kind]]
        yield LogChange(
            "reversal",
            columns,
            joint,
            lambda log, v, own=own: {n: -log.columns[n] for n in own},
            "multiply by -1",
            value=-1.0,
        )
        yield _single(
            "offset",
            columns,
            joint,
            lambda log, v, own=places: {n: log.columns[n] - v[0] for n in own},
            "subtract {0:.4g}",
            SHIFTS,
            (0.0, -FARTHEST, FARTHEST),
            unit="rad",
        )
        yield _single(
            "turn",
            columns,
            joint,
            lambda log, v, own=places: {n: log.columns[n] - TURN * round(v[0]) for n in own},
            "subtract {0:g} turns",
            (-1.0, 1.0),
            (0.0, -1.0, 1.0),
            unit="turns",
            whole=True,
        )
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
            f"subtract {{0:.3g}} times {base}'s",
            (-1.0, 1.0),
            (0.0, -FARTHEST, FARTHEST),
            other=base,
        )
