"""Mistakes that people make when they write a log, drawn at random: kind, column and size.

    mistake = draw_mistake(rng, log)                # of a log without one
    broken = mistake.apply(log)
    mistake.describe()                              # scale of ctrl.* by 0.41

What is written is wrong, not the robot. Only mistakes are drawn that no effect of a robot imitates:
commands that stand late and readings that stand early, since a late reading is an
`observation_delay` and an early command a `command_delay`; offsets of command or reading alone,
since the same one in both is an `encoder_offset`. The conventions of values:

| kind | value | the log has |
|---|---|---|
| `row_shift` | rows | in row i what belongs into row i - value |
| `reversal` | -1 | the negative |
| `scale` | factor | the true value times it |
| `offset` | rad or m | the true value plus it |
| `turn` | turns | the true value plus 2π of each, from `seconds` on |
| `unit` | 180/π | degrees in place of radians |
| `clock` | factor | the true time times it |
| `swap` | 1 | two joints' columns exchanged: `joint` and `other` |
| `column_map` | 1 | the sum of the joint and `other`: an angle measured from the ground |
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hardware.log import Log

COMMAND, READING, SPEED = "ctrl", "qpos", "qvel"
KINDS = ("row_shift", "reversal", "scale", "offset", "turn", "unit", "clock", "swap", "column_map")
UNKNOWN = f"unknown mistake {{!r}}; choose one of: {', '.join(KINDS)}"
PAIRED = ("swap", "column_map")  # needs two joints
SPEEDLESS = ("offset", "turn")  # of a position; its speed is right
MOST_ROWS = 3  # that a column is shifted by
SCALES = (1.5, 5.0)  # factors, or one over them
OFFSETS = (0.2, 0.8)  # rad
CLOCKS = (1.08, 1.5)  # factors, or one over them
JUMPS = (0.3, 0.7)  # shares of the log after which a reading jumps


@dataclass(frozen=True)
class Mistake:
    """One mistake in a log."""

    kind: str  # one of `KINDS`
    columns: tuple[str, ...]  # kinds of columns that have it: `ctrl`, `qpos`, both, or `time`
    joint: str | None  # whose columns; None for those of all joints
    value: float  # its size, by the table of the module
    other: str | None = None  # the second joint of a swap or a sum
    seconds: float | None = None  # when a reading jumps [s]; None: from the start

    def apply(self, log: Log) -> Log:
        """Return the log with this mistake in it; a shift repeats the first or last row."""
        columns = dict(log.columns)
        if self.kind == "clock":
            for name in columns:
                if name == "time" or name.startswith("stamp."):
                    columns[name] = self.value * columns[name]
            return replace(log, columns=columns)
        joints = log.joints if self.joint is None else [self.joint]
        for kind in self._kinds():
            for joint in joints:
                name, other = f"{kind}.{joint}", f"{kind}.{self.other}"
                if name in columns:
                    columns[name] = self._wrong(log, name, other)
                    if self.kind == "swap":
                        columns[other] = log.columns[name]
        return replace(log, columns=columns)

    def _kinds(self) -> tuple[str, ...]:
        """Return the kinds of columns; a wrong reading's speed is wrong with it."""
        speeds = READING in self.columns and self.kind not in SPEEDLESS
        return (*self.columns, *([SPEED] if speeds else []))

    def _wrong(self, log: Log, name: str, other: str) -> np.ndarray:
        """Return a column of the log with the mistake in it, (T,)."""
        values = log.columns[name]
        match self.kind:
            case "row_shift":
                rows = np.arange(len(log)) - round(self.value)
                return values[np.clip(rows, 0, len(log) - 1)]
            case "reversal" | "scale" | "unit":
                return self.value * values
            case "offset":
                return values + self.value
            case "turn":
                after = log.time >= (self.seconds or -math.inf)
                return values + 2 * math.pi * self.value * after
            case "swap":
                return log.columns[other]
            case "column_map":
                return values + log.columns[other]
        raise ValueError(UNKNOWN.format(self.kind))

    def to_json(self) -> dict[str, Any]:
        """Return the entry of a key."""
        return {**asdict(self), "columns": list(self.columns)}

    @staticmethod
    def from_json(tree: Mapping[str, Any]) -> Mistake:
        """Return the mistake that `to_json` turned into this table."""
        return Mistake(**{**tree, "columns": tuple(tree["columns"])})

    def describe(self) -> str:
        """Return the mistake in words: `turn of qpos.elbow by 1 from 4.02 s`."""
        names = " and ".join(f"{kind}.{self.joint or '*'}" for kind in self.columns)
        names = "time" if self.kind == "clock" else names
        other = f" with {self.other}" if self.other else ""
        since = f" from {self.seconds:.4g} s" if self.seconds is not None else ""
        return f"{self.kind} of {names}{other} by {self.value:.3g}{since}"


def draw_mistake(rng: np.random.Generator, log: Log, kind: str | None = None) -> Mistake:
    """Draw a mistake that a log can have.

    Args:
        rng: the random generator.
        log: one episode; its joints and actuators share their names.
        kind: of the mistake; None draws it, all alike.
    """
    joints = log.joints
    if kind is None:
        kinds = [name for name in KINDS if name not in PAIRED or len(joints) > 1]
        kind = str(rng.choice(kinds))
    match kind:
        case "row_shift":
            columns, rows = _either(rng), float(rng.integers(1, MOST_ROWS + 1))
            value = rows if columns == (COMMAND,) else -rows
            return Mistake(kind, columns, _place(rng, joints), value)
        case "reversal":
            return Mistake(kind, _any(rng), str(rng.choice(joints)), -1.0)
        case "scale":
            return Mistake(kind, _either(rng), _place(rng, joints), _factor(rng, SCALES))
        case "offset":
            size = float(rng.uniform(*OFFSETS) * rng.choice((-1, 1)))
            return Mistake(kind, _either(rng), str(rng.choice(joints)), size)
        case "turn":
            row = int(rng.uniform(*JUMPS) * len(log))
            seconds = float(log.time[row]) if rng.integers(2) else None
            turns = float(rng.choice((-1, 1)))
            return Mistake(kind, (READING,), str(rng.choice(joints)), turns, seconds=seconds)
        case "unit":
            return Mistake(kind, _any(rng), _place(rng, joints), 180 / math.pi)
        case "clock":
            return Mistake(kind, ("time",), None, _factor(rng, CLOCKS))
        case "swap":
            joint, other = map(str, rng.choice(joints, 2, replace=False))
            return Mistake(kind, _either(rng), joint, 1.0, other)
        case "column_map":
            number = int(rng.integers(1, len(joints)))
            return Mistake(kind, (READING,), joints[number], 1.0, joints[number - 1])
    raise ValueError(UNKNOWN.format(kind))


def _either(rng: np.random.Generator) -> tuple[str, ...]:
    return (str(rng.choice((COMMAND, READING))),)


def _any(rng: np.random.Generator) -> tuple[str, ...]:
    return ((COMMAND,), (READING,), (COMMAND, READING))[rng.integers(3)]


def _place(rng: np.random.Generator, joints: list[str]) -> str | None:
    """Draw a joint, or all of them, as often."""
    return None if rng.integers(2) else str(rng.choice(joints))


def _factor(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    size = float(np.exp(rng.uniform(*np.log(limits))))
    return size if rng.integers(2) else 1 / size
