"""The most common errors in logs, each tried by replaying the model under its correction.

    findings = find_log_errors(logs, specs)

Swapped joints, a flipped sign, a wrong zero, degrees for radians, a wrong rate. A correction is
named where it takes most of a joint's error away and no ordinary physical effect does: gains,
friction, delay and tilt of several sizes are replayed beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects import Effect, make
from envs.errors import EnvsError
from envs.params import ParamSpace
from hardware.log import Log
from sim2real.diagnosis.data.pairs import is_scalar
from sim2real.diagnosis.data.recording import rows_of
from sim2real.diagnosis.data.trial import Piece, choose, trial
from sim2real.diagnosis.preflight.corrections import (
    Case,
    Change,
    Correction,
    others,
    rate,
    shifts,
    simple,
    zero_of_both,
)
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY, LogErrors

UNIT_CHECKS = ("degrees", "unit")
Run = tuple[Piece, np.ndarray]  # what a log has, and positions in the order of the model, (T, nq)


def find_log_errors(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], settings: LogErrors = DEFAULT.log_errors
) -> list[Finding]:
    """Return the errors in logs that explain much of the gap, and that physics does not.

    Args:
        logs: the logs.
        specs: the model of each.
        settings: what is tried, and what convinces.
    """
    case = case_of(logs, specs, settings)
    if not case.pieces or not case.drives:
        return []
    runs = _nominal(case)
    now = dict(zip(case.drives, _relative(case, runs), strict=True))
    suspects = [joint for joint, error in now.items() if error > settings.suspect]
    stages = [
        [*simple(case, suspects), *shifts(case, now, _offsets(case, runs))],
        [*others(case, suspects)],
    ]
    if any(error > settings.rate_suspect for error in now.values()):
        stages[1] += [rate(case, factor) for factor in settings.rates]
    judge = _Judge(case, runs)
    for tried in filter(None, stages):
        judge.evaluate(tried)
        if judge.found and set(suspects) <= judge.taken:
            break
    if stages[1] and not judge.found:
        judge.evaluate(_finer(case, suspects, judge))
    return judge.found


def case_of(logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], settings: LogErrors) -> Case:
    """Return pieces of logs, with what a correction needs to know of their models."""
    models: dict[int, mujoco.MjModel] = {}
    for spec in specs:
        if id(spec) not in models:
            models[id(spec)] = spec.copy().compile()
    pieces = choose(logs, settings.piece_s, settings.pieces)
    own = [specs[piece.number] for piece in pieces]
    drives = {}
    for log, spec in zip(logs, specs, strict=True):
        drives |= _drives(models[id(spec)], log)
    return Case(pieces, own, [models[id(spec)] for spec in own], drives, settings)


def _drives(model: mujoco.MjModel, log: Log) -> dict[str, str]:
    """Which logged actuator drives which logged hinge or slide."""
    found = {}
    for i in range(model.nu):
        joint = int(model.actuator_trnid[i, 0])
        of_joint = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        if of_joint and is_scalar(model, joint):
            name, actuator = model.joint(joint).name, model.actuator(i).name
            if f"qpos.{name}" in log.columns and actuator in log.actuators:
                found[name] = actuator
    return found


def _errors(case: Case, changes: Sequence[Change]) -> tuple[np.ndarray, np.ndarray]:
    """Each joint's error under each change, of its motion, (changes, joints); rows of each piece.

    A change of the rate keeps a piece's first rows: (changes, pieces) of them.
    """
    runs, rows = [], []
    for piece, spec, model in zip(case.pieces, case.specs, case.models, strict=True):
        made = [change(piece) for change in changes]
        paths = trial(spec, [one.recording(model) for one in made])
        runs.append(list(zip(made, paths, strict=True)))
        rows.append([len(one.log) for one in made])
    errors = [_relative(case, list(row)) for row in zip(*runs, strict=True)]
    return np.array(errors), np.transpose(rows)


def _first(runs: Sequence[Run], rows: np.ndarray) -> list[Run]:
    """Return the first rows of each piece, of which `rows` (pieces,) says how many."""
    return [
        (replace(piece, log=rows_of(piece.log, 0, count)), path[:count])
        for (piece, path), count in zip(runs, map(int, rows), strict=True)
    ]


def _relative(case: Case, runs: Sequence[Run]) -> list[float]:
    """The RMS error of each joint over all pieces, of its motion in them."""
    sizes = []
    for joint in case.drives:
        pairs = _apart(case, runs, joint)
        if not pairs:
            sizes.append(0.0)
            continue
        measured, error = (np.concatenate(both) for both in zip(*pairs, strict=True))
        size = float(np.sqrt(np.mean(error**2)) / max(measured.std(), case.settings.motion_min))
        worst = case.settings.error_max
        sizes.append(min(size, worst) if np.isfinite(size) else worst)
    return sizes


def _apart(case: Case, runs: Sequence[Run], joint: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """A joint's measured positions and the simulation's distance from them, by piece."""
    return [
        (
            piece.log.columns[f"qpos.{joint}"],
            path[:, model.joint(joint).qposadr[0]] - piece.log.columns[f"qpos.{joint}"],
        )
        for (piece, path), model in zip(runs, case.models, strict=True)
        if f"qpos.{joint}" in piece.log.columns
    ]


def _nominal(case: Case) -> list[Run]:
    """The pieces as the log has them; like corrected ones they start with their slopes.

    A speed that is logged may be wrong itself, which is another mistake than those tried here.
    """
    return [
        (piece, trial(spec, [piece.changed({}).recording(model)])[0])
        for piece, spec, model in zip(case.pieces, case.specs, case.models, strict=True)
    ]


def _offsets(case: Case, runs: Sequence[Run]) -> dict[str, float]:
    """By how much each joint reads more than the model says."""
    shift = {}
    for joint in case.drives:
        errors = [error for _, error in _apart(case, runs, joint)]
        shift[joint] = -float(np.nanmedian(np.concatenate(errors))) if errors else 0.0
    return shift


def _physics(case: Case) -> list[list[Run]]:
    """The pieces under ordinary effects of several sizes, one list for each size."""
    runs = []
    for piece, spec, model in zip(case.pieces, case.specs, case.models, strict=True):
        effects, values = _panel(model, case.settings)
        rows = [piece.changed({}).recording(model)] * len(values)
        runs.append([(piece, path) for path in trial(spec, rows, effects, values)])
    return [list(row) for row in zip(*runs, strict=False)]


def _panel(model: mujoco.MjModel, settings: LogErrors) -> tuple[list[Effect], np.ndarray]:
    """Ordinary effects, and rows of values in which one of them is at work."""
    limits = model.actuator_forcerange[:, 1][model.actuator_forcelimited.astype(bool)]
    force = float(np.median(limits)) if limits.size else 1.0
    tilt = settings.tilt
    wanted = {
        "position_gain": [(gain,) for gain in settings.gains],
        "command_delay": [(delay,) for delay in settings.delays_s],
        "coulomb_friction": [(share * force,) for share in settings.dry_friction],
        "viscous_friction": [(share * force,) for share in settings.viscous_friction],
        "profile_velocity": [(limit,) for limit in settings.speed_limits],
        "profile_acceleration": [(limit,) for limit in settings.acceleration_limits],
        "gravity_tilt": [(-tilt, 0.0), (tilt, 0.0), (0.0, -tilt), (0.0, tilt)],
    }
    effects: list[Effect] = []
    for name in wanted:
        try:
            effect = make(name)
            effect.parameters(model)
        except EnvsError:
            continue  # this robot cannot have it
        effects.append(effect)
    own = [effect.parameters(model) for effect in effects]
    space = ParamSpace([p for parameters in own for p in parameters])
    starts = np.cumsum([0, *(len(parameters) for parameters in own)])
    rows = [space.points(1)[0]]
    for effect, start in zip(effects, starts, strict=False):
        for values in wanted[effect.name]:
            row = space.points(1)[0]
            row[start : start + len(values)] = values
            rows.append(row)
    return effects, np.clip(rows, space.low, space.high)


class _Tried(NamedTuple):
    """A correction, and each joint's error without and with it in the rows that it keeps."""

    correction: Correction
    before: np.ndarray  # (joints,)
    after: np.ndarray  # (joints,)
    rows: np.ndarray  # of each piece, (pieces,)


