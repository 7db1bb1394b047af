"""A recording of commands, and what it asks for at each physics step.

plan = schedule(recording, dt=0.002)
plan.ctrl, plan.off          # (K, nu), (K,)
"""

from typing import NamedTuple

import mujoco
import numpy as np

from envs.errors import TaskError

GROUPS = 31  # actuator groups that `opt.disableactuator` can switch, MuJoCo XML reference
STEPS, STEPS_PER_ROW = 1e6, 2e3  # at most, of a recording and for each of its rows
ROUNDING = 1e-9  # s: a stamp this far behind a step counts as at it


class Recording(NamedTuple):
    """A piece of an episode, in the order of a model's joints and actuators."""

    time: np.ndarray  # (T,) s from the start, increasing: when each row's command was written
    ctrl: np.ndarray  # (T, nu) commands, in the actuators' units
    qpos: np.ndarray  # (nq,) measured start [m, rad]
    qvel: np.ndarray  # (nv,) its velocity
    powered: np.ndarray | None = None  # (T, nu) bool: False while a servo was switched off
    held: np.ndarray | None = None  # (nu,) command in force before the start; None: the first one
    read: np.ndarray | None = None  # (T, nq) s: when each position was read; None: at `time`
    # (T, nu, 4) kp, kd, desired speed and feed-forward of actuators under impedance control, in the
    # actuators' own terms; see `impedance`
    law: np.ndarray | None = None
    act: np.ndarray | None = None  # (na,) state of the actuators at the start; None: the model's
    since: np.ndarray | None = None  # (B,) s < 0: when the commands before the start were written
    past: np.ndarray | None = None  # (B, nu) these, the last one being `held`; None: `held` alone


class Schedule(NamedTuple):
    """A recording on the clock of a simulation."""

    qpos: np.ndarray  # (nq,)
    qvel: np.ndarray  # (nv,)
    held: np.ndarray  # (nu,)
    ctrl: np.ndarray  # (K, nu) command in force at each physics step
    off: np.ndarray  # (K,) bit masks of the actuators that are switched off then
    law: np.ndarray | None = None  # (K, nu, 4) in force at each physics step
    act: np.ndarray | None = None  # (na,) state of the actuators at the start
    since: np.ndarray | None = None  # (B,) s < 0: when the commands before the start are sent
    past: np.ndarray | None = None  # (B, nu) these; None: `held` alone

    @property
    def steps(self) -> int:
        """K, the number of physics steps to one step beyond the last row and reading."""
        return len(self.ctrl)


def schedule(recording: Recording, dt: float, lead: float = 0.0) -> Schedule:
    """Return a recording's commands at each physics step of `dt` seconds.

    Args:
        recording: of an episode.
        dt: of a step [s].
        lead: how much earlier than recorded commands are sent [s].

    Raises:
        TaskError: a recording whose time is so long, for its rows, that no memory would hold it.
    """
    last = recording.time[-1] if recording.read is None else recording.read.max()
    steps = int(np.ceil(max(last, recording.time[-1]) / dt - ROUNDING)) + 1
    most = max(STEPS, STEPS_PER_ROW * len(recording.time))
    if steps > most:
        raise TaskError(
            f"{last:.4g} s in {len(recording.time)} rows are {steps:.3g} steps of {dt:g} s, more "
            f"than the {most:.3g} that a replay keeps; correct the recording's `time`, or cut it "
            "where rows are missing"
        )
    clock = np.arange(steps) * dt + ROUNDING
    latest = np.maximum(np.searchsorted(recording.time, clock, side="right") - 1, 0)
    off = np.zeros(steps, np.int64)
    if recording.powered is not None:
        off = _switches(~recording.powered)[latest]
    held = recording.ctrl[0] if recording.held is None else recording.held
    law = None if recording.law is None else recording.law[latest]
    times, commands = recording.time, recording.ctrl
    since, past = None, None
    if recording.since is not None and recording.past is not None:
        times = np.concatenate([recording.since, times])
        commands = np.concatenate([recording.past, commands])
        early = times < lead
        since, past = times[early] - lead, commands[early]
    sent = np.searchsorted(times, clock + lead, side="right") - 1
    ctrl = commands[np.maximum(sent, 0)]
    return Schedule(
        recording.qpos, recording.qvel, held, ctrl, off, law, recording.act, since, past
    )


def groups(actuators: int) -> np.ndarray:
    """Return the group of each actuator of a `switchable` model, (nu,): bits of `off`.

    Each has one of its own up to the last, which the rest share.
    """
    return np.minimum(np.arange(actuators), GROUPS - 1)


def switchable(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of the spec whose actuators can be switched off one by one; see `groups`."""
    spec = spec.copy()
    for actuator, group in zip(spec.actuators, groups(len(spec.actuators)), strict=True):
        actuator.group = int(group)
    return spec


def _switches(off: np.ndarray) -> np.ndarray:
    """Return which groups are off in each row, (T,) bit masks, from actuators (T, nu) bool.

    Raises:
        TaskError: actuators that share a group and are switched at different moments.
    """
    own, shared = off[:, : GROUPS - 1], off[:, GROUPS - 1 :]
    odd = (shared != shared[:, :1]).any(axis=0)
    if odd.any():
        raise TaskError(
            f"actuator {GROUPS + int(np.argmax(odd))} of {off.shape[1]} is switched off at other "
            f"moments than actuator {GROUPS}: those from there on can be switched together only; "
            "put those that are switched alone first in the model"
        )
    every = np.column_stack([own, shared[:, :1]])
    return (every.astype(np.int64) << np.arange(every.shape[1])).sum(axis=1)
