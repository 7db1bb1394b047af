"""Places of effects: objects by name, or by a pattern such as `hip_*`, and blocks of fields."""

from fnmatch import fnmatchcase
from typing import Literal

import mujoco
import numpy as np

from envs.errors import EffectError, did_you_mean

Block = tuple[np.ndarray | slice, np.ndarray | slice]  # rows and columns of a field


def find(
    model: mujoco.MjModel, kind: Literal["joint", "actuator", "body", "geom"], name: str | None
) -> int:
    """Return the id of a named object; raises EffectError that lists the model's names."""
    kinds = {
        "joint": model.njnt,
        "actuator": model.nactuator,
        "body": model.nbody,
        "geom": model.ngeom,
    }
    names = [getattr(model, kind)(i).name for i in range(kinds[kind])]
    if name is None or name not in names:
        known = ", ".join(n for n in names if n and n != "world")
        hint = did_you_mean(str(name), names)
        raise EffectError(f"the model has no {kind} {name!r}{hint}; it has: {known}")
    return names.index(name)


def is_pattern(name: str | None) -> bool:
    """Return whether a name stands for all that match it."""
    return name is not None and "*" in name


def members(
    model: mujoco.MjModel, kind: Literal["joint", "actuator", "body", "geom"], name: str | None
) -> np.ndarray:
    """Return the ids of the object of that name, or of all that match a pattern, (k,).

    Raises:
        EffectError: none of that name; lists the model's names.
    """
    count = {"joint": "njnt", "actuator": "nactuator", "body": "nbody", "geom": "ngeom"}[kind]
    every = range(getattr(model, count)) if is_pattern(name) else ()
    found = [i for i in every if fnmatchcase(getattr(model, kind)(i).name, str(name))]
    return np.array(found or [find(model, kind, name)])


def joints(model: mujoco.MjModel, where: str | None) -> np.ndarray:
    """Return the ids of the joints of that name or pattern; None: all driven ones, (k,).

    Raises:
        EffectError: no such joint, one that does not turn about or slide along one axis, or no
            actuator on a joint.
    """
    if where is None:
        driven = {
            int(model.actuator_trnid[i, 0])
            for i in range(model.nactuator)
            if joint_driven(model, i)
        }
        found = np.array(sorted(j for j in driven if _scalar(model, j)), dtype=int)
        if not found.size:
            raise EffectError(
                "no actuator of this model drives a hinge or slide; give where: the name of a joint"
            )
        return found
    found = members(model, "joint", where)
    if not all(_scalar(model, joint) for joint in found):
        raise EffectError(f"joint {where!r} is a ball or free joint; name a hinge or slide")
    return found


def joint_driven(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether an actuator acts on a joint."""
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return int(model.actuator_trntype[actuator]) in [int(k) for k in kinds]


def driven_joints(model: mujoco.MjModel) -> set[int]:
    """Return the joints that actuators act on; others act on tendons, sites and bodies."""
    return {int(model.actuator_trnid[i, 0]) for i in range(model.nu) if joint_driven(model, i)}


def spaced(index: np.ndarray | slice) -> np.ndarray | slice:
    """Return rising numbers (n,) that are evenly spaced as a slice, others as they are."""
    if isinstance(index, slice) or not len(index):
        return index
    step = int(index[1] - index[0]) if len(index) > 1 else 1
    if step < 1 or (np.diff(index) != step).any():
        return index
    return slice(int(index[0]), int(index[-1]) + 1, step)


def block(rows: np.ndarray | slice, columns: np.ndarray) -> Block:
    """Return the index of a field's rows and columns: of a field (N, K, ...) it yields (n, k, ...).

    Slices where that is possible, since in every substep lists of numbers cost more. What slices
    yield is a view: it changes with the field.

    Args:
        rows: numbers of rows, (n,), or a slice.
        columns: numbers of columns, (k,).
    """
    rows = spaced(rows)
    return (rows, spaced(columns)) if isinstance(rows, slice) else (rows[:, None], columns)


def _scalar(model: mujoco.MjModel, joint: int) -> bool:
    return int(model.jnt_type[joint]) in (
        int(mujoco.mjtJoint.mjJNT_HINGE),
        int(mujoco.mjtJoint.mjJNT_SLIDE),
    )
