"""Effects that all joints share, as temperature changes them: by the same share at each.

    response = in_proportion(data, watch, response)

Warm grease takes a tenth off each joint's friction, not the same torque off each. How much friction
each joint has is what the model says, what both sides add, and what a linear fit to the errors that
are left adds.
"""

import mujoco
import numpy as np

from sim2real.diagnosis.comparison.response import Parts, Response, Watch
from sim2real.diagnosis.data.dataset import Data

FIELDS = {"coulomb_friction": "dof_frictionloss", "viscous_friction": "dof_damping"}


def in_proportion(data: Data, watch: Watch, response: Response) -> Response:
    """Return the response with the columns of shared friction in proportion to each joint's own.

    A column keeps its unit: the mean over the joints.
    """
    change, size = response.change.copy(), friction(data, watch, response)
    made: dict[int, Parts] = {}
    for k, column in enumerate(response.columns):
        name = column.option.name
        parts = [i for i in size if response.columns[i].option.name == name]
        if not column.option.shared or len(parts) < 2:
            continue
        sizes = np.array([size[i] for i in parts])
        if sizes.sum() > 0:
            shares = sizes / sizes.mean()
            change[k] = np.tensordot(shares, response.change[parts], 1)
            made[k] = tuple(zip(parts, shares.tolist(), strict=True))
    return response._replace(change=change, parts=made)


def friction(data: Data, watch: Watch, response: Response) -> dict[int, float]:
    """Return how much of its friction each joint has, by the number of its column."""
    own = [
        k
        for k, column in enumerate(response.columns)
        if column.option.name in FIELDS and not column.option.shared
    ]
    if not own:
        return {}
    flat = response.change[own].reshape(len(own), -1)
    added, *_ = np.linalg.lstsq(flat.T, -response.error.reshape(-1), rcond=None)
    found = {}
    for k, more in zip(own, added, strict=True):
        option = response.columns[k].option
        there = _there(data, watch, option.name, [str(option.effect.where)])[0]
        found[k] = max(float(there + more), 0.0)  # the fit may make less than nothing of a joint
    return found


def _there(data: Data, watch: Watch, name: str, joints: list[str]) -> np.ndarray:
    """Return what the model and what both sides have say of each joint, (n,)."""
    model: mujoco.MjModel = data.models[0]
    dofs = [int(model.joint(joint).dofadr[0]) for joint in joints]
    found = np.array(getattr(model, FIELDS[name])[dofs], float)
    shared = [(member.effect, values) for member, values in watch.pairs]
    for effect, values in [*watch.fixed, *shared]:
        if effect.name == name:
            found += [float(values[0]) * (effect.where in (None, joint)) for joint in joints]
    return found
