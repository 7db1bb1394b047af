"""Kinds of moments in a log: fast, loaded, reversing, held, and so on, by joint.

for group, name, rows in regimes(log, model, "elbow"):
    ...                                     # "speed", "fast", (T,) bool
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from scipy.ndimage import uniform_filter1d

from hardware.log import Log
from sim2real.diagnosis.data.pairs import driven_by
from sim2real.diagnosis.data.recording import episode_rows, powered
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings

THIRDS = (1 / 3, 2 / 3)  # of the rows, or of the time

Kind = tuple[str, str, np.ndarray]  # group, name, and which rows are of it, (T,) bool


def regimes(
    log: Log, model: mujoco.MjModel, joint: str, settings: Settings = DEFAULT
) -> Iterator[Kind]:
    """Yield the kinds of moments of a hinge or slide, each group a partition or a single kind."""
    q, v, limits = log.column(f"qpos.{joint}"), _speed(log, joint, settings), settings.regimes
    driven = ((name, driven_by(model, name)) for name in log.actuators)
    actuator = next((name for name, own in driven if own is not None and own[1] == joint), None)
    names = ("at rest", "slow", "fast")
    yield from _halves("speed", names, np.abs(v), limits.rest_speed, settings)
    yield "reversal", "reversal", _reversal(log, v, settings)
    yield from _thirds("position", q)
    if joint in [model.joint(i).name for i in range(model.njnt)]:
        load = np.abs(_gravity(log, model, joint))
        if load.max() > TINY:
            yield from _thirds("load", load)
    if actuator is not None:
        error = np.abs(log.column(f"ctrl.{actuator}") - q)
        names = ("at its goal", "near its goal", "far from its goal")
        yield from _halves("error", names, error, limits.goal_error, settings)
        on = powered(log, actuator)
        yield "hold", "hold", _held(log, actuator, settings) & on
        if not on.all():
            yield "torque", "torque off", ~on
    start, end = log.time.min(), log.time.max()
    share = (log.time - start) / max(end - start, TINY)
    yield "time", "first third of the time", share < THIRDS[0]
    yield "time", "last third of the time", share > THIRDS[1]


def _speed(log: Log, joint: str, settings: Settings) -> np.ndarray:
    """Return the slope of a joint's position, averaged over a moment, (T,)."""
    found = []
    for part in log.episodes():
        raw = np.gradient(part.column(f"qpos.{joint}"), part.time)
        rows = settings.regimes.smoothing_s / float(np.median(np.diff(part.time)))
        found.append(uniform_filter1d(raw, max(1, round(rows)) | 1, mode="nearest"))
    return np.concatenate(found)


def _gravity(log: Log, model: mujoco.MjModel, joint: str) -> np.ndarray:
    """Return the torque or force that gravity puts on a joint in the measured poses, (T,)."""
    data, names = mujoco.MjData(model), [model.joint(i).name for i in range(model.njnt)]
    logged = [name for name in names if f"qpos.{name}" in log.columns]
    poses = np.column_stack([log.column(f"qpos.{name}") for name in logged])
    places = [int(model.joint(name).qposadr[0]) for name in logged]  # a free base stays
    dof, found = int(model.joint(joint).dofadr[0]), []
    for pose in poses:
        data.qpos[places] = pose
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found.append(data.qfrc_bias[dof])
    return np.array(found)


def _held(log: Log, actuator: str, settings: Settings) -> np.ndarray:
    """Return where a command has stayed the same for a while, (T,) bool."""
    moved = np.abs(np.diff(log.column(f"ctrl.{actuator}"), prepend=np.inf))
    fresh = np.diff(log.episode, prepend=np.inf) != 0
    changed = fresh | (moved > settings.preflight.same_command)
    last = np.maximum.accumulate(np.where(changed, np.arange(len(log)), 0))
    return log.time - log.time[last] > settings.windows.kick_s


def _reversal(log: Log, v: np.ndarray, settings: Settings) -> np.ndarray:
    """Return the moments after a joint turned back, (T,) bool."""
    found, limits = [], settings.regimes
    for rows in episode_rows(log):
        own, time = v[rows], log.time[rows]
        moving = np.flatnonzero(np.abs(own) > limits.rest_speed)
        turns = moving[1:][np.diff(np.sign(own[moving])) != 0]
        since = time - time[turns][:, None]  # (turns, T)
        near = (since >= -limits.smoothing_s) & (since < settings.windows.kick_s)
        found.append(near.any(axis=0))
    return np.concatenate(found)


def _thirds(group: str, values: np.ndarray) -> Iterator[Kind]:
    """Yield the thirds of the rows with the smallest values, the largest, and those between."""
    low, high = np.quantile(values, THIRDS)
    yield group, f"low {group}", values < low
    yield group, f"middle {group}", (values >= low) & (values <= high)
    yield group, f"high {group}", values > high


def _halves(
    group: str, names: tuple[str, str, str], values: np.ndarray, least: float, settings: Settings
) -> Iterator[Kind]:
    """Yield rows below `least`, and the rest at half of a quantile that is rarely exceeded."""
    half = max(float(np.quantile(values, 1 - settings.inference.level)) / 2, least)
    yield group, names[0], values < least
    yield group, names[1], (values >= least) & (values < half)
    yield group, names[2], values >= half
