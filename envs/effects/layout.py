"""The model as given and the one with joints in series: how one's state becomes the other's.

A play or a spring between motor and link is a second joint in the same body, about the same axis,
after the motor's. The link's angle, which is what `qpos` of the model as given means, is then the
sum of both.
"""

from collections.abc import Sequence
from copy import copy
from typing import Any, ClassVar, Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch

from envs.physics.arrays import Array
from envs.physics.base import Physics
from envs.quiet import quiet_engine

SERIES = "/series/"  # in the name of a joint that an effect added


class SeriesJoint(Protocol):
    """A joint that an effect added, as the layout needs it."""

    motor: int  # id of the joint before it, in the simulated model
    joint: int  # its own id there
    q: int  # its columns in the simulated model's qpos and qvel
    v: int
    motor_side: bool  # whether the log's encoder is on the motor's side of it
    memory: str  # see `BoundEffect`

    def settle(self, ids: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return where it rests under the load (n,) [N·m] that the motor carries, (n,) [rad]."""
        ...

    def misremember(self, ids: np.ndarray) -> None:
        """See `BoundEffect`."""
        ...


class Editing(Protocol):
    """The changes that an effect makes to a spec."""

    moves_mass: ClassVar[
        bool
    ]  # whether it moves a body's centre of mass or turns its principal axes

    @property
    def edits(self) -> bool:
        """Whether it does anything."""
        ...

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Do it."""
        ...


def edited(
    spec: mujoco.MjSpec, nominal: mujoco.MjModel, effects: Sequence[Editing]
) -> tuple[mujoco.MjModel, np.ndarray | None]:
    """Return the model of a spec (it stays as it is) with effects; see `compile_structure`.

    Compiling takes longer than all else that makes a plant: what no effect edits is copied. The
    engine takes a short cut for bodies whose mass is centred on their joint, which it must not take
    where an effect moves the mass.
    """
    editing = [effect for effect in effects if effect.edits]
    simple = np.flatnonzero(nominal.body_simple[1:]) + 1
    moving = bool(simple.size) and any(effect.moves_mass for effect in effects)
    if not editing and not moving:
        return copy(nominal), None
    spec = spec.copy()
    for body in simple if moving else ():
        spec.bodies[body].simple = mujoco.mjtLimited.mjLIMITED_FALSE
    for effect in editing:
        effect.edit(spec)
    return compile_structure(spec, nominal)


def compile_structure(
    spec: mujoco.MjSpec, nominal: mujoco.MjModel
) -> tuple[mujoco.MjModel, np.ndarray | None]:
    """Compile a spec, keyframes kept; also return which joints are the nominal ones (None: all)."""
    if len(spec.joints) == nominal.njnt:
        return spec.compile(), None
    keys = [(key, np.array(key.qpos), np.array(key.qvel)) for key in spec.keys]
    for key, _, _ in keys:  # compiling may add empty ones, up to the model's own `nkey`
        key.qpos, key.qvel = [], []
    model = spec.compile()
    keep = np.array([j for j in range(model.njnt) if SERIES not in model.joint(j).name])
    q, v = _addresses(model, keep)
    for key, qpos, qvel in keys:
        if qpos.size:
            key.qpos = _spread(qpos, q, model.nq)
        if qvel.size:
            key.qvel = _spread(qvel, v, model.nv)
    return spec.compile(), keep


def _spread(values: np.ndarray, addresses: np.ndarray, size: int) -> np.ndarray:
    out = np.zeros(size)
    out[addresses] = values
    return out


def _addresses(model: mujoco.MjModel, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the qpos and qvel addresses of joints, in their order."""
    sizes = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}  # free, ball, slide, hinge
    q = [model.jnt_qposadr[j] + i for j in joints for i in range(sizes[int(model.jnt_type[j])][0])]
    v = [model.jnt_dofadr[j] + i for j in joints for i in range(sizes[int(model.jnt_type[j])][1])]
    return np.array(q, dtype=int), np.array(v, dtype=int)


class Layout:
    """Keeps (N, nq) and (N, nv) in the nominal layout over a batch with more joints.

    Args:
        batch: the simulations, in which episodes start.
        nominal: the model as given.
        keep: its joints in the simulated model; None: all are.
        physics: what steps them.

    Attributes:
        raw_qpos: the engine's positions, with those of added joints.
        raw_qvel: its velocities.
        qpos: the link side's positions; the engine's own rows where no joint was added.
        qvel: the link side's velocities.
        joints: the added joints; their effects append themselves.
    """

    def __init__(
        self, batch: Batch, nominal: mujoco.MjModel, keep: np.ndarray | None, physics: Physics
    ) -> None:
        self._batch, self._model, self._keep = batch, batch.model, keep
        self._start_qpos, self._start_qvel = batch.bind("qpos"), batch.bind("qvel")
        self.raw_qpos, self.raw_qvel = physics.bind("qpos"), physics.bind("qvel")
        self.joints: list[SeriesJoint] = []
        if keep is None:
            self.qpos, self.qvel = self.raw_qpos, self.raw_qvel
            return
        self._q, self._v = _addresses(self._model, keep)
        arrays = physics.arrays
        self._kept = arrays.own(self._q), arrays.own(self._v)
        self.qpos = arrays.own(np.tile(nominal.qpos0, (batch.nsim, 1)))
        self.qvel = arrays.zeros((batch.nsim, nominal.nv))
        self._nominal_of = {int(j): i for i, j in enumerate(keep)}
        self._nominal = nominal
        self._bias = batch.bind("qfrc_bias")  # bound here: a field is zero until the call after it

    def address(self, joint: int) -> tuple[int, int]:
        """Return the columns in qpos and qvel of a scalar joint of the simulated model."""
        if self._keep is None:
            return int(self._model.jnt_qposadr[joint]), int(self._model.jnt_dofadr[joint])
        own = self._nominal_of[int(joint)]
        return int(self._nominal.jnt_qposadr[own]), int(self._nominal.jnt_dofadr[own])

    def write(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray, measured: bool) -> None:
        """Put the rows ids into a state; the added joints go where the load leaves them.

        Args:
            ids: rows, (n,).
            qpos: positions of the links, (n, nq); of the encoders where measured.
            qvel: velocities, (n, nv).
            measured: whether the encoders of motor-side joints say qpos.
        """
        if self._keep is None:
            self._start_qpos[ids], self._start_qvel[ids] = qpos, qvel
            return
        raw_qpos, raw_qvel = (
            np.tile(self._model.qpos0, (len(ids), 1)),
            np.zeros((len(ids), self._model.nv)),
        )
        raw_qpos[:, self._q], raw_qvel[:, self._v] = qpos, qvel
        self._start_qpos[ids], self._start_qvel[ids] = raw_qpos, raw_qvel
        with quiet_engine():
            self._batch.forward(ids)
        load = self._bias[ids]  # what the joints must carry, (n, nv)
        for joint in self.joints:
            rest = joint.settle(ids, load[:, self._model.jnt_dofadr[joint.motor]])
            raw_qpos[:, joint.q] = rest
            if not (measured and joint.motor_side):
                raw_qpos[:, self._model.jnt_qposadr[joint.motor]] -= rest
        self._start_qpos[ids] = raw_qpos

    def encoder_positions(self, raw: np.ndarray) -> np.ndarray:
        """Map positions of the simulated model to the encoders' readings, (..., nq) of the nominal.

        A joint on whose motor's side the encoder sits is left out.
        """
        if self._keep is None:
            return raw
        qpos = raw[..., self._q]
        for joint in self.joints:
            if not joint.motor_side:
                qpos[..., self.address(joint.motor)[0]] += raw[..., joint.q]
        return qpos

    def encoder_velocities(self, raw: np.ndarray) -> np.ndarray:
        """Return the same of velocities of the simulated model: (..., nv) of the nominal."""
        if self._keep is None:
            return raw
        qvel = raw[..., self._v]
        for joint in self.joints:
            if not joint.motor_side:
                qvel[..., self.address(joint.motor)[1]] += raw[..., joint.v]
        return qvel

    def read(self, rows: Any) -> None:
        """Bring qpos and qvel up to date with the engine, in rows that it indexes."""
        if self._keep is None:
            return
        raw_qpos, raw_qvel = self.raw_qpos[rows], self.raw_qvel[rows]
        q, v = self._kept
        qpos: Array = raw_qpos[:, q]
        qvel: Array = raw_qvel[:, v]
        for joint in self.joints:
            q, v = self.address(joint.motor)
            qpos[:, q] += raw_qpos[:, joint.q]
            qvel[:, v] += raw_qvel[:, joint.v]
        self.qpos[rows], self.qvel[rows] = qpos, qvel
