"""A log in a model's terms: which model, which columns, and its rows as a recording to replay.

    spec = as_recorded(load_model(log, "arm.xml"), log)
    recording = to_recording(episode, model)                    # a whole episode
    recording = to_recording(log.rows(500, 650), model, rows_before(log, 500))

A replay may start anywhere in an episode. Positions are those of its first row, moved on to the
time of the row if they were read at another. Speeds are those that were logged; where there are
none, 0 at the start of an episode, and elsewhere those that the readings around its first row tell
(see `speeds`). The command in force before the first row is the row's before it; at the start of an
episode it is the first one.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.models import columns_of, load_spec
from envs.replay import Recording, switchable
from hardware.log import Log, check_names
from sim2real.diagnosis.data.impedance import gear_of, laws_of, with_laws
from sim2real.diagnosis.data.pairs import driven_by
from sim2real.diagnosis.data.poses import follow_couplings, home, positions
from sim2real.diagnosis.data.speeds import AROUND, Motion, motion_at
from sim2real.diagnosis.data.states import state_of
from sim2real.runs.errors import Sim2RealError

Columns = Mapping[str, np.ndarray]
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
    """Raise LogError if the log names what the model lacks, or lacks a joint that it drives."""
    joints = [model.joint(i).name for i in range(model.njnt)]
    actuators = [model.actuator(i).name for i in range(model.nu)]
    driven = [driven_by(model, name) for name in actuators if name in log.actuators]
    check_names(log, joints, actuators, [own[1] for own in driven if own is not None])


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


def rows_before(log: Log, row: int) -> Columns | None:
    """Return the columns of the rows just before one; None where it is the first of its episode."""
    start = int(np.argmax(log.episode == log.episode[row]))
    near = slice(max(start, row - AROUND), row)
    return None if row == start else {n: c[near] for n, c in log.columns.items()}


def to_recording(log: Log, model: mujoco.MjModel, before: Columns | None = None) -> Recording:
    """Return rows of an episode in the order of the model's joints and actuators.

    Joints that were not logged start where couplings put them, else from the keyframe
    `home`, else from the model's default; actuators without commands hold the keyframe's, else 0.

    Args:
        log: the rows.
        model: their model.
        before: columns of the rows just before, as `rows_before` returns them; None where these
            rows are the first of their episode, empty where nothing is known of those before.
    """
    qpos, held = home(model)
    ctrl, on = np.tile(held, (len(log), 1)), np.ones((len(log), model.nu), bool)
    read = np.tile(log.time[:, None], model.nq)
    for name, place in positions(log, model).items():
        qpos[place] = log.column(f"qpos.{name}")[0]
        read[:, place] = _stamps(log.columns, name)
    for i in range(model.nu):
        name = model.actuator(i).name
        if f"ctrl.{name}" in log.columns:
            gear = gear_of(model, i)
            ctrl[:, i] = gear * log.column(f"ctrl.{name}")
            held[i] = gear * before[f"ctrl.{name}"][-1] if before else ctrl[0, i]
        on[:, i] = powered(log, name)
    (moved, qvel, _), start = start_motion(log, model, before), log.time[0]
    mujoco.mj_integratePos(model, qpos, moved, 1.0)
    law, act = laws_of(log, model), state_of(log, model)
    qpos, qvel = follow_couplings(model, qpos, qvel, positions(log, model).values())
    own = log.time - start, ctrl, qpos, qvel, on, held, read - start, law, act
    return Recording(*own, *_past(before, model, held, start))


def _past(
    before: Columns | None, model: mujoco.MjModel, held: np.ndarray, start: float
) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
    """Return when commands before a start [s] were written, (B,) s, and these, (B, nu)."""
    if not before:
        return None, None
    past = np.tile(held, (len(before["time"]), 1))
    for i in range(model.nu):
        if (name := f"ctrl.{model.actuator(i).name}") in before:
            past[:, i] = gear_of(model, i) * before[name]
    return before["time"] - start, past


def _stamps(columns: Columns, name: str) -> np.ndarray:
    """Return when a position was read, (T,) [s]; `root.3` has the stamps of `root`, if any."""
    of_joint = columns.get(f"stamp.{name.rpartition('.')[0]}", columns["time"])
    return columns.get(f"stamp.{name}", of_joint)


def start_motion(log: Log, model: mujoco.MjModel, before: Columns | None) -> Motion:
    """Return the motion when the first row of a log begins, (nv,) each.

    Joints that were read at another time have moved since. The velocity is sure where it was
    logged, and where nothing says anything of it: at an episode's start. The columns before are
    those of `to_recording`.
    """
    found = Motion(*np.zeros((3, model.nv)))
    for i in range(model.njnt):
        positions, speeds = columns_of(model, i)
        own = slice(int(model.jnt_dofadr[i]), int(model.jnt_dofadr[i]) + len(speeds))
        after = log.time[0] - _stamps(log.columns, positions[0])[0]
        if all(f"qvel.{name}" in log.columns for name in speeds):
            found.speed[own] = [log.column(f"qvel.{name}")[0] for name in speeds]
            found.moved[own] = found.speed[own] * after
        elif before is not None and all(f"qpos.{name}" in log.columns for name in positions):
            row = len(before.get("time", ()))
            parts = [before, log.columns] if row else [log.columns]
            time = np.concatenate([_stamps(part, positions[0]) for part in parts])
            values = [np.concatenate([p[f"qpos.{n}"] for p in parts]) for n in positions]
            motion = motion_at(time, np.column_stack(values), row, after, late_by(model))
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
