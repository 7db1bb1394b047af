"""The commonest mistakes of all, each tried by replaying the model under its correction.

    findings = find_mistakes(logs, specs)

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
from sim2real.diagnosis.data.trial import Piece, choose, trial
from sim2real.diagnosis.preflight.corrections import (
    ZEROS,
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

SECONDS, PIECES = 4.0, 4  # of a replay, and how many
SUSPECT = 0.3  # of a joint's own motion: an error that a mistake could have made
LATE = 0.1  # the same for a wrong rate, which slow motions hide
CLOSED, BEATS = 0.4, 0.6  # of the error as it is, and of the best physical effect's
PROMISING = 0.8  # of the error: values around one that leaves more are not looked at
MOST = 0.7  # of the joints have to move nearer under another rate
SURE = 0.25  # the first of these where the error is no SUSPECT
LEAST = 0.03  # rad or m: a joint that moves less counts as moving this much
SENSE = 0.7  # of a joint's motion: a correction that leaves more has not put it right
WORST = 5.0  # of a joint's motion: larger errors count as this
RATES = (0.1, 0.2, 0.25, 1 / 3, 0.5, 2 / 3, 0.8, 1.25, 1.5, 2.0, 3.0, 4.0, 5.0, 10.0)


def find_mistakes(logs: Sequence[Log], specs: Sequence[mujoco.MjSpec]) -> list[Finding]:
    """Return the mistakes that explain much of the gap, and that physics does not.

    Args:
        logs: the logs.
        specs: the model of each.
    """
    case = _case(logs, specs)
    if not case.pieces or not case.drives:
        return []
    now, offsets = _nominal(case)
    suspects = [joint for joint, error in now.items() if error > SUSPECT]
    stages = [[*simple(case, suspects), *shifts(case, now, offsets)], [*others(case, suspects)]]
    if any(error > LATE for error in now.values()):
        stages[1] += [rate(tuple(case.drives), factor) for factor in RATES]
    judge = _Judge(case, now)
    for tried in filter(None, stages):
        judge.hear(tried)
        if judge.found and set(suspects) <= judge.taken:
            break
    if stages[1] and not judge.found:
        judge.hear(_finer(case, suspects, judge))
    return judge.found


def _case(logs: Sequence[Log], specs: Sequence[mujoco.MjSpec]) -> Case:
    models: dict[int, mujoco.MjModel] = {}
    for spec in specs:
        if id(spec) not in models:
            models[id(spec)] = spec.copy().compile()
    pieces = choose(logs, SECONDS, PIECES)
    own = [specs[piece.number] for piece in pieces]
    drives = {}
    for log, spec in zip(logs, specs, strict=True):
        drives |= _drives(models[id(spec)], log)
    return Case(pieces, own, [models[id(spec)] for spec in own], drives)


def _drives(model: mujoco.MjModel, log: Log) -> dict[str, str]:
    """Which logged actuator drives which logged hinge or slide."""
    found = {}
    for i in range(model.nu):
        joint = int(model.actuator_trnid[i, 0])
        of_joint = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        if of_joint and int(model.jnt_type[joint]) in (2, 3):
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
        size = float(np.sqrt(np.mean(error**2)) / max(measured.std(), LEAST))
        sizes.append(min(size, WORST) if np.isfinite(size) else WORST)
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
        effects, values = _panel(model)
        rows = [piece.recording(model)] * len(values)
        runs.append([(piece, path) for path in trial(spec, rows, effects, values)])
    sizes = [_relative(case, list(row)) for row in zip(*runs, strict=False)]
    return np.min(sizes, axis=0)


def _panel(model: mujoco.MjModel) -> tuple[list[Effect], np.ndarray]:
    """Ordinary effects, and rows of values in which one of them is at work."""
    limits = model.actuator_forcerange[:, 1][model.actuator_forcelimited.astype(bool)]
    force = float(np.median(limits)) if limits.size else 1.0
    wanted = {
        "position_gain": [(0.03,), (0.1,), (0.25,), (0.5,), (2.0,), (4.0,)],
        "command_delay": [(0.02,), (0.05,), (0.1,)],
        "coulomb_friction": [(0.05 * force,), (0.2 * force,), (0.5 * force,)],
        "viscous_friction": [(0.05 * force,), (0.2 * force,), (force,)],
        "profile_velocity": [(0.5,), (2.0,)],
        "profile_acceleration": [(2.0,), (4.0,), (6.0,), (10.0,), (30.0,)],
        "gravity_tilt": [(-0.4, 0.0), (0.4, 0.0), (0.0, -0.4), (0.0, 0.4)],
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

    def hear(self, tried: Sequence[Correction]) -> None:
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
        before, own = self._before, self._own(correction)
        old, new = self._size(before, own), self._size(after, own)
        rest = np.delete(np.arange(len(before)), own)
        if np.any(after[rest] > 1.2 * before[rest] + 0.1):
            return False  # it harms the others
        if correction.check == "rate":
            moved = before > LATE / 3
            if np.mean(after[moved] < BEATS * before[moved]) < MOST:
                return False  # a clock is the same for all joints
        if new >= min((CLOSED if old > SUSPECT else SURE) * old, SENSE):
            return False
        return new < BEATS * self._size(self._physics(), own)

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
        return values[k] if sizes[k] < PROMISING * self._size(self._before, own) else None

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
    middle = judge.best("rate", None, RATES)
    if middle is not None:
        found += [rate(tuple(case.drives), middle * f) for f in (0.85, 0.9, 0.95, 1.05, 1.1, 1.15)]
    for joint in suspects:
        middle = judge.best("zero", joint, ZEROS)
        if middle is not None:
            found += [zero_of_both(case, joint, middle * f) for f in (0.6, 0.75, 0.88, 1.12, 1.3)]
    return found
