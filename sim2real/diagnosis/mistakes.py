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
from sim2real.diagnosis.corrections import (
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
from sim2real.diagnosis.report import Finding
from sim2real.diagnosis.trial import Piece, choose, trial

SECONDS, PIECES = 5.0, 4  # of a replay, and how many
SUSPECT = 0.3  # of a joint's own motion: an error that a mistake could have made
LATE = 0.1  # the same for a wrong rate, which slow motions hide
CLOSED, BEATS = 0.4, 0.6  # of the error as it is, and of the best physical effect's
SURE = 0.25  # the first of these where the error is no SUSPECT
LEAST = 0.03  # rad or m: a joint that moves less counts as moving this much
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
    slow = tuple(joint for joint, error in now.items() if error > LATE)
    stages = [[*simple(case, suspects), *shifts(case, now, offsets)], [*others(case, suspects)]]
    stages[1] += [rate(slow, factor) for factor in RATES] if slow else []
    if not any(stages):
        return []
    physics, found = _physics(case), []
    for tried in stages:
        errors = _errors(case, [c.change for c in tried]) if tried else np.zeros((0, 0))
        found += _judge(case, tried, errors, now, physics)
        if found and set(suspects) <= {joint for joints, _ in found for joint in joints}:
            break
    else:
        if not found:
            tried = _finer(case, suspects, tried, errors)
            errors = _errors(case, [c.change for c in tried]) if tried else errors[:0]
            found = _judge(case, tried, errors, now, physics)
    return [finding for _, finding in found]


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


def _physics(case: Case) -> dict[str, float]:
    """The smallest error of each joint under ordinary effects of several sizes."""
    runs = []
    for piece, spec, model in zip(case.pieces, case.specs, case.models, strict=True):
        effects, values = _panel(model)
        rows = [piece.recording(model)] * len(values)
        runs.append([(piece, path) for path in trial(spec, rows, effects, values)])
    sizes = [_relative(case, list(row)) for row in zip(*runs, strict=False)]
    return dict(zip(case.drives, np.min(sizes, axis=0).tolist(), strict=True))


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


def _finer(
    case: Case, suspects: Sequence[str], tried: Sequence[Correction], errors: np.ndarray
) -> list[Correction]:
    """Values between those that were tried, around the best rate and the best zero of a joint."""
    index = list(case.drives)
    found: list[Correction] = []
    rates = [k for k, c in enumerate(tried) if c.check == "rate"]
    if rates:
        joints = tried[rates[0]].joints
        columns = [index.index(joint) for joint in joints]
        best = min(rates, key=lambda k: errors[k][columns].mean())
        middle = RATES[rates.index(best)]
        found += [rate(joints, middle * f) for f in (0.85, 0.9, 0.95, 1.05, 1.1, 1.15)]
    for joint in suspects:
        zeros = [k for k, c in enumerate(tried) if c.check == "zero" and c.where == joint][
            : len(ZEROS)
        ]
        if zeros:
            best = min(zeros, key=lambda k: errors[k][index.index(joint)])
            middle = ZEROS[zeros.index(best)]
            found += [zero_of_both(case, joint, middle * f) for f in (0.6, 0.75, 0.88, 1.12, 1.3)]
    return found


def _judge(
    case: Case,
    tried: Sequence[Correction],
    errors: np.ndarray,
    now: dict[str, float],
    physics: dict[str, float],
) -> list[tuple[tuple[str, ...], Finding]]:
    """Return findings for the corrections that hold, at most one for each joint, and the joints."""
    index, before = list(case.drives), np.array(list(now.values()))
    rivals = np.array(list(physics.values()))
    held = []
    for correction, after in zip(tried, errors, strict=True):
        own = np.array([index.index(joint) for joint in correction.joints])
        old, new, rival = (float(np.sqrt(np.mean(e[own] ** 2))) for e in (before, after, rivals))
        others = np.delete(np.arange(len(index)), own)
        harm = np.any(after[others] > 1.2 * before[others] + 0.1)
        closed = CLOSED if old > SUSPECT else SURE
        if new < closed * old and new < BEATS * rival and not harm:
            gain = float(np.sum(before**2) - np.sum(after**2))
            held.append((gain, correction, old, new, rival))
    held.sort(key=lambda item: -item[0])
    taken: set[str] = set()
    found = []
    for _, correction, old, new, rival in held:
        if taken.isdisjoint(correction.joints):
            taken |= set(correction.joints)
            found.append((correction.joints, _finding(correction, old, new, rival)))
    return found


def _finding(correction: Correction, old: float, new: float, rival: float) -> Finding:
    text = (
        f"{correction.claim}. Once that is corrected the replay's error falls from {old:.0%} to "
        f"{new:.0%} of the motion, and no ordinary gain, friction, delay or tilt gets it below "
        f"{rival:.0%}."
    )
    return Finding(correction.check, correction.where, text, correction.fix)
