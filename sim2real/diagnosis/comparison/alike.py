"""Effects that all joints share, as temperature changes them: by the same share at each.

    sizes = friction(data, watch, response)
    response = in_proportion(response, sizes)

Warm grease takes a tenth off each joint's friction, not the same torque off each. How much friction
each joint has is what the model says, what both sides add, and what a linear fit to the errors that
are left adds.
"""

from collections.abc import Mapping

import numpy as np

from sim2real.diagnosis.comparison.response import (
    FRICTION,
    Parts,
    Response,
    Watch,
    is_friction,
)
from sim2real.diagnosis.data.dataset import Data


def in_proportion(response: Response, friction: Mapping[int, float]) -> Response:
    """Return the response with the columns of shared friction in proportion to each joint's own.

    A column keeps its unit: the mean over the joints.
    """
    change, made = response.change.copy(), dict[int, Parts]()
    for k, column in enumerate(response.columns):
        name = column.option.name
        parts = [i for i in friction if response.columns[i].option.name == name]
        sizes = np.array([friction[i] for i in parts])
        if column.option.shared and len(parts) > 1 and sizes.sum() > 0:
            shares = sizes / sizes.mean()
            change[k] = np.tensordot(shares, response.change[parts], 1)
            made[k] = tuple(zip(parts, shares.tolist(), strict=True))
    return response._replace(change=change, parts=made)


def friction(data: Data, watch: Watch, response: Response) -> dict[int, float]:
    """Return how much of its friction each joint has, by the number of its column."""
    own = [k for k, column in enumerate(response.columns) if is_friction(column.option)]
    model, found = data.models[0], {}
    for k, more in zip(own, response.values(own), strict=True):
        effect = response.columns[k].option.effect
        dof = model.joint(str(effect.where)).dofadr[0]
        size = float(getattr(model, FRICTION[effect.name])[dof])
        for one, where, values in watch.both:
            if one.name == effect.name and where in (None, effect.where):
                size += float(values[0])
        found[k] = max(size + float(more), 0.0)  # the fit may make less than nothing of a joint
    return found
