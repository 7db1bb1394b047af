"""Whether a gap, or what closes it, is the simulator's own doing and not the robot's.

    words = null_test(logs, specs)                  # {"timestep": "ok", "friction": "…", ...}
    is_numerics(logs, specs, cause, words)          # None, or why the cause is none

Four things that no robot has are changed in the model: half the timestep, a tighter solver, dry
friction that does not creep (`solimpfriction`; MuJoCo's default lets a joint that is held by
friction drift, 1.4 degrees in 10 s), and a little armature on joints without any. A gap that
changes with them is partly numerics, and so is an effect whose gain vanishes once they are set.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import mujoco
import numpy as np

from envs.effects import merge_effects
from envs.effects.friction import STIFF_SOLIMP
from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.data.pairs import SCALAR, scalars
from sim2real.diagnosis.data.recording import shorten
from sim2real.diagnosis.data.trial import Piece, choose, trial
from sim2real.diagnosis.settings import DEFAULT, Numerics, Settings

ARMATURE = 5e-4  # kg m^2: below that of the smallest servo (XL-320, 1.1e-3)
FINE = float(np.finfo(float).eps)  # improvement below which a solver has nothing left to do


def null_test(
    logs: Sequence[Log],
    specs: Sequence[mujoco.MjSpec],
    fixed: Sequence[Fixed] = (),
    settings: Settings = DEFAULT,
) -> dict[str, str]:
    """Return "ok", or what replays of pieces say, of each change that makes numerics better.

    `specs` are the models of the logs, `fixed` effects that are in them already.
    """
    pieces = choose(logs, settings.simulation.piece_s)
    given, words = _replayed(pieces, specs, fixed), {}
    gap = _distance(pieces, given, settings)
    for name, (_, what) in VARIANTS.items():
        if not any(_applies(name, specs[one.number]) for one in pieces):
            continue
        paths = _replayed(pieces, [better(spec, (name,)) for spec in specs], fixed)
        changed = _distance(pieces, paths, settings)
        moved = _distance(pieces, paths, settings, given)
        words[name] = _words(what, gap, changed, moved, settings.numerics)
        if name == "armature" and (words["timestep"] == "ok" or changed > gap):
            words[name] = "ok"  # inertia is physics, unless the step is too long without it
    return words


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
    words: Mapping[str, str],
    fixed: Sequence[Fixed] = (),
    settings: Settings = DEFAULT,
) -> str | None:
    """Say that most of what a cause gains vanishes in models with better numerics; None: it stays.

    `words` are those of the null test of the same logs and models, with the same `fixed`: what a
    stiff model hides shows once its gain is right.
    """
    needed = [name for name, word in words.items() if word != "ok"]
    if not needed:
        return None
    pieces = choose(logs, settings.simulation.piece_s)
    given, mended = (
        [
            _distance(pieces, _replayed(pieces, models, effects), settings)
            for effects in (fixed, merge_effects(fixed, cause))
        ]
        for models in (specs, [better(spec, needed) for spec in specs])
    )
    gain, left = given[0] - given[1], mended[0] - mended[1]
    if gain <= 0 or left >= settings.inference.most * gain or mended[0] > given[0]:
        return None
    changes = " and ".join(VARIANTS[name][1] for name in needed)
    return (
        f"It closes {gain / given[0]:.0%} of the gap in the model as given, and "
        f"{max(left, 0.0) / mended[0]:.0%} with {changes}: this is mostly the simulator's "
        "numerics, not the robot."
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
    pieces: Sequence[Piece], specs: Sequence[mujoco.MjSpec], fixed: Sequence[Fixed]
) -> list[np.ndarray]:
    """Return what a replay makes of them, (T, M)."""
    found = []
    for one in pieces:
        model = specs[one.number].copy().compile()
        (path,) = trial(specs[one.number], [one.recording(model)], fixed)
        found.append(path[:, [int(model.joint(name).qposadr[0]) for name in scalars(one.log)]])
    return found


def _distance(
    pieces: Sequence[Piece],
    paths: Sequence[np.ndarray],
    settings: Settings,
    others: Sequence[np.ndarray] | None = None,
) -> float:
    """Return how far replays (T, M) are from others, or from what was measured, of its motion."""
    squares = []
    for number, (one, path) in enumerate(zip(pieces, paths, strict=True)):
        own = np.column_stack([one.column(f"qpos.{name}") for name in scalars(one.log)])
        motion = np.maximum(own.std(axis=0), settings.preflight.moved)
        off = path - (own if others is None else others[number])
        size = np.sqrt(np.mean(off**2, axis=0)) / motion
        squares += (np.fmin(size, settings.simulation.error_max) ** 2).tolist()  # NaN: it diverged
    return float(np.sqrt(np.mean(squares))) if squares else 0.0


def _applies(name: str, spec: mujoco.MjSpec) -> bool:
    """Say whether a change does anything to a model."""
    if name == "friction":
        return any(joint.frictionloss > 0 for joint in spec.joints)
    if name == "armature":
        return any(joint.armature == 0 for joint in _scalars(spec))
    return True


def _scalars(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    return [joint for joint in spec.joints if joint.type in SCALAR]


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
    "timestep": (partial(shorten, times=2), "half the timestep"),
    "solver": (_tight, "a tighter solver"),
    "friction": (_stiff, 'solimpfriction="0.9999 0.9999 0.001"'),
    "armature": (_inertia, f"an armature of {ARMATURE:g} kg m^2 on joints without any"),
}
