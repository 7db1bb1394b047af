"""Logs, replayed with what they share: what every comparison of some of them starts from.

made = prepare(logs, "arm.xml", [], ("coulomb_friction", "backlash"), settings)
made.response.change, made.error                    # (P, n, T, M), (W, T, M)
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.comparison.motions import Motions, aligned, pair
from sim2real.diagnosis.comparison.response import (
    FRICTION,
    Parts,
    Response,
    Watch,
    errors,
    is_friction,
    respond,
    watched,
)
from sim2real.diagnosis.comparison.shared import share
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import Settings


class Prepared(NamedTuple):
    """Logs, replayed: what every comparison of some of them starts from."""

    data: Data
    simulator: Simulator
    partner: np.ndarray  # (W,) the window of the first log with the same motion
    windows: np.ndarray  # (n,) those of first logs, which the response is of
    motions: Motions
    watch: Watch
    response: Response
    error: np.ndarray  # (W, T, M) of all windows
    friction: dict[int, float]  # of each joint, by the column of its change


def prepare(
    logs: Sequence[Log],
    model: str | Path | None,
    known: Sequence[Fixed],
    names: Sequence[str],
    settings: Settings,
) -> Prepared:
    """Replay logs with what they share, and with each watched effect a little larger."""
    motions = pair(logs, settings)
    data, partner = aligned(Data.of(logs, model, settings), motions)
    windows = np.flatnonzero(partner == np.arange(len(partner)))
    watch = watched(data, known, names)
    simulator = Simulator(data, watch.fixed)
    if not known:
        watch = share(simulator, watch, windows)
    response = respond(simulator, watch, windows)
    friction = _friction(data, watch, response)
    response = _in_proportion(response, friction)
    error = errors(simulator, watch, np.arange(len(data.windows)))
    return Prepared(data, simulator, partner, windows, motions, watch, response, error, friction)


def _in_proportion(response: Response, friction: Mapping[int, float]) -> Response:
    """Return the response with the columns of shared friction in proportion to each joint's own.

    Warm grease takes a tenth off each joint's friction, not the same torque off each. A column
    keeps its unit: the mean over the joints.
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


def _friction(data: Data, watch: Watch, response: Response) -> dict[int, float]:
    """Return how much of its friction each joint has, by the number of its column.

    That is what the model says, what both sides add, and what a linear fit to the errors that are
    left adds.
    """
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
