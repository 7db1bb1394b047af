"""Whether a gap, or what closes it, is the simulator's own doing and not the robot's.

    test = null_test(logs, specs)
    test.words                                      # {"timestep": "ok", "friction": "…", ...}
    is_numerics(logs, specs, cause, test)           # None, or why the cause is none

Four things that no robot has are changed in the model: half the timestep, a tighter solver, dry
friction that does not creep (`solimpfriction`; MuJoCo's default lets a joint that is held by
friction drift, 1.4 degrees in 10 s), and a little armature on joints without any. A gap that
changes with them is partly numerics, and so is an effect whose gain vanishes once they are set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects import combined
from envs.effects.friction import STIFF_SOLIMP
from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.data.trial import Piece, choose, trial

SECONDS, PIECES = 5.0, 4  # of a replay, and how many
CHANGES = 0.1  # of the gap: a smaller change is none
TINY = 0.005  # of the motion: nobody minds less
GONE = 0.25  # of an effect's gain that has to be left for it to be physics
INERTIA = 5e-4  # kg m^2: of the smallest servos, XL-320 1.1e-3
LEAST = 0.03  # rad or m: a joint that moves less counts as moving this much
WORST = 5.0  # of a joint's motion: larger errors count as this


class NullTest(NamedTuple):
    """What the replayed gap does when the simulator's numerics are made better.

    Args:
        gap: as the model is given, of the joints' motion.
        gaps: the same with each change.
        moved: how far the replay moves with each change, of the joints' motion.
        words: "ok", or what was found, by the name of the change.
    """

    gap: float
    gaps: Mapping[str, float]
    moved: Mapping[str, float]
    words: Mapping[str, str]

    @property
    def needed(self) -> tuple[str, ...]:
        """The changes without which the replay is not to be trusted."""
        return tuple(name for name, word in self.words.items() if word != "ok")


def null_test(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], fixed: Sequence[Fixed] = ()
) -> NullTest:
    """Replay pieces of logs in models with better numerics.

    Args:
        logs: the logs.
        specs: the model of each.
        fixed: effects that are in the model already.
    """
    pieces = choose(logs, SECONDS, PIECES)
    if not pieces:
        return NullTest(0.0, {}, {}, {})
    gap, nominal = _replayed(pieces, specs, fixed)
    gaps, moved, words = {}, {}, {}
    for name, (_, what) in VARIANTS.items():
        if all(not _applies(name, specs[one.number]) for one in pieces):
            continue
        changed = [better(spec, (name,)) for spec in specs]
        gaps[name], paths = _replayed(pieces, changed, fixed)
        moved[name] = _distance(pieces, specs, nominal, paths)
        words[name] = _words(what, gap, gaps[name], moved[name])
        if name == "armature" and (words["timestep"] == "ok" or gaps[name] > gap):
            words[name] = "ok"  # inertia is physics, unless the step is too long without it
    return NullTest(gap, gaps, moved, words)


def better(spec: mujoco.MjSpec, names: Sequence[str]) -> mujoco.MjSpec:
    """Return a copy of a model with these changes of `null_test`."""
    copy = spec.copy()
    for name in names:
        VARIANTS[name][0](copy)
    return copy


def is_numerics(
    logs: Sequence[Log],
    specs: Sequence[mujoco.MjSpec],
    cause: Sequence[Fixed],
    test: NullTest,
    fixed: Sequence[Fixed] = (),
) -> str | None:
    """Say whether what an effect gains vanishes in models with better numerics.

    Args:
        logs: the logs.
        specs: the model of each.
        cause: the effect with its fitted values.
        test: of the same logs and models, with the same `fixed`: what a stiff model hides shows
            once its gain is right.
        fixed: effects that are in the model besides.

    Returns:
        A sentence, or None where the gain stays.
    """
    if not test.needed:
        return None
    pieces = choose(logs, SECONDS, PIECES)
    clean = [better(spec, test.needed) for spec in specs]
    given, mended = (
        [_replayed(pieces, models, combined(fixed, more))[0] for more in ((), cause)]
        for models in (specs, clean)
    )
    gain, left = given[0] - given[1], mended[0] - mended[1]
    if gain <= 0 or left >= GONE * gain or mended[0] > given[0]:
        return None
    changes = " and ".join(VARIANTS[name][1] for name in test.needed)
    return (
        f"It closes {gain / given[0]:.0%} of the gap in the model as given, and "
        f"{max(left, 0.0) / mended[0]:.0%} with {changes}: this is the simulator's numerics, "
        "not the robot."
    )


def _words(what: str, gap: float, changed: float, moved: float) -> str:
    if moved < max(CHANGES * gap, TINY) or (abs(changed - gap) < CHANGES * gap and moved < gap):
        return "ok"
    if gap < TINY:
        return f"with {what} the replay moves by {moved:.3g} of the motion: put that into the model"
    less = "smaller" if changed < gap else "larger"
    return (
        f"with {what} the gap is {abs(changed / gap - 1):.0%} {less} ({gap:.3g} to {changed:.3g} "
        f"of the motion; the replay moves by {moved:.3g}): put that into the model first"
    )


def _replayed(
    pieces: Sequence[Piece], specs: Sequence[mujoco.MjSpec], fixed: Sequence[Fixed]
) -> tuple[float, list[np.ndarray]]:
    """The gap of all pieces, and what was simulated."""
    paths, sizes = [], []
    for one in pieces:
        spec = specs[one.number]
        model = spec.copy().compile()
        paths.append(trial(spec, [one.recording(model)], fixed=fixed)[0])
        for joint, place in _joints(one, model):
            measured = one.log.column(f"qpos.{joint}")
            sizes.append(_size(paths[-1][:, place] - measured, measured))
    return float(np.sqrt(np.mean(np.square(sizes)))) if sizes else 0.0, paths


def _distance(
    pieces: Sequence[Piece],
    specs: Sequence[mujoco.MjSpec],
    one: Sequence[np.ndarray],
    other: Sequence[np.ndarray],
) -> float:
    """How far two sets of replays are apart, of the joints' motion."""
    sizes = []
    for cut, before, after in zip(pieces, one, other, strict=True):
        model = specs[cut.number].copy().compile()
        for joint, place in _joints(cut, model):
            sizes.append(_size(after[:, place] - before[:, place], cut.log.column(f"qpos.{joint}")))
    return float(np.sqrt(np.mean(np.square(sizes)))) if sizes else 0.0


