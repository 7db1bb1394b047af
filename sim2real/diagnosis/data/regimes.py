"""Kinds of moments in a log: fast, loaded, reversing, held, and so on, by joint.

for kind in regimes(log, model, "elbow"):
    kind.group, kind.name, kind.rows        # "speed", "fast", (T,) bool
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from hardware.log import Log

REST = 0.05  # rad/s or m/s: slower than this is at rest
AFTER = 0.3  # s after a joint turned back that count as reversal
STILL, HELD = 2e-3, 0.5  # rad or m, s: a command that stays within this for that long is held
SMOOTH = 0.06  # s over which speeds are averaged


class Kind(NamedTuple):
    """Rows of a log that have something in common."""

    group: str
    name: str
    rows: np.ndarray  # (T,) bool


def regimes(log: Log, model: mujoco.MjModel | None, joint: str) -> Iterator[Kind]:
    """Yield the kinds of moments of one joint, each group a partition or a single kind.

    Args:
        log: what was measured and commanded.
        model: says what load gravity makes; None leaves the load out.
        joint: a hinge or slide that was measured.
    """
    q, actuator = log.column(f"qpos.{joint}"), driver_of(log, model, joint)
    v = speed(log, joint)
    yield from _thirds("speed", ("at rest", "slow", "fast"), np.abs(v), REST)
    yield Kind("reversal", "reversal", _reversal(log, v))
    low, high = np.quantile(q, [1 / 3, 2 / 3])
    yield Kind("position", "low position", q < low)
    yield Kind("position", "middle position", (q >= low) & (q <= high))
    yield Kind("position", "high position", q > high)
    if model is not None and joint in [model.joint(i).name for i in range(model.njnt)]:
        load = np.abs(gravity(log, model, joint))
        if load.max() > 1e-6:
            yield from _thirds(
                "load", ("no load", "some load", "high load"), load, 0.1 * load.max()
            )
    if actuator is not None:
        error = np.abs(log.column(f"ctrl.{actuator}") - q)
        yield from _thirds(
            "error", ("at its goal", "near its goal", "far from its goal"), error, 0.01
        )
        on = log.columns.get(f"torque.{actuator}", np.ones(len(log))) > 0
        yield Kind("hold", "hold", held(log, actuator) & on)
        if not on.all():
            yield Kind("torque", "torque off", ~on)
    start, end = log.time.min(), log.time.max()
    share = (log.time - start) / max(end - start, 1e-9)
    yield Kind("time", "first third of the time", share < 1 / 3)
    yield Kind("time", "last third of the time", share > 2 / 3)


def driver_of(log: Log, model: mujoco.MjModel | None, joint: str) -> str | None:
    """Return the logged actuator that drives a joint: as the model says, else of its name."""
    if model is None:
        return joint if joint in log.actuators else None
    for i in range(model.nu):
        on_joint = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        if on_joint and model.joint(int(model.actuator_trnid[i, 0])).name == joint:
            name = model.actuator(i).name
            return name if name in log.actuators else None
    return None


def speed(log: Log, joint: str) -> np.ndarray:
    """Return the slope of a joint's position, averaged over a moment, (T,)."""
    found = []
    for part in log.episodes():
        raw = np.gradient(part.column(f"qpos.{joint}"), part.time)
        width = max(1, round(SMOOTH / float(np.median(np.diff(part.time))))) | 1
        padded = np.pad(raw, width // 2, mode="edge")
        found.append(np.convolve(padded, np.ones(width) / width, mode="valid"))
    return np.concatenate(found)


def gravity(log: Log, model: mujoco.MjModel, joint: str) -> np.ndarray:
    """Return the torque or force that gravity puts on a joint in the measured poses, (T,)."""
    data = mujoco.MjData(model)
    places = {
        f"qpos.{model.joint(i).name}": int(model.jnt_qposadr[i])
        for i in range(model.njnt)
        if f"qpos.{model.joint(i).name}" in log.columns
    }  # a free base stays as the model has it
    poses = np.column_stack([log.column(name) for name in places])
    dof, index = int(model.joint(joint).dofadr[0]), list(places.values())
    every = max(1, len(poses) // 2000)  # poses change slowly between rows
    found = np.zeros(len(poses[::every]))
    for row, pose in enumerate(poses[::every]):
        data.qpos[index] = pose
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found[row] = data.qfrc_bias[dof]
    return np.interp(np.arange(len(poses)), np.arange(len(poses))[::every], found)


def held(log: Log, actuator: str) -> np.ndarray:
    """Return where a command has stayed the same for a while, (T,) bool."""
    found = []
    for part in log.episodes():
        ctrl = part.column(f"ctrl.{actuator}")
        moves = np.concatenate([[True], np.abs(np.diff(ctrl)) > STILL])
        since = (
            part.time - part.time[np.maximum.accumulate(np.where(moves, np.arange(len(ctrl)), 0))]
        )
        found.append(since > HELD)
    return np.concatenate(found)


def _reversal(log: Log, v: np.ndarray) -> np.ndarray:
    """The moments after a joint turned back."""
    found, start = [], 0
    for part in log.episodes():
        own = v[start : start + len(part)]
        start += len(part)
        sign = np.where(np.abs(own) > REST, np.sign(own), 0.0)
        moving = np.flatnonzero(sign)
        turns = moving[1:][np.diff(sign[moving]) != 0] if moving.size else moving
        rows = np.zeros(len(part), bool)
        for turn in turns:
            rows |= (part.time >= part.time[turn] - 0.05) & (part.time < part.time[turn] + AFTER)
        found.append(rows)
    return np.concatenate(found)


def _thirds(
    group: str, names: tuple[str, str, str], values: np.ndarray, least: float
) -> Iterator[Kind]:
    """Below `least`, and the rest at half of what is rarely exceeded."""
    half = max(0.5 * float(np.quantile(values, 0.98)), least)
    yield Kind(group, names[0], values < least)
    yield Kind(group, names[1], (values >= least) & (values < half))
    yield Kind(group, names[2], values >= half)
