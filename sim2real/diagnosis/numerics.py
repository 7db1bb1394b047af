"""Whether a gap, or what closes it, is the simulator's own doing and not the robot's.

    test = null_test(logs, specs)
    test.words                                      # {"timestep": "ok", "friction": "…", ...}
    is_numerics(logs, specs, cause, test)           # None, or why the cause is none

Four things that no robot has are changed in the model: half the timestep, a tighter solver, dry
friction that does not creep (`solimpfriction`; MuJoCo's default lets a joint that is held by
friction drift, 1.4 degrees in 10 s), and a little armature on joints without any. A gap that
changes with them is partly numerics, and so is an effect whose gain vanishes once they are set.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects import merge_effects
from envs.effects.friction import STIFF_SOLIMP
from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.data.recording import shorten
from sim2real.diagnosis.data.trial import Piece, choose, trial
from sim2real.diagnosis.settings import DEFAULT, Numerics, Settings

ARMATURE = 5e-4  # kg m^2: below that of the smallest servo (XL-320, 1.1e-3)
FINE = float(np.finfo(float).eps)  # improvement below which a solver has nothing left to do


class NullTest(NamedTuple):
    """What the replayed gap does when the simulator's numerics are made better.

    Args:
        gap: the gap with the model as given, relative to the joints' motion.
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
        """Numerical changes without which the replay is inaccurate."""
        return tuple(name for name, word in self.words.items() if word != "ok")


def null_test(
    logs: Sequence[Log],
    specs: Sequence[mujoco.MjSpec],
    fixed: Sequence[Fixed] = (),
    settings: Settings = DEFAULT,
) -> NullTest:
    """Replay pieces of logs in models with better numerics.

    Args:
        logs: the logs.
        specs: the model of each.
        fixed: effects that are in the model already.
        settings: the changes, and which of their results count.
    """
    pieces = choose(logs, settings.simulation.piece_s, settings.simulation.pieces)
    if not pieces:
        return NullTest(0.0, {}, {}, {})
    gap, nominal = _replayed(pieces, specs, fixed, settings)
    gaps, moved, words = {}, {}, {}
    for name in VARIANTS:
        if all(not _applies(name, specs[one.number]) for one in pieces):
            continue
        changed = [better(spec, (name,)) for spec in specs]
        gaps[name], paths = _replayed(pieces, changed, fixed, settings)
        moved[name] = _distance(pieces, specs, nominal, paths, settings)
        words[name] = _words(VARIANTS[name][1], gap, gaps[name], moved[name], settings.numerics)
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
    settings: Settings = DEFAULT,
) -> str | None:
    """Say whether what an effect gains vanishes in models with better numerics.

    Args:
        logs: the logs.
        specs: the model of each.
        cause: the effect with its fitted values.
        test: of the same logs and models, with the same `fixed`: what a stiff model hides shows
            once its gain is right.
        fixed: effects that are in the model besides.
        settings: those of the test.

    Returns:
        A sentence, or None where the gain stays.
    """
    if not test.needed:
        return None
    pieces = choose(logs, settings.simulation.piece_s, settings.simulation.pieces)
    clean = [better(spec, test.needed) for spec in specs]
    given, mended = (
        [_replayed(pieces, models, merge_effects(fixed, more), settings)[0] for more in ((), cause)]
        for models in (specs, clean)
    )
    gain, left = given[0] - given[1], mended[0] - mended[1]
    if gain <= 0 or left >= settings.numerics.gain_left * gain or mended[0] > given[0]:
        return None
    changes = " and ".join(VARIANTS[name][1] for name in test.needed)
    return (
        f"It closes {gain / given[0]:.0%} of the gap in the model as given, and "
        f"{max(left, 0.0) / mended[0]:.0%} with {changes}: this is the simulator's numerics, "
        "not the robot."
    )


def _words(what: str, gap: float, changed: float, moved: float, settings: Numerics) -> str:
    least = settings.change * gap
    if moved < max(least, settings.change_min) or (abs(changed - gap) < least and moved < gap):
        return "ok"
    if gap < settings.change_min:
        return f"with {what} the replay moves by {moved:.3g} of the motion: put that into the model"
    if abs(changed - gap) < least:
        return (
            f"with {what} the replay moves by {moved:.3g} of the motion and the gap stays at "
            f"{gap:.3g}: what moves the replay less than that is indistinguishable from numerics"
        )
    less = "smaller" if changed < gap else "larger"
    return (
        f"with {what} the gap is {abs(changed / gap - 1):.0%} {less} ({gap:.3g} to {changed:.3g} "
        f"of the motion; the replay moves by {moved:.3g}): put that into the model first"
    )


def _replayed(
    pieces: Sequence[Piece],
    specs: Sequence[mujoco.MjSpec],
    fixed: Sequence[Fixed],
    settings: Settings,
) -> tuple[float, list[np.ndarray]]:
    """The gap of all pieces, and what was simulated."""
    paths, sizes = [], []
    for one in pieces:
        spec = specs[one.number]
        model = spec.copy().compile()
        paths.append(trial(spec, [one.recording(model)], fixed=fixed)[0])
        for joint, place in _joints(one, model):
            measured = one.log.column(f"qpos.{joint}")
            sizes.append(_size(paths[-1][:, place] - measured, measured, settings))
    return float(np.sqrt(np.mean(np.square(sizes)))) if sizes else 0.0, paths


def _distance(
    pieces: Sequence[Piece],
    specs: Sequence[mujoco.MjSpec],
    one: Sequence[np.ndarray],
    other: Sequence[np.ndarray],
    settings: Settings,
) -> float:
    """How far two sets of replays are apart, of the joints' motion."""
    sizes = []
    for cut, before, after in zip(pieces, one, other, strict=True):
        model = specs[cut.number].copy().compile()
        for joint, place in _joints(cut, model):
            measured = cut.log.column(f"qpos.{joint}")
            sizes.append(_size(after[:, place] - before[:, place], measured, settings))
    return float(np.sqrt(np.mean(np.square(sizes)))) if sizes else 0.0


def _size(error: np.ndarray, measured: np.ndarray, settings: Settings) -> float:
    most = settings.simulation.error_max
    size = float(np.sqrt(np.mean(error**2)) / max(measured.std(), settings.preflight.moved))
    return min(size, most) if np.isfinite(size) else most


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
    shorten(spec, 2)


def _tight(spec: mujoco.MjSpec) -> None:
    option, usual = spec.option, mujoco.MjSpec().option
    option.tolerance, option.ls_tolerance = FINE, np.sqrt(FINE)
    option.iterations = max(option.iterations, usual.iterations)
    option.ls_iterations = max(option.ls_iterations, usual.ls_iterations)


def _stiff(spec: mujoco.MjSpec) -> None:
    for joint in spec.joints:
        joint.solimp_friction = np.array(STIFF_SOLIMP)


def _inertia(spec: mujoco.MjSpec) -> None:
    for joint in _scalars(spec):
        if joint.armature == 0:
            joint.armature = ARMATURE


VARIANTS: dict[str, tuple[Callable[[mujoco.MjSpec], None], str]] = {
    "timestep": (_half_step, "half the timestep"),
    "solver": (_tight, "a tighter solver"),
    "friction": (_stiff, 'solimpfriction="0.9999 0.9999 0.001"'),
    "armature": (_inertia, f"an armature of {ARMATURE:g} kg m^2 on joints without any"),
}
