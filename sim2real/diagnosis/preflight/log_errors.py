"""The most common errors in logs, each tried by replaying the model under its correction.

    findings = find_log_errors(logs, specs)

Swapped joints, a flipped sign, a wrong zero, degrees for radians, a wrong rate. A correction is
named where it takes most of a joint's error away and no ordinary physical effect does: gains,
friction, delay and tilt of several sizes are replayed beside it.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from envs.effects import Effect, make
from envs.errors import EnvsError
from envs.params import ParamSpace
from hardware.log import Log
from sim2real.diagnosis.data.pairs import is_scalar
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
from sim2real.diagnosis.settings import DEFAULT, LogErrors


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
    now, offsets = _nominal(case)
    suspects = [joint for joint, error in now.items() if error > settings.suspect]
    stages = [[*simple(case, suspects), *shifts(case, now, offsets)], [*others(case, suspects)]]
    if any(error > settings.rate_suspect for error in now.values()):
        stages[1] += [rate(case, factor) for factor in settings.rates]
    judge = _Judge(case, now)
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


def _errors(case: Case, changes: Sequence[Change]) -> np.ndarray:
    """Each joint's error under each change, of its motion, (changes, joints)."""
    runs = []
    for piece, spec, model in zip(case.pieces, case.specs, case.models, strict=True):
        made = [change(piece) for change in changes]
        paths = trial(spec, [one.recording(model) for one in made])
        runs.append(list(zip(made, paths, strict=True)))
    return np.array([_relative(case, list(row)) for row in zip(*runs, strict=True)])


def _relative(case: Case, runs: Sequence[tuple[Piece, np.ndarray]]) -> list[float]:
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


def _apart(
    case: Case, runs: Sequence[tuple[Piece, np.ndarray]], joint: str
) -> list[tuple[np.ndarray, np.ndarray]]:
    """A joint's measured positions and the simulation's distance from them, by piece."""
    return [
        (
            piece.log.columns[f"qpos.{joint}"],
            path[:, model.joint(joint).qposadr[0]] - piece.log.columns[f"qpos.{joint}"],
        )
        for (piece, path), model in zip(runs, case.models, strict=True)
        if f"qpos.{joint}" in piece.log.columns
    ]


def _nominal(case: Case) -> tuple[dict[str, float], dict[str, float]]:
    """Each joint's error of its motion, and by how much it reads more than the model says."""
    runs = [
        (piece, trial(spec, [piece.recording(model)])[0])
        for piece, spec, model in zip(case.pieces, case.specs, case.models, strict=True)
    ]
    now = _relative(case, runs)
    shift = {}
    for joint in case.drives:
        errors = [error for _, error in _apart(case, runs, joint)]
        shift[joint] = -float(np.nanmedian(np.concatenate(errors))) if errors else 0.0
    return dict(zip(case.drives, now, strict=True)), shift


def _physics(case: Case) -> np.ndarray:
    """The smallest error of each joint under ordinary effects of several sizes."""
    runs = []
    for piece, spec, model in zip(case.pieces, case.specs, case.models, strict=True):
        effects, values = _panel(model, case.settings)
        rows = [piece.recording(model)] * len(values)
        runs.append([(piece, path) for path in trial(spec, rows, effects, values)])
    sizes = [_relative(case, list(row)) for row in zip(*runs, strict=False)]
    return np.min(sizes, axis=0)


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


class _Judge:
    """Tries corrections, and keeps those that nothing ordinary explains as well.

    Args:
        case: what to try them on.
        now: each joint's error as the log is.
    """

    def __init__(self, case: Case, now: dict[str, float]) -> None:
        self.found: list[Finding] = []
        self.taken: set[str] = set()  # joints that a finding is about
        self.tried: list[Correction] = []
        self.errors = np.zeros((0, len(now)))  # of each correction and joint
        self._case, self._index = case, list(now)
        self._before = np.array(list(now.values()))
        self._rivals: np.ndarray | None = None

    def evaluate(self, tried: Sequence[Correction]) -> None:
        """Try corrections, the one that gains most first, at most one for each joint."""
        if not tried:
            return
        errors = _errors(self._case, [correction.change for correction in tried])
        self.tried, self.errors = [*self.tried, *tried], np.vstack([self.errors, errors])
        gains = np.sum(self._before**2) - np.sum(errors**2, axis=1)
        for k in np.argsort(-gains):
            if self.taken.isdisjoint(tried[k].joints) and self._holds(tried[k], errors[k]):
                self.taken |= set(tried[k].joints)
                self.found.append(self._finding(tried[k], errors[k]))

    def _holds(self, correction: Correction, after: np.ndarray) -> bool:
        before, own, limits = self._before, self._own(correction), self._case.settings
        old, new = self._size(before, own), self._size(after, own)
        rest = np.delete(np.arange(len(before)), own)
        if np.any(after[rest] > limits.harm_factor * before[rest] + limits.harm_slack):
            return False  # it harms the others
        if correction.check == "rate":
            moved = before > limits.rate_joint
            if np.mean(after[moved] < limits.beats * before[moved]) < limits.rate_joints:
                return False  # a clock is the same for all joints
        closed = limits.closed if old > limits.suspect else limits.closed_small
        if new >= min(closed * old, limits.left_max):
            return False
        return new < limits.beats * self._size(self._physics(), own)

    def best(self, check: str, where: str | None, values: Sequence[float]) -> float | None:
        """Return the value of the best correction of a kind that was tried, if it does any good.

        The last ones of that kind and place have these values, in this order.
        """
        rows = [k for k, c in enumerate(self.tried) if (c.check, c.where) == (check, where)]
        rows = rows[-len(values) :]
        if len(rows) < len(values):
            return None
        own = self._own(self.tried[rows[0]])
        sizes = [self._size(self.errors[k], own) for k in rows]
        k = int(np.argmin(sizes))
        most = self._case.settings.promising * self._size(self._before, own)
        return values[k] if sizes[k] < most else None

    def _physics(self) -> np.ndarray:
        if self._rivals is None:
            self._rivals = _physics(self._case)
        return self._rivals

    def _own(self, correction: Correction) -> np.ndarray:
        return np.array([self._index.index(joint) for joint in correction.joints])

    @staticmethod
    def _size(errors: np.ndarray, own: np.ndarray) -> float:
        return float(np.sqrt(np.mean(errors[own] ** 2)))

    def _finding(self, correction: Correction, after: np.ndarray) -> Finding:
        own = self._own(correction)
        old, new, rival = (self._size(e, own) for e in (self._before, after, self._physics()))
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
