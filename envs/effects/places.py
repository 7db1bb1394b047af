"""Where effects act: the objects of a model by name."""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np

from envs.errors import EffectError, did_you_mean


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


def joints(model: mujoco.MjModel, where: str | None) -> np.ndarray:
    """Return the id of the joint of that name, or those of every driven hinge and slide, (k,).

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
                "no actuator of this model drives a hinge or slide; say where: the name of a joint"
            )
        return found
    index = find(model, "joint", where)
    if not _scalar(model, index):
        raise EffectError(f"joint {where!r} is a ball or free joint; name a hinge or slide")
    return np.array([index])


def joint_driven(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether an actuator acts on a joint."""
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return int(model.actuator_trntype[actuator]) in [int(k) for k in kinds]


def _scalar(model: mujoco.MjModel, joint: int) -> bool:
    return int(model.jnt_type[joint]) in (
        int(mujoco.mjtJoint.mjJNT_HINGE),
        int(mujoco.mjtJoint.mjJNT_SLIDE),
    )
