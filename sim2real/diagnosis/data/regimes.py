"""Kinds of moments in a log: fast, loaded, reversing, held, and so on, by joint.

for kind in regimes(log, model, "elbow"):
    kind.group, kind.name, kind.rows        # "speed", "fast", (T,) bool
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.ndimage import uniform_filter1d

from hardware.log import Log
from sim2real.diagnosis.data.recording import episode_rows, powered
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings

THIRDS = (1 / 3, 2 / 3)  # of a joint's range, or of the time


class Kind(NamedTuple):
    """Rows of a log that have something in common."""

    group: str
    name: str
    rows: np.ndarray  # (T,) bool


def regimes(
    log: Log, model: mujoco.MjModel, joint: str, settings: Settings = DEFAULT
) -> Iterator[Kind]:
    """Yield the kinds of moments of one joint, each group a partition or a single kind.

    Args:
        log: what was measured and commanded.
        model: says what load gravity makes.
        joint: a hinge or slide that was measured.
        settings: what parts the kinds.
    """
    q, actuator = log.column(f"qpos.{joint}"), driver_of(log, model, joint)
    v, limits = speed(log, joint, settings), settings.regimes
    names = ("at rest", "slow", "fast")
    yield from _thirds("speed", names, np.abs(v), limits.rest_speed, limits.rare)
    yield Kind("reversal", "reversal", _reversal(log, v, settings))
    low, high = np.quantile(q, THIRDS)
    yield Kind("position", "low position", q < low)
    yield Kind("position", "middle position", (q >= low) & (q <= high))
    yield Kind("position", "high position", q > high)
    if joint in [model.joint(i).name for i in range(model.njnt)]:
        load = np.abs(gravity(log, model, joint, settings))
        if load.max() > TINY:
            names = ("no load", "some load", "high load")
            least = limits.load_none * load.max()
            yield from _thirds("load", names, load, least, limits.rare)
    if actuator is not None:
        error = np.abs(log.column(f"ctrl.{actuator}") - q)
        names = ("at its goal", "near its goal", "far from its goal")
        yield from _thirds("error", names, error, limits.goal_error, limits.rare)
        on = powered(log, actuator)
        yield Kind("hold", "hold", held(log, actuator, settings) & on)
        if not on.all():
            yield Kind("torque", "torque off", ~on)
    start, end = log.time.min(), log.time.max()
    share = (log.time - start) / max(end - start, TINY)
    yield Kind("time", "first third of the time", share < THIRDS[0])
    yield Kind("time", "last third of the time", share > THIRDS[1])


def driver_of(log: Log, model: mujoco.MjModel, joint: str) -> str | None:
    """Return the logged actuator that drives a joint."""
    for i in range(model.nu):
        on_joint = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        if on_joint and model.joint(int(model.actuator_trnid[i, 0])).name == joint:
            name = model.actuator(i).name
            return name if name in log.actuators else None
    return None


def speed(log: Log, joint: str, settings: Settings = DEFAULT) -> np.ndarray:
    """Return the slope of a joint's position, averaged over a moment, (T,)."""
    found = []
    for part in log.episodes():
        raw = np.gradient(part.column(f"qpos.{joint}"), part.time)
        width = (
            max(1, round(settings.regimes.smoothing_s / float(np.median(np.diff(part.time))))) | 1
        )
        found.append(uniform_filter1d(raw, width, mode="nearest"))
    return np.concatenate(found)


def gravity(
    log: Log, model: mujoco.MjModel, joint: str, settings: Settings = DEFAULT
) -> np.ndarray:
    """Return the torque or force that gravity puts on a joint in the measured poses, (T,)."""
    data = mujoco.MjData(model)
    places = {
        f"qpos.{model.joint(i).name}": int(model.jnt_qposadr[i])
        for i in range(model.njnt)
        if f"qpos.{model.joint(i).name}" in log.columns
    }  # a free base stays as the model has it
    poses = np.column_stack([log.column(name) for name in places])
    dof, index = int(model.joint(joint).dofadr[0]), list(places.values())
    every = max(1, len(poses) // settings.regimes.poses_max)  # poses change slowly between rows
    found = np.zeros(len(poses[::every]))
    for row, pose in enumerate(poses[::every]):
        data.qpos[index] = pose
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found[row] = data.qfrc_bias[dof]
    return np.interp(np.arange(len(poses)), np.arange(len(poses))[::every], found)


def held(log: Log, actuator: str, settings: Settings = DEFAULT) -> np.ndarray:
    """Return where a command has stayed the same for a while, (T,) bool."""
    found = []
    for part in log.episodes():
        ctrl = part.column(f"ctrl.{actuator}")
        moves = np.concatenate([[True], np.abs(np.diff(ctrl)) > settings.preflight.same_command])
        since = (
            part.time - part.time[np.maximum.accumulate(np.where(moves, np.arange(len(ctrl)), 0))]
        )
        found.append(since > settings.regimes.held_s)
    return np.concatenate(found)


def _reversal(log: Log, v: np.ndarray, settings: Settings) -> np.ndarray:
    """The moments after a joint turned back."""
    found = []
    for rows in episode_rows(log):
        own, time = v[rows], log.time[rows]
        sign = np.where(np.abs(own) > settings.regimes.rest_speed, np.sign(own), 0.0)
        moving = np.flatnonzero(sign)
        turns = moving[1:][np.diff(sign[moving]) != 0] if moving.size else moving
        since = time - time[turns][:, None]  # (turns, T)
        limits = settings.regimes
        near = (since >= -limits.smoothing_s) & (since < limits.reversal_after_s)
        found.append(near.any(axis=0))
    return np.concatenate(found)


def _thirds(
    group: str, names: tuple[str, str, str], values: np.ndarray, least: float, rare: float
) -> Iterator[Kind]:
    """Below `least`, and the rest at half of a quantile that is rarely exceeded."""
    half = max(float(np.quantile(values, rare)) / 2, least)
    yield Kind(group, names[0], values < least)
    yield Kind(group, names[1], (values >= least) & (values < half))
    yield Kind(group, names[2], values >= half)