class _Judge:
    """Tries corrections, and keeps those that nothing ordinary explains as well.

    Each is held against the log as it is, and against ordinary effects, in the same rows.

    Args:
        case: what to try them on.
        runs: the pieces as the log has them.
    """

    def __init__(self, case: Case, runs: Sequence[Run]) -> None:
        self.found: list[Finding] = []
        self.taken: set[str] = set()  # joints that a finding is about
        self.tried: list[_Tried] = []
        self._case, self._index, self._nominal = case, list(case.drives), runs
        self._panel: list[list[Run]] | None = None
        # errors as the log is and under ordinary effects, by rows of each piece
        self._before: dict[tuple[int, ...], np.ndarray] = {}
        self._rivals: dict[tuple[int, ...], np.ndarray] = {}

    def evaluate(self, tried: Sequence[Correction]) -> None:
        """Try corrections, the one that gains most first, at most one for each joint."""
        if not tried:
            return
        errors, rows = _errors(self._case, [correction.change for correction in tried])
        made = [
            _Tried(correction, self._without(own), after, own)
            for correction, after, own in zip(tried, errors, rows, strict=True)
        ]
        self.tried += made
        for one in sorted(made, key=lambda one: np.sum(one.after**2) - np.sum(one.before**2)):
            if self.taken.isdisjoint(one.correction.joints) and self._holds(one):
                self.taken |= set(one.correction.joints)
                self.found.append(self._finding(one))

    def _holds(self, tried: _Tried) -> bool:
        correction, before, after, _ = tried
        own, limits = self._own(correction), self._case.settings
        old, new = self._size(before, own), self._size(after, own)
        rest = np.delete(np.arange(len(before)), own)
        if np.any(after[rest] > limits.harm_factor * before[rest] + limits.harm_slack):
            return False  # it harms the others
        if correction.check == "rate":
            moved = before > limits.rate_joint
            mended = after[moved] < limits.beats * before[moved]
            if not mended.size or np.mean(mended) < limits.rate_joints:
                return False  # a clock is the same for all joints
        closed = limits.closed if old > limits.suspect else limits.closed_small
        most = min(closed * old, limits.left_max)
        if correction.check in UNIT_CHECKS:  # numbers that are too large gain by any smaller unit
            most = limits.unit_left * min(old, 1.0)
        if new >= most:
            return False
        return new < limits.beats * self._size(self._physics(tried.rows), own)

    def best(self, check: str, where: str | None, values: Sequence[float]) -> float | None:
        """Return the value of the best correction of a kind that was tried, if it does any good.

        The last ones of that kind and place have these values, in this order.
        """
        kind = [t for t in self.tried if (t.correction.check, t.correction.where) == (check, where)]
        kind = kind[-len(values) :]
        if len(kind) < len(values):
            return None
        own = self._own(kind[0].correction)
        left = [self._size(t.after, own) / max(self._size(t.before, own), TINY) for t in kind]
        k = int(np.argmin(left))
        return values[k] if left[k] < self._case.settings.promising else None

    def _without(self, rows: np.ndarray) -> np.ndarray:
        """The error of each joint as the log is, in the first rows of pieces."""
        key = tuple(map(int, rows))
        if key not in self._before:
            self._before[key] = np.array(_relative(self._case, _first(self._nominal, rows)))
        return self._before[key]

    def _physics(self, rows: np.ndarray) -> np.ndarray:
        """The smallest error of each joint under ordinary effects, in the first rows of pieces."""
        if self._panel is None:
            self._panel = _physics(self._case)
        key = tuple(map(int, rows))
        if key not in self._rivals:
            sizes = [_relative(self._case, _first(runs, rows)) for runs in self._panel]
            self._rivals[key] = np.min(sizes, axis=0)
        return self._rivals[key]

    def _own(self, correction: Correction) -> np.ndarray:
        return np.array([self._index.index(joint) for joint in correction.joints])

    @staticmethod
    def _size(errors: np.ndarray, own: np.ndarray) -> float:
        return float(np.sqrt(np.mean(errors[own] ** 2)))

    def _finding(self, tried: _Tried) -> Finding:
        correction, before, after, rows = tried
        own = self._own(correction)
        old, new, rival = (self._size(e, own) for e in (before, after, self._physics(rows)))
        text = (
            f"{correction.claim}. Once that is corrected the replay's error falls from {old:.0%} "
            f"to {new:.0%} of the motion, and no ordinary gain, friction, delay or tilt gets it "
            f"below {rival:.0%}."
        )
        return Finding(correction.check, correction.where, text, correction.fix)


def _finer(case: Case, suspects: Sequence[str], judge: _Judge) -> list[Correction]:
    """Values between those that were tried, around the best rate and the best zero of a joint."""
    found: list[Correction] = []
    middle = judge.best("rate", None, case.settings.rates)
    if middle is not None:
        found += [rate(case, middle * factor) for factor in case.settings.finer_rates]
    for joint in suspects:
        middle = judge.best("zero", joint, case.settings.zeros)
        if middle is not None:
            finer = case.settings.finer_zeros
            found += [zero_of_both(case, joint, middle * factor) for factor in finer]
    return found
