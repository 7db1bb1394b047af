"""What a user may have got wrong in a log, and how the log looks once it is right."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from hardware.log import Log
from sim2real.diagnosis.data.trial import Piece
from sim2real.diagnosis.settings import TINY, LogErrors

DEGREE = np.pi / 180
KINDS = {  # what may be wrong together, and its name
    ("qpos",): "positions",
    ("ctrl",): "commands",
    ("qpos", "ctrl"): "positions and commands",
}
UNITS = {  # what may be in another unit together
    **KINDS,
    ("qpos", "qvel"): "positions and speeds",
    ("qpos", "ctrl", "qvel"): "positions, speeds and commands",
}

Change = Callable[[Piece], Piece]


class Correction(NamedTuple):
    """What a user may have got wrong, and how a log looks once it is right."""

    check: str
    joints: tuple[str, ...]  # whose errors judge it
    where: str | None
    claim: str  # what would be the case
    fix: str
    change: Change


class Case(NamedTuple):
    """Pieces of logs, their models, and which actuator drives which joint."""

    pieces: list[Piece]
    specs: list[mujoco.MjSpec]  # of each piece
    models: list[mujoco.MjModel]
    drives: dict[str, str]  # joint to actuator
    settings: LogErrors


def simple(case: Case, suspects: Sequence[str]) -> Iterator[Correction]:
    """Signs and units of the joints whose error is large."""
    for joint in suspects:
        yield from _signs(case, joint)
        yield from _units(case, (joint,), joint)
    if len(suspects) > 1:
        yield from _units(case, tuple(suspects), None)


def others(case: Case, suspects: Sequence[str]) -> Iterator[Correction]:
    """Swaps among these joints, and zeros that command and position share."""
    for pair in combinations(suspects, 2):
        yield from _swaps(case, pair)
    for joint in suspects:
        for value in case.settings.zeros:
            yield zero_of_both(case, joint, value)


def _scaled(
    case: Case, joints: Sequence[str], kinds: Sequence[str], factor: float, zero: float = 0.0
) -> Change:
    """Multiply positions, commands or both of some joints; a zero is theirs, not their speeds'."""

    def change(piece: Piece) -> Piece:
        names = [_column(case, kind, joint) for kind in kinds for joint in joints]
        columns = {
            n: factor * (piece.log.column(n) - (0.0 if n.startswith("qvel.") else zero))
            for n in names
            if n in piece.log.columns
        }
        return piece.changed(columns)

    return change


def _column(case: Case, kind: str, joint: str) -> str:
    return f"ctrl.{case.drives[joint]}" if kind == "ctrl" else f"{kind}.{joint}"


def _has_speeds(case: Case, joints: Sequence[str]) -> bool:
    return any(f"qvel.{joint}" in piece.log.columns for piece in case.pieces for joint in joints)


def _has_servos(case: Case, joints: Sequence[str]) -> bool:
    names = [case.drives[joint] for joint in joints if joint in case.drives]
    return all(
        is_joint_servo(model, model.actuator(name).id) for model in case.models for name in names
    )


def _signs(case: Case, joint: str) -> Iterator[Correction]:
    position, command = (f"`{_column(case, kind, joint)}`" for kind in ("qpos", "ctrl"))
    flips = {
        ("qpos",): (f"{position} has its sign flipped", f"Negate {position}"),
        ("ctrl",): (f"{command} has its sign flipped", f"Negate {command}"),
        ("qpos", "ctrl"): (
            f"{position} and {command} count against the model's axis",
            f"Negate both {position} and {command}, or turn the joint's axis in the model round",
        ),
    }
    for kinds, (claim, fix) in flips.items():
        yield Correction(
            "sign",
            (joint,),
            joint,
            f"It looks as if {claim}",
            f"{fix}; in a robot's file that is `sign` of its servo.",
            _scaled(case, (joint,), kinds, -1.0),
        )


class Conversion(NamedTuple):
    """A unit that angles may be in: rad = factor (number - zero).

    Args:
        check: of the finding.
        claim: what the numbers would be.
        fix: what to do about them.
        factor: rad of one.
        zero: the number at the joint's zero.
        least: the largest number is larger than this,
        most: and smaller than this.
        whole: whether all numbers are whole.
    """

    check: str
    claim: str
    fix: str
    factor: float
    zero: float = 0.0
    least: float = 0.0
    most: float = np.inf
    whole: bool = False

    def fits(self, numbers: np.ndarray) -> bool:
        """Return whether a column's numbers are of a size that this unit gives."""
        size = float(np.abs(numbers).max())
        whole = not self.whole or bool(np.all(numbers == np.round(numbers)))
        return self.least < size < self.most and whole


