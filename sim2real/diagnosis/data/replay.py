"""How far a log is from its simulation, with nothing fitted.

    python -m sim2real run=replay log=swing.csv model=arm.xml
    python -m sim2real run=replay log=logs/ effects=effects.yaml

The recorded commands go into the model, and the positions that come out are compared with the
measured ones, each at the moment when it was read (`stamp.<joint>`, where the log has it). The
time that the robot's bus takes (`command_delay` in the log's metadata) is part of the model.
`effects` puts known effects into the simulator first: the difference of the two gaps is what they
explain.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.models import load_spec
from envs.plant import Fixed, Plant
from envs.replay import DivergedError, Recording, replay, switchable
from hardware.log import Log, check_names
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
LINEAR = 1  # how MuJoCo's delay lines interpolate
SHOWN = 4  # logs in the picture
WIDTH = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}  # else 1 position a joint


class Gap(NamedTuple):
    """A log, what was measured and what the simulation made of its commands."""

    log: Log
    joints: tuple[str, ...]  # those compared, M
    time: np.ndarray  # (T,) s, of each row's episode
    measured: np.ndarray  # (T, M) rad or m
    simulated: np.ndarray  # (T, M)

    def errors(self) -> dict[str, dict[str, float]]:
        """Return root mean square and mean absolute error of each joint."""
        return {
            joint: _error(self.simulated[:, i] - self.measured[:, i])
            for i, joint in enumerate(self.joints)
        }


def load_model(log: Log, model: str | Path | None) -> mujoco.MjSpec:
    """Return the MJCF for a log; raises Sim2RealError where there is none or it is not valid."""
    path = log.model if model is None else Path(model)
    if path is None:
        raise Sim2RealError(f"{log.path} names no model; give model=PATH.xml")
    try:
        return load_spec(path)
    except TaskError as error:
        raise Sim2RealError(f"{log.path}: {error}; give model=PATH") from None


def measure(log: Log, spec: mujoco.MjSpec, fixed: Sequence[Fixed] = ()) -> Gap:
    """Replay a log's episodes in a model with fixed effects; see the module's text."""
    model = spec.copy().compile()
    _check(log, model)
    episodes = list(log.episodes())
    delayed = with_bus_delay(switchable(spec), log)
    plant = Plant(delayed, num_rows=len(episodes), fixed=fixed)
    columns = _positions(log, model)
    read = [_moments(part, list(columns)) for part in episodes]  # (T, M) s, an episode each
    recordings = [to_recording(part, model) for part in episodes]
    try:
        simulated = replay(plant, recordings, read, list(columns.values()))
    except DivergedError as error:
        episode = episodes[error.row].episode[0]
        raise Sim2RealError(f"{log.path}, episode {episode}: {error}") from None
    measured = np.column_stack([log.column(f"qpos.{name}") for name in columns])
    return Gap(log, tuple(columns), log.time, measured, np.concatenate(simulated))


def with_bus_delay(spec: mujoco.MjSpec, log: Log) -> mujoco.MjSpec:
    """Return a copy of the model whose actuators wait as long as the log's robot's bus does.

    Actuators that have a delay of their own keep it.
    """
    delay, spec = log.meta.get("command_delay", 0.0), spec.copy()
    if isinstance(delay, int | float) and delay > 0:
        samples = math.ceil(delay / spec.option.timestep) + 2
        for actuator in spec.actuators:
            if actuator.delay == 0:
                actuator.delay, actuator.interp = float(delay), LINEAR
                actuator.nsample = max(actuator.nsample, samples)
    return spec


def _moments(log: Log, columns: Sequence[str]) -> np.ndarray:
    """Return when each position of an episode was read, not before its start, (T, M) [s]."""
    read = [log.columns.get(f"stamp.{name}", log.time) for name in columns]
    return np.maximum(np.column_stack(read), log.time[0])


def to_recording(log: Log, model: mujoco.MjModel) -> Recording:
    """Return one episode in the order of the model's joints and actuators.

    Joints that were not logged start from the keyframe `home`, else from the model's default;
    actuators without commands hold the keyframe's, else 0.
    """
    home = next((k for k in range(model.nkey) if model.key(k).name == "home"), None)
    qpos = np.array(model.qpos0 if home is None else model.key_qpos[home])
    held = np.zeros(model.nu) if home is None else model.key_ctrl[home]
    qvel, ctrl = np.zeros(model.nv), np.tile(held, (len(log), 1))
    powered = np.ones((len(log), model.nu), bool)
    for name, place in _positions(log, model).items():
        qpos[place] = log.column(f"qpos.{name}")[0]
    for i in range(model.njnt):
        if f"qvel.{model.joint(i).name}" in log.columns:
            qvel[model.jnt_dofadr[i]] = log.column(f"qvel.{model.joint(i).name}")[0]
    for i in range(model.nu):
        name = model.actuator(i).name
        if f"ctrl.{name}" in log.columns:
            ctrl[:, i] = log.column(f"ctrl.{name}")
        if f"torque.{name}" in log.columns:
            powered[:, i] = log.column(f"torque.{name}") > 0
    return Recording(log.time, ctrl, qpos, qvel, powered)


def _check(log: Log, model: mujoco.MjModel) -> None:
    joints = [model.joint(i).name for i in range(model.njnt)]
    actuators = [model.actuator(i).name for i in range(model.nu)]
    driven = [
        joints[model.actuator_trnid[i, 0]]
        for i, name in enumerate(actuators)
        if name in log.actuators and model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
    ]
    check_names(log, joints, actuators, driven)


def _positions(log: Log, model: mujoco.MjModel) -> dict[str, int]:
    """Return where in qpos each logged position belongs: column name without `qpos.` to address."""
    places = {}
    for i in range(model.njnt):
        name, start = model.joint(i).name, int(model.jnt_qposadr[i])
        width = WIDTH.get(mujoco.mjtJoint(model.jnt_type[i]), 1)
        own = [name] if width == 1 else [f"{name}.{k}" for k in range(width)]
        places |= {n: start + k for k, n in enumerate(own) if f"qpos.{n}" in log.columns}
    return places


def _error(difference: np.ndarray) -> dict[str, float]:
    return {
        "rmse": float(np.sqrt(np.mean(difference**2))),
        "mae": float(np.mean(np.abs(difference))),
    }


def summary(gaps: Sequence[Gap]) -> dict[str, Any]:
    """Return the content of replay.json: errors in rad or m, over all rows and compared joints."""
    every = np.concatenate([(gap.simulated - gap.measured).ravel() for gap in gaps])
    logs = [{"log": str(gap.log.path), "joints": gap.errors()} for gap in gaps]
    return {"logs": logs, **_error(every)}


def write(gaps: Sequence[Gap], out: Path) -> None:
    """Write replay.json, the table and the picture into the folder."""
    found = summary(gaps)
    table = Table(("log", "joint", "rmse", "mae"))
    for gap in gaps:
        for joint, error in gap.errors().items():
            name = gap.log.path.name if gap.log.path else ""
            table.add(name, joint, error["rmse"], error["mae"])
    table.add("all", "", found["rmse"], found["mae"])
    table.notes.append("Errors in rad (hinges) or m (slides), over all rows; nothing was fitted.")
    draw(gaps[:SHOWN], out / "plots" / "replay.png")
    table.write(out / "table")
    write_text(out / "replay.json", json.dumps(found, indent=1))
    log_.info("rmse %.4g, mae %.4g over %d logs", found["rmse"], found["mae"], len(gaps))


def draw(gaps: Sequence[Gap], path: Path) -> None:
    """Draw measured and simulated positions of each log's first episode, a row a joint."""
    rows = max(len(gap.joints) for gap in gaps)
    size = (4.2 * len(gaps), 1.0 + 1.9 * rows)
    with figure(path, rows, len(gaps), size) as (_, axes):
        for column, gap in enumerate(gaps):
            first = gap.log.episode == gap.log.episode[0]
            for row in range(rows):
                panel = axes[row, column]
                if row >= len(gap.joints):
                    panel.set_visible(False)
                    continue
                panel.plot(gap.time[first], gap.measured[first, row], color=INK, label="measured")
                simulated = gap.simulated[first, row]
                panel.plot(gap.time[first], simulated, color=COLOURS[1], label="simulated")
                panel.set_ylabel(f"{gap.joints[row]} (rad or m)")
            axes[0, column].set_title(gap.log.path.stem if gap.log.path else "")
            axes[len(gap.joints) - 1, column].set_xlabel("time (s)")
        axes[0, 0].legend(loc="upper right")
