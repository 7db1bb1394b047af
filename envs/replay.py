"""Replaying recorded commands in simulation: what the model would have done in the robot's place.

    plant = Plant(switchable(spec), num_rows=len(recordings))
    positions = replay(plant, recordings)       # one (T, nq) array for each row

A replay starts from the first measured position with the first command held from before. A command
acts at the first simulation step not before its time and holds until the next; what the encoders
would say is interpolated to the recorded times, which may be irregular. Rows may repeat a
recording, to try many candidate parameters on it side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from envs.errors import EnvsError, TaskError
from envs.plant import Plant

GROUPS = 31  # actuator groups that `opt.disableactuator` can switch, MuJoCo XML reference
ROUNDING = 1e-9  # s: a stamp this far behind a step counts as at it


class Recording(NamedTuple):
    """One episode, in the order of a model's joints and actuators."""

    time: np.ndarray  # (T,) s, increasing: when each row's command was written
    ctrl: np.ndarray  # (T, nu) commands, in the actuators' units
    qpos: np.ndarray  # (nq,) measured start [m, rad]
    qvel: np.ndarray  # (nv,) its velocity
    powered: np.ndarray | None = None  # (T, nu) bool: False while a servo was switched off


class DivergedError(EnvsError):
    """A model that cannot follow a recording.

    Args:
        row: the row that broke.
        time: s from the recording's start.
    """

    def __init__(self, row: int, time: float) -> None:
        self.row, self.time = row, time
        super().__init__(
            f"the simulation of recording {row} diverges at {time:.3f} s; try a smaller timestep, "
            "or check masses, gains and units of the model"
        )


def switchable(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of the spec whose actuators can be switched off one by one.

    Raises:
        TaskError: more than 31 actuators.
    """
    spec = spec.copy()
    if len(spec.actuators) > GROUPS:
        raise TaskError(
            f"{len(spec.actuators)} actuators cannot be switched off one by one; up to {GROUPS} can"
        )
    for group, actuator in enumerate(spec.actuators):
        actuator.group = group
    return spec


def with_moments(recording: Recording, moments: np.ndarray) -> Recording:
    """Return the recording with further rows at these moments [s], commands held."""
    time = np.union1d(recording.time, moments)
    row = np.maximum(np.searchsorted(recording.time, time, side="right") - 1, 0)
    powered = None if recording.powered is None else recording.powered[row]
    return recording._replace(time=time, ctrl=recording.ctrl[row], powered=powered)


def replay(plant: Plant, recordings: Sequence[Recording]) -> list[np.ndarray]:
    """Simulate the recordings, one in each row of the plant.

    Args:
        plant: the model and its parameters; made of a `switchable` spec where servos are switched
            off.
        recordings: N, one for each row.

    Returns:
        The positions that the encoders would have reported, N arrays of (T, nq) [m, rad].

    Raises:
        TaskError: a number of recordings that is not the plant's number of rows.
        DivergedError: the first simulation that broke.
    """
    if len(recordings) != plant.num_rows:
        raise TaskError(f"{len(recordings)} recordings for a plant of {plant.num_rows} rows")
    every, dt = np.arange(plant.num_rows), plant.model.opt.timestep
    steps = np.array([int(np.ceil(r.time[-1] / dt - ROUNDING)) for r in recordings])  # (N,)
    plans = [_Plan(r, n, dt) for r, n in zip(recordings, steps, strict=True)]
    start = [np.stack([getattr(r, name) for r in recordings]) for name in ("qpos", "qvel")]
    first = np.stack([r.ctrl[0] for r in recordings])  # (N, nu)
    power = _Power(plant, recordings)
    power.switch(every, plans, 0)
    seeds = np.zeros(plant.num_rows, np.uint64)
    plant.reset(every, start[0], start[1], seeds, ctrl=first, measured=True)
    paths = np.empty((steps.max() + 1, *start[0].shape))  # (K + 1, N, nq)
    paths[0] = plant.measured(None)[0]
    for step in range(steps.max()):
        ids = every[steps > step]
        power.switch(ids, plans, step)
        failed = plant.step(ids, np.stack([plans[i].ctrl[step] for i in ids]), nstep=1)
        if failed.any():
            raise DivergedError(int(ids[failed][0]), (step + 1) * dt)
        paths[step + 1, ids] = plant.measured(ids)[0]
    clock = np.arange(len(paths)) * dt
    return [
        np.column_stack([np.interp(r.time, clock[: n + 1], q) for q in paths[: n + 1, row].T])
        for row, (r, n) in enumerate(zip(recordings, steps, strict=True))
    ]


class _Plan:
    """What is commanded at each simulation step of one recording."""

    def __init__(self, recording: Recording, steps: int, dt: float) -> None:
        clock = np.arange(max(steps, 1)) * dt + ROUNDING
        latest = np.maximum(np.searchsorted(recording.time, clock, side="right") - 1, 0)
        self.ctrl = recording.ctrl[latest]  # (K, nu)
        powered = np.ones_like(recording.ctrl, bool)
        powered = powered if recording.powered is None else recording.powered
        self.off = (~powered[latest] << np.arange(powered.shape[1])).sum(axis=1)  # (K,) bit mask


class _Power:
    """Switches actuators off and on; nothing at all where none is ever off.

    An actuator that is off does not brake either: its `damping` (back-EMF) is 0 meanwhile, which
    disabling alone leaves in force.
    """

    def __init__(self, plant: Plant, recordings: Sequence[Recording]) -> None:
        self._used = any(r.powered is not None and not r.powered.all() for r in recordings)
        if self._used:
            self._batch, self._bits = plant.batch, 1 << np.arange(plant.model.nu)
            self._mask = plant.batch.expand("opt.disableactuator").reshape(plant.num_rows)
            self._damping = plant.batch.expand("actuator_damping")  # (N, nu)
            self._full = self._damping.copy()
            self._off = np.zeros(plant.num_rows, np.int64)  # (N,) bit masks in force

    def switch(self, ids: np.ndarray, plans: Sequence[_Plan], step: int) -> None:
        if not self._used:
            return
        off = np.array([plans[i].off[step] for i in ids])
        changed = off != self._off[ids]
        if changed.any():
            ids, off = ids[changed], off[changed]
            self._off[ids] = self._mask[ids] = off
            self._damping[ids] = np.where(off[:, None] & self._bits, 0.0, self._full[ids])
            self._batch.set_const(ids)
