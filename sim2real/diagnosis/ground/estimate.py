"""Logs with the state of a base that nobody measured: estimated from encoders, IMU and contact.

    estimates = estimate_all(logs, model, settings)     # [] where every base is held or logged
    estimates[0].log.column("qpos.root.3")              # as if it had been logged

Joint positions and speeds at a row's time are those of a parabola through three readings. The
base's orientation is the IMU's (without one, of a robot that rests, that of the plane of its feet:
`leaning`), its height and linear speed are what soles that stand on the ground
leave (`odometry`); a column `sensor.position_0` to `_2` (a tracker of the base) takes their place.
Heading and place on the ground change nothing and start at 0.
"""

from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.poses import home
from sim2real.diagnosis.data.recording import check_log, columns_of, load_model
from sim2real.diagnosis.ground.base import Base, base_of, imu_of, rotations
from sim2real.diagnosis.ground.feet import feet_of
from sim2real.diagnosis.ground.leaning import leant
from sim2real.diagnosis.ground.odometry import Walk, walked
from sim2real.diagnosis.ground.turns import slopes, turned
from sim2real.diagnosis.settings import Ground
from sim2real.runs.errors import Sim2RealError

TRACKER = tuple(f"sensor.position_{i}" for i in range(3))


class Estimate(NamedTuple):
    """A log and the states of its robot at its T rows."""

    log: Log  # with columns of the base
    base: Base  # which of the model's joints these are
    qpos: np.ndarray  # (T, nq)
    qvel: np.ndarray  # (T, nv)
    walk: Walk  # what the soles said
    slope: np.ndarray  # (T, nv) by how much speeds may be off, standard deviation
    lift: np.ndarray  # (n,) of the base's linear positions that raises it by 1 m
    felt: bool  # whether an IMU says how the base is turned; else the soles that it rests on do


def estimate_all(logs: Sequence[Log], model: str | Path | None, settings: Ground) -> list[Estimate]:
    """Return the estimate of each log of a robot; none at all where no log needs one.

    Without a model each log names its own.

    Raises:
        Sim2RealError: a base that turns freely, has no IMU and does not rest on its soles, or one
            that only some of the logs hold.
        LogError: a log that names what its model lacks.
    """
    found, held = list[Estimate](), list[Log]()
    for log in logs:
        compiled = load_model(log, model).compile()
        check_log(log, compiled)
        one = estimated(log, compiled, settings)
        if one is None:
            held.append(log)
        else:
            found.append(one)
    if found and held:
        raise Sim2RealError(
            f"{held[0].path or 'a log'} contains the base's position and "
            f"{found[0].log.path or 'another'} does not; diagnose them separately"
        )
    return found


def estimated(log: Log, model: mujoco.MjModel, settings: Ground) -> Estimate | None:
    """Return a log's states, where its base is neither held nor logged; raises as the above."""
    base = base_of(log, model)
    if base is None:
        return None
    parts = [_episode(part, model, base, settings) for part in log.episodes()]
    qpos, qvel, slope, *walk = map(np.concatenate, zip(*(rows for rows, _ in parts), strict=True))
    columns = dict(log.columns)
    for joint in base.joints:  # as if they had been logged
        places, speeds = columns_of(model, joint)
        first, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        columns |= {f"qpos.{n}": qpos[:, first + k] for k, n in enumerate(places)}
        columns |= {f"qvel.{n}": qvel[:, dof + k] for k, n in enumerate(speeds)}
    (_, lift), *_ = parts
    felt = imu_of(log, model, base) is not None
    full = Log(columns, log.meta, log.path)
    return Estimate(full, base, qpos, qvel, Walk(*walk), slope, lift, felt)


