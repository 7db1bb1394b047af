"""Logs with the state of a base that nobody measured: estimated from encoders, IMU and contact.

    estimate = estimated(log, model, settings)      # None: the base is held, or its pose is logged
    estimate.log.column("qpos.root.3")              # as if it had been logged

Joint positions and speeds at a row's time are those of a parabola through three readings. The
base's orientation is the IMU's (without one, of a robot that rests, that of the plane of its feet:
`leaning`), its height and linear speed are what soles that stand on the ground
leave (`odometry`); a column `sensor.position_0` to `_2` (a tracker of the base) takes their place.
Heading and place on the ground change nothing and start at 0.
"""

from copy import copy
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from hardware.log import Log
from sim2real.diagnosis.data.recording import columns_of, episode_rows, home
from sim2real.diagnosis.ground.base import Base, Imu, base_of, imu_of
from sim2real.diagnosis.ground.feet import feet_of
from sim2real.diagnosis.ground.leaning import leant
from sim2real.diagnosis.ground.odometry import Push, Walk, walked
from sim2real.diagnosis.ground.turns import slopes, turned
from sim2real.diagnosis.settings import Ground
from sim2real.runs.errors import Sim2RealError

TRACKER = tuple(f"sensor.position_{i}" for i in range(3))


class Estimate(NamedTuple):
    """A log and the states of its robot at its rows.

    Args:
        log: with columns of the base.
        base: which of the model's joints these are.
        qpos: (T, nq).
        qvel: (T, nv).
        walk: what the soles said.
        slope: (T, nv) by how much speeds may be off, standard deviation.
        lift: (n,) of the base's linear positions that raises it by 1 m.
        felt: whether an IMU says how the base is turned; else the soles that it rests on do.
    """

    log: Log
    base: Base
    qpos: np.ndarray
    qvel: np.ndarray
    walk: Walk
    slope: np.ndarray
    lift: np.ndarray
    felt: bool


def estimated(log: Log, model: mujoco.MjModel, settings: Ground) -> Estimate | None:
    """Return a log's states; None where its base is held, or logged.

    Args:
        log: the log.
        model: its model.
        settings: how sure each channel is.

    Raises:
        Sim2RealError: a base that turns freely, has no IMU and does not rest on its soles.
    """
    base = base_of(log, model)
    if base is None:
        return None
    imu = imu_of(log, model, base)
    felt = imu is not None and (imu.orientation is not None or _can_integrate(imu))
    parts = []
    for part, rows in zip(log.episodes(), episode_rows(log), strict=True):
        made = _episode(part, model, base, _some(imu, rows) if felt else None, settings)
        if made is None:
            raise Sim2RealError(_refusal(log, model, base))
        parts.append(made)
    qpos, qvel, slope = (np.concatenate([part[k] for part in parts]) for k in (0, 1, 3))
    walk = Walk(*(np.concatenate(one) for one in zip(*(part[2] for part in parts), strict=True)))
    full = _with_columns(log, model, base, qpos, qvel)
    return Estimate(full, base, qpos, qvel, walk, slope, parts[0][4], felt)


def _can_integrate(imu: Imu) -> bool:
    return imu.gyro is not None and imu.acceleration is not None


def _refusal(log: Log, model: mujoco.MjModel, base: Base) -> str:
    name = model.joint(base.joints[0]).name or model.body(base.body).name
    site = next(
        (model.site(i).name for i in range(model.nsite) if model.site_bodyid[i] == base.body),
        "imu",
    )
    return (
        f"{log.path or 'the log'}: the model's base {name!r} is free, it does not rest "
        f"on three feet, and neither `qpos.{name}.0` to `qpos.{name}.6` nor an IMU on it is "
        "logged: where it was when the "
        f"recording's pieces begin is not known. Log `quat.{site}.w` to `.z`, or `gyro.{site}.x` "
        f"and `accelerometer.{site}.x` to `.z` at a site of the model, or the pose (motion "
        "capture); or hold the base still while you record, and give a model whose base is fixed"
    )


def _some(imu: Imu | None, rows: slice) -> Imu | None:
    """Return an IMU's channels in some rows."""
    if imu is None:
        return None
    parts = (imu.orientation, imu.gyro, imu.acceleration)
    own = [None if part is None else part[rows] for part in parts]
    return Imu(imu.site, imu.turn, imu.place, *own)


