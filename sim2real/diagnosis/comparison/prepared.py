"""Logs, replayed with what they share: what every comparison of some of them starts from.

made = prepare(logs, "arm.xml", [], ("coulomb_friction", "backlash"), settings)
made.response.change, made.error                    # (P, n, T, M), (W, T, M)

Logs that were driven by the same commands have windows of the same rows: what the model cannot
follow is in all of them, and cancels in their difference.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from envs.plant import Fixed
from hardware.log import Log
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
from sim2real.diagnosis.data.recording import powered
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.windows import Window, cut_one
from sim2real.diagnosis.settings import Settings

Motions = list[tuple[int, ...]]  # the logs of each


class Prepared(NamedTuple):
    """Logs, replayed: what every comparison of some of them starts from."""

    data: Data
    simulator: Simulator
    partner: np.ndarray  # (W,) the window of the first log with the same motion
    windows: np.ndarray  # (n,) those of first logs, which the response is of
    motions: Motions
    watch: Watch
    response: Response
    lines: np.ndarray  # (P + M, n, T, M) its changes, then those with the clock of each joint
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
    # each servo measures and obeys at ticks of its own: where a tick lies between two messages of
    # the bus may differ from one session to the next by up to a tick, at each joint for itself
    clocks = np.eye(len(data.joints))[:, None, None] * response.slope
    lines = np.concatenate([response.change, clocks])
    error = errors(simulator, watch, np.arange(len(data.windows)))
    own = data, simulator, partner, windows, motions, watch, response, lines, error, friction
    return Prepared(*own)


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


def pair(logs: Sequence[Log], settings: Settings) -> Motions:
    """Return groups of logs that were driven by the same commands, in their order."""
    found: list[list[int]] = []
    for number, log in enumerate(logs):
        for group in found:
            if same_rows(logs[group[0]], log, settings).mean() >= settings.compared.same_rows:
                group.append(number)
                break
        else:
            found.append([number])
    return [tuple(group) for group in found]


def same_rows(one: Log, other: Log, settings: Settings) -> np.ndarray:
    """Return whether each row of the first log was commanded alike in the other, (T,) bool."""
    rows = min(len(one), len(other))
    alike = np.zeros(len(one), bool)
    if one.actuators != other.actuators or not rows:
        return alike
    step = float(np.median(np.diff(one.time))) if len(one) > 1 else 0.0
    own = (one.episode[:rows] == one.episode[0]) == (other.episode[:rows] == other.episode[0])
    own &= np.abs(one.time[:rows] - other.time[:rows]) < step / 2
    for name in one.actuators:
        first, second = (log.columns[f"ctrl.{name}"][:rows] for log in (one, other))
        own &= np.abs(first - second) <= settings.preflight.same_command
        own &= powered(one, name)[:rows] == powered(other, name)[:rows]
    alike[:rows] = own
    return alike


def aligned(data: Data, motions: Motions) -> tuple[Data, np.ndarray]:
    """Give the logs of one motion the windows of its first log.

    Returns:
        The data, and for each window the window of the first log with the same motion, (W,);
        its own number for those of a first log.
    """
    windows: list[Window] = []
    partner: list[int] = []
    for group in motions:
        first = group[0]
        own = [window for window in data.windows if window.log == first]
        start = len(windows)
        windows += own
        partner += range(start, start + len(own))
        for number in group[1:]:
            log = data.logs[number]
            same = same_rows(data.logs[first], log, data.settings)
            for place, window in enumerate(own):
                if (twin := _twin(data, window, number, same)) is not None:
                    windows.append(twin)
                    partner.append(start + place)
    return data.with_windows(windows), np.array(partner)


def _twin(data: Data, window: Window, number: int, same: np.ndarray) -> Window | None:
    """Return a window of the same rows of another log; None where too few rows are alike."""
    log = data.logs[number]
    if window.last > len(log) or len(set(log.episode[window.start : window.last])) > 1:
        return None
    which, rows = data.which[number], (window.start, window.first, window.last)
    model, settings = data.models[which], data.settings.windows
    made = cut_one(log, number, which, model, data.joints, rows, settings)
    usable = made.usable & window.usable & same[window.first : window.last]
    return made._replace(usable=usable) if usable.sum() > 1 else None
