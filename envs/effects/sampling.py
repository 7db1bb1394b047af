"""When sensors sampled: readings that are older than the moment at which they are reported."""

import math
from typing import Any

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect, Extra, Sizes
from envs.effects.bound import Measurement
from envs.effects.plant_view import PlantView
from envs.effects.sensing import READ
from envs.params import Parameter
from envs.physics.arrays import Array


class SamplingDelay(Measurement):
    """The bound form of `ObservationDelay`: keeps each row's states at its last K control steps."""

    order = 20
    needs_speed = True

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        model, longest = plant.nominal, effect.extra["longest"]
        n, k = plant.num_rows, math.ceil(longest / model.opt.timestep) + 2
        self.arrays = arrays = plant.arrays
        self.now, self.value = plant.time, arrays.zeros(n)
        self.times = arrays.zeros((n, k))
        self.qpos, self.qvel = arrays.zeros((n, k, model.nq)), arrays.zeros((n, k, model.nv))
        self.newest = arrays.zeros(n, np.int64)
        self.fresh = arrays.own(np.ones(n, dtype=bool))
        self._every, self._samples = arrays.own(np.arange(n)), arrays.own(np.arange(k))
        scalar = [
            j for j in range(model.njnt) if model.jnt_type[j] >= int(mujoco.mjtJoint.mjJNT_SLIDE)
        ]
        found = model.jnt_qposadr[scalar], model.jnt_dofadr[scalar]
        self.q, self.v = (arrays.own(one.astype(np.int64)) for one in found)
        turned = [j for j in range(model.njnt) if j not in scalar]
        ends = {0: 3, 1: 0}  # where the quaternion begins: free, ball
        self.quaternions = [
            int(model.jnt_qposadr[j]) + ends[int(model.jnt_type[j])] for j in turned
        ]

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put delays (n, 1) into the rows ids."""
        self.value[self.arrays.rows(ids)] = self.arrays.own(values[:, 0])

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        """Forget what the rows ids showed before."""
        self.fresh[self.arrays.rows(ids)] = True

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        """Put what was true before in the place of what is true now."""
        xp, rows = self.arrays.xp, self._every[ids]
        self._remember(rows, qpos, qvel)
        samples = self.times.shape[1]
        when = self.now[rows] - self.value[rows]
        # oldest first, (n, K)
        slots = (self.newest[rows][:, None] + 1 + self._samples) % samples
        times = xp.take_along_axis(self.times[rows], slots, axis=1)
        after = xp.clip(xp.sum(times <= when[:, None], axis=1), 1, samples - 1)
        every = self._every[: len(rows)]
        old, new = slots[every, after - 1], slots[every, after]
        t0, t1 = times[every, after - 1], times[every, after]
        dt = xp.where(t1 > t0, t1 - t0, 1.0)[:, None]
        s = xp.clip((when - t0)[:, None] / dt, 0.0, 1.0)
        q0, q1, v0, v1 = (
            self.qpos[rows, old],
            self.qpos[rows, new],
            self.qvel[rows, old],
            self.qvel[rows, new],
        )
        past = self._between(q0, q1, v0, v1, s, dt)
        late = self.value[rows] > 0
        qpos[late], qvel[late] = past[late], (v0 + s * (v1 - v0))[late]

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Do the same along whole paths."""
        for row in np.flatnonzero(self.value > 0):
            q, v = qpos[row].copy(), qvel[row].copy()
            when = np.maximum(np.arange(len(q)) - self.value[row] / dt, 0.0)  # steps
            old = when.astype(int)  # before the newest: the delay is more than nothing
            new, s = np.minimum(old + 1, len(q) - 1), (when - old)[:, None]
            qpos[row] = self._between(q[old], q[new], v[old], v[new], s, dt)
            qvel[row] = v[old] + s * (v[new] - v[old])

    def _between(
        self, q0: Array, q1: Array, v0: Array, v1: Array, s: Array, dt: Array | float
    ) -> Array:
        """Return positions at a share s (n, 1) of the way between states: cubic in time."""
        past = q0 + s * (q1 - q0)
        w = s * (1.0 - s)
        bend = w * ((1 - s) * v0[:, self.v] - s * v1[:, self.v]) * dt
        past[:, self.q] += bend - w * (1 - 2 * s) * (q1 - q0)[:, self.q]
        for first in self.quaternions:
            quaternion = past[:, first : first + 4]
            length = self.arrays.xp.linalg.vector_norm(quaternion, axis=1, keepdims=True)
            past[:, first : first + 4] = quaternion / length
        return past

    def _remember(self, rows: Array, qpos: Array, qvel: Array) -> None:
        new = self.fresh[rows]
        if new.any():
            started, samples = rows[new], self.times.shape[1]
            self.qpos[started], self.qvel[started] = qpos[new][:, None], qvel[new][:, None]
            self.times[started] = self.now[started][:, None]
            self.newest[started] = samples - 1
            self.fresh[started] = False
        going = rows[~new]
        self.newest[going] = (self.newest[going] + 1) % self.times.shape[1]
        at = (going, self.newest[going])
        self.times[at], self.qpos[at], self.qvel[at] = self.now[going], qpos[~new], qvel[~new]


class ObservationDelay(Effect):
    """Age of the measured positions and speeds.

    Positions between control steps are interpolated by cubic polynomials. `longest` sets the length
    of the buffer.
    """

    name = "observation_delay"
    engines = BOTH
    place = "robot"
    unit = "s"
    extras = (
        Extra("longest", "s", 0.1, 1e-4, 10.0, "the longest delay that a parameter may have"),
    )
    typical = (0.0, 0.04)
    no_mjcf = READ
    comparable = True
    sizes = Sizes("add", "one", 1e-3, 0.1)
    symptom = "the log lags behind the commands, but the robot does not"
    source = (
        "y(t) = q(t - d): the servo's return delay, the bus and the USB adapter's latency timer"
    )
    experiment = (
        "steps from rest, recorded by a second, fast sensor; without one, an open-loop log"
        " cannot distinguish it from command_delay"
    )
    first_values = (0.003, 0.01, 0.03, 0.07)
    group = PLAIN
    law = SamplingDelay

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the delay."""
        return (self.parameter(low=0.0, high=self.extra["longest"]),)