def _conversions(settings: LogErrors) -> Iterator[Conversion]:
    """Yield degrees, rad that were converted twice, and counts of encoders."""
    turn = settings.degrees_min
    yield Conversion("degrees", "in degrees", "Multiply them by pi/180", DEGREE, least=turn)
    twice = "divided by 57.3 once too often"
    most = settings.rad_twice_max
    yield Conversion("degrees", twice, "Multiply them by 180/pi", 1 / DEGREE, most=most)
    for counts in settings.counts:
        for zero in (0, counts // 2):
            yield Conversion(
                "unit",
                f"counts of an encoder, {counts} to a turn and {zero} at the joint's zero",
                f"Convert them: `unit: counts/{counts}` and `zero: {zero}` in a columns.yaml",
                2 * np.pi / counts,
                zero,
                least=turn,
                most=counts,
                whole=True,
            )


def _units(case: Case, joints: tuple[str, ...], where: str | None) -> Iterator[Correction]:
    """Units whose numbers are of such a size; torques are no angles."""
    whose = where or "all joints"
    for own, what in UNITS.items():
        if "qvel" in own and not _has_speeds(case, joints):
            continue
        if "ctrl" in own and not _has_servos(case, joints):
            continue
        numbers = np.concatenate(
            [
                piece.log.columns[column]
                for piece in case.pieces
                for column in (_column(case, kind, joint) for kind in own for joint in joints)
                if not column.startswith("qvel.") and column in piece.log.columns
            ]
        )
        for one in _conversions(case.settings):
            if one.fits(numbers):
                yield Correction(
                    one.check,
                    joints,
                    where,
                    f"The {what} of {whose} look as if they were {one.claim}, not in rad",
                    f"{one.fix}.",
                    _scaled(case, joints, own, one.factor, one.zero),
                )


def _swaps(case: Case, pair: tuple[str, str]) -> Iterator[Correction]:
    one, other = pair
    for kinds, what in KINDS.items():
        if len(kinds) == 1 and not _crossed(case, pair):
            continue

        def change(piece: Piece, kinds: tuple[str, ...] = kinds) -> Piece:
            columns = {}
            for kind in kinds:
                names = _column(case, kind, one), _column(case, kind, other)
                if all(name in piece.log.columns for name in names):
                    columns[names[0]] = piece.log.columns[names[1]]
                    columns[names[1]] = piece.log.columns[names[0]]
            return piece.changed(columns)

        yield Correction(
            "swap",
            pair,
            one,
            f"The {what} of {one} and {other} look swapped",
            f"Swap the {what} of {one} and {other} in the log, or their servos' ids or names.",
            change,
        )


def _crossed(case: Case, pair: tuple[str, str]) -> bool:
    """Say whether positions of a pair follow each other's commands rather than their own."""
    names = [_column(case, kind, joint) for kind in ("ctrl", "qpos") for joint in pair]
    pieces = [p for p in case.pieces if all(n in p.log.columns for n in names)]
    if not pieces:
        return False
    signals = np.concatenate([np.column_stack([p.log.columns[n] for n in names]) for p in pieces])
    if signals.std(axis=0).min() == 0:
        return False
    match = np.corrcoef(signals.T)[: len(pair), len(pair) :]
    return bool(match[0, 1] + match[1, 0] > match[0, 0] + match[1, 1])


def zero_of_both(case: Case, joint: str, value: float) -> Correction:
    """The servo itself has the wrong zero: its commands and its readings share it."""
    names = [_column(case, kind, joint) for kind in ("qpos", "ctrl")]

    def change(piece: Piece) -> Piece:
        columns = {n: piece.log.columns[n] - value for n in names if n in piece.log.columns}
        return piece.changed(columns)

    return Correction(
        "zero",
        (joint,),
        joint,
        f"The zero of {joint} looks wrong by {value:.3g}, in commands and positions alike",
        f"Calibrate the zero of {joint}; as an effect this is encoder_offset = {value:.3g}.",
        change,
    )


def shifts(case: Case, now: dict[str, float], offsets: dict[str, float]) -> Iterator[Correction]:
    """Joints whose readings alone are off by a constant."""
    for joint, value in offsets.items():
        if abs(value) < case.settings.zero_min or now[joint] < TINY:
            continue

        def change(piece: Piece, joint: str = joint, value: float = value) -> Piece:
            name = f"qpos.{joint}"
            return piece.changed({name: piece.log.columns[name] - value})

        yield Correction(
            "zero",
            (joint,),
            joint,
            f"`qpos.{joint}` reads {value:.3g} more than it should everywhere",
            f"Subtract {value:.3g} from `qpos.{joint}`, or calibrate its zero; as an effect this "
            f"is encoder_offset = {value:.3g} with servo = 0.",
            change,
        )


def rate(case: Case, factor: float) -> Correction:
    """Stamps that run too fast or too slow."""
    least = case.settings.rate_rows_min

    def change(piece: Piece) -> Piece:
        log = piece.log
        rows = max(int(np.searchsorted(log.time * factor, log.time[-1], side="right")), least)
        columns = {name: values[:rows] for name, values in log.columns.items()}
        clocks = [name for name in columns if name == "time" or name.startswith("stamp.")]
        columns |= {name: columns[name] * factor for name in clocks}
        return replace(piece, log=Log(columns, log.meta, log.path)).changed({})

    speed = "too fast" if factor > 1 else "too slowly"
    return Correction(
        "rate",
        tuple(case.drives),
        None,
        f"Time in the log seems to run {speed}, by {factor:.3g}",
        f"Multiply `time` by {factor:.3g}, or look at the rate that the log was made with.",
        change,
    )
