"""The base of a robot that nothing holds: its joints, what stands on the ground, and its IMU.

    base = base_of(log, model)              # None: the base is held, or its pose is logged
    imu = imu_of(log, model, base)          # None: no IMU on the base

A base is a free joint, or the slides of a boom, that carries compared joints, that no actuator
drives and that the log does not hold.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from envs.effects.contact import ground, soles
from envs.effects.places import driven_joints
from hardware.log import Log
from sim2real.diagnosis.data.pairs import carriers
from sim2real.diagnosis.data.recording import columns_of

FREE, SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
AXES = ("x", "y", "z")


class Base(NamedTuple):
    """What of a robot is not held by its joints' encoders: a free joint, or n slides."""

    joints: tuple[int, ...]  # numbers of the model's joints
    body: int  # that they carry
    qpos: np.ndarray  # (n,) where the linear positions are in qpos; three of a free joint
    dofs: np.ndarray  # (n,) where their speeds are in qvel
    turn: np.ndarray  # (4,) where the quaternion is in qpos; empty of slides
    spin: np.ndarray  # (3,) where the angular velocity is in qvel; empty of slides
    soles: np.ndarray  # (F,) geoms that can touch the ground
    floor: int  # the geom of the ground

    @property
    def is_free(self) -> bool:
        """Whether the base can turn."""
        return bool(self.turn.size)


class Imu(NamedTuple):
    """An IMU on the base; None: what the log does not hold."""

    mount: Rotation  # of its site in the base's frame
    place: np.ndarray  # (3,) m in that frame
    orientation: Rotation | None  # of the site in the world, T of them
    gyro: np.ndarray | None  # (T, 3) rad/s in the site's frame
    acceleration: np.ndarray | None  # (T, 3) m/s² that it feels in the site's frame


def base_of(log: Log, model: mujoco.MjModel) -> Base | None:
    """Return the base that a log does not hold; None where there is none, or no ground."""
    driven, floors = driven_joints(model), ground(model)
    above = {b for j in driven for b in carriers(model, int(model.jnt_bodyid[j]))}
    loose = [
        j
        for j in range(model.njnt)
        if j not in driven
        and int(model.jnt_bodyid[j]) in above
        and not all(f"qpos.{n}" in log.columns for n in columns_of(model, j)[0])
    ]
    own = [j for j in loose if int(model.jnt_type[j]) == FREE][:1] or loose
    kinds = {int(model.jnt_type[j]) for j in own}
    if not kinds or not kinds <= {FREE, SLIDE}:
        return None  # the turn of an unlogged hinge would not be known
    body = int(model.jnt_bodyid[own[-1]])
    standing = [g for g in soles(model) if body in carriers(model, int(model.geom_bodyid[g]))]
    if not standing or not floors.size:
        return None
    qpos, dofs = model.jnt_qposadr[own].astype(int), model.jnt_dofadr[own].astype(int)
    turn, spin = np.zeros((2, 0), int)
    if FREE in kinds:
        qpos, turn = np.split(qpos + np.arange(7), [3])
        dofs, spin = np.split(dofs + np.arange(6), [3])
    return Base(tuple(own), body, qpos, dofs, turn, spin, np.array(standing), int(floors[0]))


def imu_of(log: Log, model: mujoco.MjModel, base: Base) -> Imu | None:
    """Return the IMU on the base that says most, and how it is turned; None where there is none."""
    found = list[Imu]()
    for i in np.flatnonzero(model.site_bodyid == base.body):
        quaternions, *rest = (
            _channel(log, [f"{kind}.{model.site(i).name}.{axis}" for axis in axes])
            for kind, axes in (("quat", ("w", *AXES)), ("gyro", AXES), ("accelerometer", AXES))
        )
        turn = None if quaternions is None else rotations(quaternions)
        if turn is not None or all(part is not None for part in rest):  # says how it is turned
            imu = Imu(rotations(model.site_quat[i]), model.site_pos[i].copy(), turn, *rest)
            found.append(imu)
    return max(found, key=lambda imu: sum(part is not None for part in imu), default=None)


def posed(model: mujoco.MjModel, poses: np.ndarray) -> Iterator[mujoco.MjData]:
    """Yield the robot in each of some poses (T, nq); what is yielded is the same and changes."""
    data = mujoco.MjData(model)
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        yield data


def rotations(quaternions: np.ndarray) -> Rotation:
    """Return quaternions (4,) or (T, 4), w first, as rotations."""
    return Rotation.from_quat(quaternions, scalar_first=True)


def _channel(log: Log, names: list[str]) -> np.ndarray | None:
    """Return columns side by side, (T, k); None where one is missing."""
    if not all(name in log.columns for name in names):
        return None
    return np.column_stack([log.columns[name] for name in names])
