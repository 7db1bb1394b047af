"""The base of a robot that nothing holds: its joints, what stands on the ground, and its IMU.

    base = base_of(log, model)              # None: the base is held, or its pose is logged
    imu = imu_of(log, model, base)          # None: no IMU on the base

A base is a free joint, or the slides of a boom, that carries compared joints, that no actuator
drives and that the log does not hold.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from envs.effects.contact import ground, soles
from envs.effects.places import driven_joints
from hardware.log import Log
from sim2real.diagnosis.data.pairs import carriers
from sim2real.diagnosis.data.recording import columns_of

FREE, SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Base:
    """What of a robot is not held by its joints' encoders.

    Args:
        joints: numbers of the model's joints.
        body: the body that they carry.
        qpos: where the base's linear positions are in qpos, (n,): three of a free joint, one of a
            slide.
        dofs: where their speeds are in qvel, (n,).
        turn: where the quaternion is in qpos, (4,); empty of slides.
        spin: where the angular velocity is in qvel, (3,); empty of slides.
        soles: geoms that can touch the ground, (F,).
        floor: the geom of the ground.
    """

    joints: tuple[int, ...]
    body: int
    qpos: np.ndarray
    dofs: np.ndarray
    turn: np.ndarray
    spin: np.ndarray
    soles: np.ndarray
    floor: int

    @property
    def is_free(self) -> bool:
        """Whether the base can turn."""
        return bool(self.turn.size)


@dataclass(frozen=True)
class Imu:
    """An IMU on the base.

    Args:
        site: its name.
        turn: the site's orientation in the base's frame, (4,) w x y z.
        place: where it is in that frame [m], (3,).
        orientation: quaternions of the site in the world (T, 4), or None.
        gyro: angular velocity in the site's frame [rad/s], (T, 3), or None.
        acceleration: what it feels in the site's frame [m/s²], (T, 3), or None.
    """

    site: str
    turn: np.ndarray
    place: np.ndarray
    orientation: np.ndarray | None
    gyro: np.ndarray | None
    acceleration: np.ndarray | None


def base_of(log: Log, model: mujoco.MjModel) -> Base | None:
    """Return the base that a log does not hold; None where there is none, or no ground."""
    floors, feet = ground(model), soles(model)
    if not (floors.size and feet.size):
        return None
    driven = driven_joints(model)
    above = {b for j in driven for b in carriers(model, int(model.jnt_bodyid[j]))}
    loose = [
        j
        for j in range(model.njnt)
        if j not in driven
        and int(model.jnt_bodyid[j]) in above
        and not all(f"qpos.{n}" in log.columns for n in columns_of(model, j)[0])
    ]
    free = [j for j in loose if int(model.jnt_type[j]) == FREE]
    own = free[:1] or loose
    if not own or not (free or all(int(model.jnt_type[j]) == SLIDE for j in loose)):
        return None  # the turn of an unlogged hinge would not be known
    first, dof = int(model.jnt_qposadr[own[0]]), int(model.jnt_dofadr[own[0]])
    none = np.zeros(0, int)
    body = int(model.jnt_bodyid[own[-1]])
    standing = np.array(
        [g for g in feet if body in carriers(model, int(model.geom_bodyid[g]))], int
    )
    if not standing.size:
        return None
    if free:
        parts = (first + np.arange(3), dof + np.arange(3), first + 3 + np.arange(4))
        return Base(tuple(own), body, *parts, dof + 3 + np.arange(3), standing, int(floors[0]))
    qpos, dofs = (getattr(model, name)[own].astype(int) for name in ("jnt_qposadr", "jnt_dofadr"))
    return Base(tuple(own), body, qpos, dofs, none, none, standing, int(floors[0]))


def imu_of(log: Log, model: mujoco.MjModel, base: Base) -> Imu | None:
    """Return the IMU of a log that is fixed on the base and says most; None where there is none."""
    found = []
    for i in range(model.nsite):
        name = model.site(i).name
        if int(model.site_bodyid[i]) != base.body:
            continue
        parts = [
            _channel(log, [f"{kind}.{name}.{axis}" for axis in axes])
            for kind, axes in (("quat", ("w", *AXES)), ("gyro", AXES), ("accelerometer", AXES))
        ]
        count = sum(part is not None for part in parts)
        if count:
            one = Imu(name, model.site_quat[i].copy(), model.site_pos[i].copy(), *parts)
            found.append((count, one))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def _channel(log: Log, names: list[str]) -> np.ndarray | None:
    """Return columns side by side, (T, k); None where one is missing."""
    if not all(name in log.columns for name in names):
        return None
    return np.column_stack([log.columns[name] for name in names])
