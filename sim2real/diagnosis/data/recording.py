"""A log in a model's terms: which model, which columns, and its rows as a recording to replay.

    spec = as_recorded(load_model(log, "arm.xml"), log)
    recording = to_recording(episode, model)            # a whole episode
    recording = to_recording(log, model, 500, 650)      # rows of one

A replay may start anywhere in an episode. Positions are those of its first row, moved on to the
time of the row if they were read at another. Speeds are those that were logged; where there are
none, 0 at the start of an episode, and elsewhere those that the readings around its first row tell
(see `speeds`). The command in force before the first row is the row's before it; at the start of an
episode it is the first one.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.models import columns_of, load_spec
from envs.replay import Recording, switchable
from hardware.formats.names import ACTUATOR_KINDS, JOINT_KINDS, SOURCE_UNITS
from hardware.formats.units import check_unit
from hardware.log import Log, check_names
from sim2real.diagnosis.data.impedance import gear_of, laws_of, with_laws
from sim2real.diagnosis.data.pairs import driven_by
from sim2real.diagnosis.data.poses import follow_couplings, home, positions
from sim2real.diagnosis.data.speeds import AROUND, Motion, motion_at
from sim2real.diagnosis.data.states import state_of
from sim2real.runs.errors import Sim2RealError

BLOCKED = "flag.blocked"  # the column of rows in which something is in the robot's way
HUNTING = "flag.hunting"  # the column of rows in which a servo's loop hunts
LINEAR = 1  # how MuJoCo's delay lines interpolate
FINEST, COARSEST = 1e-5, 0.1  # s: timesteps that a robot's motion can be simulated with
SPARE = 2  # samples of a delayed actuator beyond those that its delay lasts


def load_model(log: Log, model: str | Path | None) -> mujoco.MjSpec:
    """Return the MJCF for a log.

    Raises:
        Sim2RealError: there is none, or one that cannot be simulated; the message says which.
    """
    path = log.model if model is None else Path(model).expanduser()
    if path is None:
        raise Sim2RealError(f"{log.path} names no model; give model=PATH.xml")
    try:
        spec = load_spec(path)
    except TaskError as error:
        fix = "; give model=PATH" if model is None else ""
        raise Sim2RealError(f"{log.path}: {error}{fix}") from None
    if not spec.actuators:
        raise Sim2RealError(
            f"{path}: the model has no actuators, so a log's commands would move nothing; add "
            '<actuator><position name="elbow" joint="elbow" kp="12"/></actuator>, one for each'
        )
    if not FINEST <= spec.option.timestep <= COARSEST:
        raise Sim2RealError(
            f"{path}: timestep={spec.option.timestep:g} s is not between {FINEST:g} and "
            f'{COARSEST:g}; give <option timestep="0.002"/>'
        )
    _check_compiles(path.resolve(), path.stat().st_mtime_ns)
    return spec


@cache
def _check_compiles(path: Path, changed: int) -> None:
    """Raise Sim2RealError, with the file, where a model cannot be made; asked once a version."""
    try:
        load_spec(path).compile()
    except ValueError as error:
        raise Sim2RealError(f"{path}: {' '.join(str(error).split())}; fix the model") from None


def as_recorded(spec: mujoco.MjSpec, log: Log) -> mujoco.MjSpec:
    """Return a model with switchable actuators that have the log's delay and its rows' gains."""
    return with_laws(with_bus_delay(switchable(spec), log), log)


def bus_delay(log: Log) -> float:
    """Return how long the log's robot's bus takes [s], 0 where the log does not say."""
    delay = log.meta.get("command_delay")
    return float(delay) if isinstance(delay, int | float) else 0.0


def with_bus_delay(spec: mujoco.MjSpec, log: Log) -> mujoco.MjSpec:
    """Return a copy of the model whose actuators wait as long as the log's robot's bus does.

    Actuators that have a delay of their own keep it.
    """
    delay, spec = bus_delay(log), spec.copy()
    for actuator in spec.actuators if delay > 0 else ():
        if actuator.delay == 0:
            actuator.delay, actuator.interp = delay, LINEAR
            _reserve(actuator, spec.option.timestep)
    return spec


def shorten(spec: mujoco.MjSpec, times: int) -> None:
    """Let a model take so many times as many time steps; delayed actuators wait as long."""
    spec.option.timestep /= times
    for actuator in spec.actuators:
        if actuator.delay > 0:
            _reserve(actuator, spec.option.timestep)


def _reserve(actuator: mujoco.MjsActuator, dt: float) -> None:
    """Give a delayed actuator samples for as long as it waits."""
    actuator.nsample = max(actuator.nsample, math.ceil(actuator.delay / dt) + SPARE)


def check_log(log: Log, model: mujoco.MjModel) -> None:
    """Raise LogError for a log that is another model's.

    It names what the model lacks, lacks a joint that an actuator drives, or was mapped in a length
    where the model has a hinge, or in an angle where it has a slide.
    """
    joints = [model.joint(i).name for i in range(model.njnt)]
    actuators = [model.actuator(i).name for i in range(model.nu)]
    driven = {n: own[1] for n in log.actuators if (own := driven_by(model, n)) is not None}
    check_names(log, joints, actuators, driven.values())
    for column, unit in log.meta.get(SOURCE_UNITS, {}).items():
        kind, _, name = column.partition(".")
        joint = driven.get(name) if kind in ACTUATOR_KINDS else name
        if joint in joints and kind in (*ACTUATOR_KINDS, *JOINT_KINDS):
            slide = model.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_SLIDE
            check_unit(unit, f"{log.path or 'the log'}, column {column!r}", slide)


def episode_rows(log: Log) -> Iterator[slice]:
    """Yield the rows of each episode of a log."""
    start = 0
    for part in log.episodes():
        yield slice(start, start := start + len(part))


def is_flagged(log: Log, column: str) -> np.ndarray:
    """Return which rows of a log a column flags, (T,) bool; none where it has no such column."""
    return log.columns.get(column, np.zeros(len(log))) > 0


def powered(log: Log, actuator: str) -> np.ndarray:
    """Return in which rows of a log a servo was switched on, (T,) bool."""
    return log.columns.get(f"torque.{actuator}", np.ones(len(log))) > 0


def flagged(log: Log, column: str, rows: np.ndarray) -> Log:
    """Return a log whose column flags rows, (T,) bool; itself where there are none."""
    columns = {**log.columns, column: rows.astype(float)}
    return replace(log, columns=columns) if rows.any() else log


def with_rows_before(log: Log, first: int, last: int | None = None) -> tuple[Log, int]:
    """Return rows `first` to `last` (exclusive) with those just before, and how many these are.

    There are none before the first row of an episode.
    """
    start = max(int(np.argmax(log.episode == log.episode[first])), first - AROUND)
    return log.rows(start, len(log) if last is None else last), first - start


def to_recording(
    log: Log, model: mujoco.MjModel, first: int = 0, last: int | None = None
) -> Recording:
    """Return rows of an episode in the order of the model's joints and actuators.

    Joints that were not logged start where couplings put them, else from the keyframe
    `home`, else from the model's default; actuators without commands hold the keyframe's, else 0.

    Args:
        log: a log with these rows and, where they are not the first of their episode, those before.
        model: its model.
        first: row at which the recording starts.
        last: row after its last one; None: the end of the log.
    """
    near, row = with_rows_before(log, first, last)
    start, (qpos, held) = near.time[row], home(model)
    time = near.time - start
    ctrl, on = np.tile(held, (len(near), 1)), np.ones((len(near), model.nu), bool)
    for i in range(model.nu):
        name = model.actuator(i).name
        if f"ctrl.{name}" in near.columns:
            ctrl[:, i] = gear_of(model, i) * near.column(f"ctrl.{name}")
        on[:, i] = powered(near, name)
    read, places = np.tile(time[:, None], model.nq), positions(near, model)
    for name, place in places.items():
        qpos[place] = near.column(f"qpos.{name}")[row]
        read[:, place] = _stamps(near, name) - start
    moved, qvel, _ = start_motion(near, model, row)
    mujoco.mj_integratePos(model, qpos, moved, 1.0)
    qpos, qvel = follow_couplings(model, qpos, qvel, places.values())
    own = time[row:], ctrl[row:], qpos, qvel, on[row:], ctrl[max(row - 1, 0)], read[row:]
    part = near.rows(row, len(near))
    past = (time[:row], ctrl[:row]) if row else (None, None)
    return Recording(*own, laws_of(part, model), state_of(part, model), *past)


def _stamps(log: Log, name: str) -> np.ndarray:
    """Return when a position was read, (T,) [s]; `root.3` has the stamps of `root`, if any."""
    of_joint = log.columns.get(f"stamp.{name.rpartition('.')[0]}", log.time)
    return log.columns.get(f"stamp.{name}", of_joint)


def start_motion(near: Log, model: mujoco.MjModel, row: int) -> Motion:
    """Return the motion when a row begins, (nv,) each; the rows are those of `with_rows_before`.

    Joints that were read at another time have moved since. The velocity is sure where it was
    logged, and where nothing says anything of it: at an episode's start.
    """
    found = Motion(*np.zeros((3, model.nv)))
    for i in range(model.njnt):
        positions, speeds = columns_of(model, i)
        own = slice(int(model.jnt_dofadr[i]), int(model.jnt_dofadr[i]) + len(speeds))
        time = _stamps(near, positions[0])
        after = near.time[row] - time[row]
        if all(f"qvel.{name}" in near.columns for name in speeds):
            found.speed[own] = [near.column(f"qvel.{name}")[row] for name in speeds]
            found.moved[own] = found.speed[own] * after
        elif row and all(f"qpos.{name}" in near.columns for name in positions):
            values = np.column_stack([near.column(f"qpos.{name}") for name in positions])
            motion = motion_at(time, values, row, after, late_by(model))
            for whole, part in zip(found, motion, strict=True):
                whole[own] = part
    return found


def late_by(model: mujoco.MjModel) -> float:
    """Return how long before its positions a model's velocities are those of its motion [s].

    Half a step, where positions move with the velocity at the end of each step (semi-implicit
    Euler: MuJoCo, "Numerical integration"); else nothing.
    """
    half = int(model.opt.integrator) != int(mujoco.mjtIntegrator.mjINT_RK4)
    return model.opt.timestep / 2 if half else 0.0