def _episode(
    part: Log, model: mujoco.MjModel, base: Base, imu: Imu | None, settings: Ground
) -> tuple[np.ndarray, np.ndarray, Walk, np.ndarray, np.ndarray] | None:
    """Return qpos, qvel, the walk, how unsure speeds are, and the lift, of one episode.

    None where nothing says how the base is turned.
    """
    count = len(part)
    qpos, qvel = np.tile(home(model)[0], (count, 1)), np.zeros((count, model.nv))
    slope = np.full((count, model.nv), settings.speed_doubt)
    for j in range(model.njnt):
        name = model.joint(j).name
        if len(columns_of(model, j)[0]) == 1 and f"qpos.{name}" in part.columns:
            q, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
            qpos[:, q], qvel[:, dof], slope[:, dof] = _motion(part, name, settings)
    if base.is_free:
        how = _turns(part, model, base, imu, qpos, settings)
        if how is None:
            return None
        qpos[:, base.turn], qvel[:, base.spin] = how
        slope[:, base.spin] = settings.speed_doubt if imu is not None else settings.lean_spin_doubt
    feet = feet_of(model, base, qpos, qvel)
    felt = _felt(part.time, qpos, qvel, model, base, imu)
    walk = walked(part.time, feet, Push(felt, _flight(model, base)), settings)
    speed, height = walk.speed, walk.height
    if base.is_free and all(name in part.columns for name in TRACKER):
        place = np.column_stack([part.column(name) for name in TRACKER])
        speed = np.gradient(place, part.time, axis=0)
        qpos[:, base.qpos] = place
    else:
        step = np.diff(part.time, prepend=part.time[0])[:, None]
        along = np.cumsum(speed * step, axis=0)
        up = feet.lift / np.linalg.norm(feet.lift)
        along -= (along @ up)[:, None] * up
        qpos[:, base.qpos] += along + height[:, None] * feet.lift
    qvel[:, base.dofs] = speed
    slope[:, base.dofs] = np.clip(walk.unsure, *settings.walk_doubt)
    return qpos, qvel, walk._replace(speed=speed), slope, feet.lift


def _turns(
    part: Log,
    model: mujoco.MjModel,
    base: Base,
    imu: Imu | None,
    qpos: np.ndarray,
    settings: Ground,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return orientations (T, 4) and angular velocities (T, 3): the IMU's, else of its rest."""
    if imu is not None:
        return turned(part.time, imu, settings)
    turn = leant(model, base, qpos, settings)
    if turn is None:
        return None
    spin = slopes(part.time, Rotation.from_quat(turn, scalar_first=True))
    calm = np.sqrt(np.mean(spin**2)) < settings.lean_spin_doubt
    return (turn, spin) if calm else None


def _motion(part: Log, joint: str, settings: Ground) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a joint's position and speed at the rows' times, and the speed's doubt, (T,) each."""
    values = part.column(f"qpos.{joint}")
    read = part.columns.get(f"stamp.{joint}", part.time)
    middle = np.clip(np.arange(len(values)), 1, len(values) - 2)
    q, t = ([x[middle + k] for k in (-1, 0, 1)] for x in (values, read))
    first, second = (q[1] - q[0]) / (t[1] - t[0]), (q[2] - q[1]) / (t[2] - t[1])
    bend = (second - first) / (t[2] - t[0])
    ahead = part.time - t[0]
    position = q[0] + first * ahead + bend * ahead * (part.time - t[1])
    speed = first + bend * (ahead + part.time - t[1])
    doubt = np.abs(second - first) * settings.bend_doubt + settings.speed_doubt
    return position, speed, doubt


def _felt(
    time: np.ndarray,
    qpos: np.ndarray,
    qvel: np.ndarray,
    model: mujoco.MjModel,
    base: Base,
    imu: Imu | None,
) -> np.ndarray | None:
    """Return the base's linear acceleration [m/s²] that its IMU felt, (T, 3); None without one."""
    if imu is None or imu.acceleration is None or not base.is_free:
        return None
    spin = qvel[:, base.spin]
    turning = np.gradient(spin, time, axis=0)
    mount = Rotation.from_quat(imu.turn, scalar_first=True)
    lever = np.cross(turning, imu.place) + np.cross(spin, np.cross(spin, imu.place))
    turn = Rotation.from_quat(qpos[:, base.turn], scalar_first=True)
    return turn.apply(mount.apply(imu.acceleration) - lever) + model.opt.gravity


def _flight(model: mujoco.MjModel, base: Base) -> np.ndarray:
    """Return the acceleration of the base's linear positions while nothing touches it, (n,)."""
    alone = copy(model)
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    data = mujoco.MjData(alone)
    data.qpos[:] = home(model)[0]
    mujoco.mj_forward(alone, data)
    return data.qacc[base.dofs].copy()


def _with_columns(
    log: Log, model: mujoco.MjModel, base: Base, qpos: np.ndarray, qvel: np.ndarray
) -> Log:
    """Return a log with the base's positions and speeds as if they had been logged."""
    columns = dict(log.columns)
    for joint in base.joints:
        places, speeds = columns_of(model, joint)
        first, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        columns |= {f"qpos.{n}": qpos[:, first + k] for k, n in enumerate(places)}
        columns |= {f"qvel.{n}": qvel[:, dof + k] for k, n in enumerate(speeds)}
    return Log(columns, log.meta, log.path)
