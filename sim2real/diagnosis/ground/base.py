"""The base of a robot that nothing holds: its joints, what stands on the ground, and its IMU.

    base = base_of(log, model)              # None: the base is held, or its pose is logged
    imu = imu_of(log, model, base)          # None: no IMU on the base

A base is a free joint, or the slides of a boom, that carries compared joints, that no actuator
drives and that the log does not hold.
"""

from dataclasses import dataclass

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
        mount: its site's orientation in the base's frame.
        place: where it is in that frame [m], (3,).
        orientation: of the site in the world, T of them, or None.
        gyro: angular velocity in the site's frame [rad/s], (T, 3), or None.
        acceleration: what it feels in the site's frame [m/s²], (T, 3), or None.
    """

    mount: Rotation
    place: np.ndarray
    orientation: Rotation | None
    gyro: np.ndarray | None
    acceleration: np.ndarray | None

    @property
    def tells_turn(self) -> bool:
        """Whether it says how the base is turned."""
        integrated = self.gyro is not None and self.acceleration is not None
        return self.orientation is not None or integrated


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
    """Return the IMU of a log that is fixed on the base and says most; None where there is none."""
    found = {}
    for i in np.flatnonzero(model.site_bodyid == base.body):
        quaternions, *rest = (
            _channel(log, [f"{kind}.{model.site(i).name}.{axis}" for axis in axes])
            for kind, axes in (("quat", ("w", *AXES)), ("gyro", AXES), ("accelerometer", AXES))
        )
        turn = None if quaternions is None else rotations(quaternions)
        imu = Imu(rotations(model.site_quat[i]), model.site_pos[i].copy(), turn, *rest)
        found.setdefault(sum(part is not None for part in (turn, *rest)), imu)
    most = max(found, default=0)
    return found[most] if most else None


def rotations(quaternions: np.ndarray) -> Rotation:
    """Return quaternions (4,) or (T, 4), w first, as rotations."""
    return Rotation.from_quat(quaternions, scalar_first=True)


def _channel(log: Log, names: list[str]) -> np.ndarray | None:
    """Return columns side by side, (T, k); None where one is missing."""
    if not all(name in log.columns for name in names):
        return None
    return np.column_stack([log.columns[name] for name in names])