def _size(error: np.ndarray, measured: np.ndarray) -> float:
    size = float(np.sqrt(np.mean(error**2)) / max(measured.std(), LEAST))
    return min(size, WORST) if np.isfinite(size) else WORST


def _joints(one: Piece, model: mujoco.MjModel) -> list[tuple[str, int]]:
    """The logged hinges and slides, and where they stand in qpos."""
    names = [(model.joint(i).name, int(model.jnt_qposadr[i])) for i in range(model.njnt)]
    return [(name, place) for name, place in names if f"qpos.{name}" in one.log.columns]


def _applies(name: str, spec: mujoco.MjSpec) -> bool:
    """Say whether a change does anything to a model."""
    if name == "friction":
        return any(joint.frictionloss > 0 for joint in spec.joints)
    if name == "armature":
        return any(joint.armature == 0 for joint in _scalars(spec))
    return True


def _scalars(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return [joint for joint in spec.joints if joint.type in kinds]


def _half_step(spec: mujoco.MjSpec) -> None:
    spec.option.timestep /= 2
    for actuator in spec.actuators:
        if actuator.delay > 0:
            needed = int(np.ceil(actuator.delay / spec.option.timestep)) + 2
            actuator.nsample = max(actuator.nsample, needed)


def _tight(spec: mujoco.MjSpec) -> None:
    option = spec.option
    option.tolerance, option.ls_tolerance = min(option.tolerance, 1e-12), 1e-6
    option.iterations, option.ls_iterations = 4 * option.iterations, 4 * option.ls_iterations


def _stiff(spec: mujoco.MjSpec) -> None:
    for joint in spec.joints:
        joint.solimp_friction = np.array(STIFF_SOLIMP)


def _inertia(spec: mujoco.MjSpec) -> None:
    for joint in _scalars(spec):
        if joint.armature == 0:
            joint.armature = INERTIA


VARIANTS: dict[str, tuple[Callable[[mujoco.MjSpec], None], str]] = {
    "timestep": (_half_step, "half the timestep"),
    "solver": (_tight, "a tighter solver"),
    "friction": (_stiff, 'solimpfriction="0.9999 0.9999 0.001"'),
    "armature": (_inertia, f"an armature of {INERTIA:g} kg m^2 on joints without any"),
}