def _episode(
    part: Log, model: mujoco.MjModel, base: Base, settings: Ground
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Return qpos, qvel, slope and walk of an episode's T rows, and the lift; see `Estimate`."""
    count, imu = len(part), imu_of(part, model, base)
    qpos, qvel = np.tile(home(model)[0], (count, 1)), np.zeros((count, model.nv))
    slope = np.full((count, model.nv), settings.speed_doubt)
    for j in range(model.njnt):
        name = model.joint(j).name
        if len(columns_of(model, j)[0]) == 1 and f"qpos.{name}" in part.columns:
            q, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
            qpos[:, q], qvel[:, dof] = _motion(part, name)
            slope[:, dof] += rms(np.diff(qvel[:, dof]))
    if base.is_free and imu is not None:
        qpos[:, base.turn], qvel[:, base.spin] = turned(part.time, imu, settings)
    elif base.is_free:
        qpos[:, base.turn], qvel[:, base.spin] = _rested(part, model, base, qpos, settings)
        slope[:, base.spin] = settings.lean_rad_s
    feet = feet_of(model, base, qpos, qvel)
    felt = None
    if base.is_free and imu is not None and imu.acceleration is not None:
        turn, spin = rotations(qpos[:, base.turn]), qvel[:, base.spin]
        turning = np.gradient(spin, part.time, axis=0)
        lever = np.cross(turning, imu.place) + np.cross(spin, np.cross(spin, imu.place))
        felt = turn.apply(imu.mount.apply(imu.acceleration) - lever) + model.opt.gravity
    walk = walked(part.time, feet, felt, _flight(model, base), settings)
    if base.is_free and all(name in part.columns for name in TRACKER):
        place = np.column_stack([part.column(name) for name in TRACKER])
        walk = walk._replace(speed=np.gradient(place, part.time, axis=0))
        qpos[:, base.qpos] = place
    else:
        step = np.diff(part.time, prepend=part.time[0])[:, None]
        along = np.cumsum(walk.speed * step, axis=0)
        qpos[:, base.qpos] += along + np.outer(walk.height - along @ feet.up, feet.lift)
    qvel[:, base.dofs] = walk.speed
    slope[:, base.dofs] = walk.unsure
    return (qpos, qvel, slope, *walk), feet.lift


def _rested(
    part: Log, model: mujoco.MjModel, base: Base, qpos: np.ndarray, settings: Ground
) -> tuple[np.ndarray, np.ndarray]:
    """Return orientations (T, 4) and angular velocities (T, 3) of a base that rests on its soles.

    Raises:
        Sim2RealError: it does not rest.
    """
    turn = leant(model, base, qpos, settings)
    if turn is not None:
        spin = slopes(part.time, rotations(turn))
        if rms(spin) < settings.lean_rad_s:
            return turn, spin
    name = model.joint(base.joints[0]).name or model.body(base.body).name
    sites = [model.site(i).name for i in np.flatnonzero(model.site_bodyid == base.body)]
    site = next(iter(sites), "imu")
    raise Sim2RealError(
        f"{part.path or 'the log'}: the model's base {name!r} is free, it does not rest "
        f"on three feet, and neither `qpos.{name}.0` to `qpos.{name}.6` nor an IMU on it is "
        "logged: where it was when the "
        f"recording's pieces begin is not known. Log `quat.{site}.w` to `.z`, or `gyro.{site}.x` "
        f"and `accelerometer.{site}.x` to `.z` at a site of the model, or the pose (motion "
        "capture); or hold the base still while you record, and give a model whose base is fixed"
    )


def _motion(part: Log, joint: str) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's position and speed at the rows' times, (T,) each."""
    values = part.column(f"qpos.{joint}")
    read = part.columns.get(f"stamp.{joint}", part.time)
    middle = np.clip(np.arange(len(values)), 1, len(values) - 2)
    q, t = ([x[middle + k] for k in (-1, 0, 1)] for x in (values, read))
    first, second = (q[1] - q[0]) / (t[1] - t[0]), (q[2] - q[1]) / (t[2] - t[1])
    bend = (second - first) / (t[2] - t[0])
    ahead = part.time - t[0]
    position = q[0] + first * ahead + bend * ahead * (part.time - t[1])
    speed = first + bend * (ahead + part.time - t[1])
    return position, speed


def rms(values: np.ndarray) -> float:
    """Return the root mean square of numbers."""
    return float(np.sqrt(np.mean(values**2)))


def _flight(model: mujoco.MjModel, base: Base) -> np.ndarray:
    """Return the acceleration of the base's linear positions while nothing touches it, (n,)."""
    alone = copy(model)
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    data = mujoco.MjData(alone)
    data.qpos[:] = home(model)[0]
    mujoco.mj_forward(alone, data)
    return data.qacc[base.dofs].copy()
