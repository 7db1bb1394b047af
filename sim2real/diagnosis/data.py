"""Logs cut into windows: what a diagnosis fits to, and what it keeps to be judged by.

    data = Data.of(read_logs("logs/"), model="arm.xml")
    data.measured, data.mask, data.fold         # (W, T, M), (W, T), (W,)

A window is a piece of an episode, replayed from the measured state at its start; its first moments
are simulated and not compared (`WARM`), so that neither a rough start velocity nor a command on its
way counts. Windows start where the robot is calm. Two folds share them: whole episodes where there
are several, else stretches of seconds, and each fold gets the same mixture of calm and lively
ones, with and without torque. What is fitted to one fold is judged by the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from envs.replay import Recording, switchable
from hardware.log import Log, check_names
from sim2real.errors import Sim2RealError
from sim2real.replay import load_model, to_recording

WARM = 0.4  # s simulated before a window's comparison starts
LONGEST, SHORTEST, WINDOWS = 5.0, 0.8, 12  # s, s, and into how many windows a short log is cut
STATE = 0.25  # s of a window where the whole state is logged and no servo pulls errors back
BLOCK = 1.0  # s: errors further apart than this are taken as independent
KICK = 0.3  # s after a servo was switched on again, whose exact moment no log knows
STILL = 3.0  # encoder counts, or 1e-4 of a turn: a joint that moved less than this did not move


class Joint(NamedTuple):
    """One compared position."""

    name: str  # as in the column qpos.<name>
    qpos: int  # its place in the model's qpos
    unit: str  # rad or m
    count: float  # the step between two readings; 0 where they are not rounded
    spread: float  # standard deviation of its motion
    scale: float  # what errors are divided by, so that rad and m meet


class Window(NamedTuple):
    """One piece of an episode; `recording` starts at its warm-up."""

    log: int
    episode: int
    model: int
    first: int  # row of the log at which the comparison starts
    last: int  # row after the last compared one
    recording: Recording
    sample: np.ndarray  # (T, M) s from the recording's start: when each joint was read
    measured: np.ndarray  # (T, M)
    usable: np.ndarray  # (T,) whether a row is compared
    lively: float  # how fast the commands move
    off: float  # share of the time without torque


@dataclass(frozen=True)
class Data:
    """Windows of all logs, padded to one length T.

    Args:
        logs: the logs.
        specs: the models, each once; their actuators can be switched off.
        models: of each spec, compiled.
        joints: M compared positions.
        windows: W of them.
        fold: 0 or 1 for each window, (W,).
        mask: which rows are compared, (W, T).
        measured: (W, T, M).
    """

    logs: tuple[Log, ...]
    specs: tuple[mujoco.MjSpec, ...]
    models: tuple[mujoco.MjModel, ...]
    joints: tuple[Joint, ...]
    windows: tuple[Window, ...]
    fold: np.ndarray
    mask: np.ndarray
    measured: np.ndarray

    @staticmethod
    def of(logs: Sequence[Log], model: str | Path | None = None) -> Data:
        """Cut logs into windows.

        Raises:
            Sim2RealError: no model, a log whose joints never move, or logs without a joint in
                common.
            LogError: a log that names what the model lacks.
        """
        specs, models, which = _models(logs, model)
        for log, index in zip(logs, which, strict=True):
            _check(log, models[index])
        joints = _joints(logs, [models[i] for i in which])
        _refuse_still(logs, joints)
        servo = all(_is_driven(models[0], joint.qpos) for joint in joints)
        windows = _windows(logs, which, models, joints, servo)
        longest = max(len(w.measured) for w in windows)
        mask = _masks(windows, longest)
        measured = np.array([_padded(w.measured, longest) for w in windows])
        return Data(
            tuple(logs),
            tuple(specs),
            tuple(models),
            tuple(joints),
            tuple(windows),
            _folds(windows),
            mask,
            measured,
        )

    @property
    def scale(self) -> np.ndarray:
        """What errors are divided by, (M,)."""
        return np.array([joint.scale for joint in self.joints])

    @property
    def unit(self) -> str:
        """The unit of errors after that: rad or m where all joints agree, else "spread"."""
        units = {joint.unit for joint in self.joints}
        return units.pop() if len(units) == 1 else "spread"

    def blocks(self) -> np.ndarray:
        """Return the block of about a second that each row is in, (W, T); -1 where none."""
        found, count = np.full(self.mask.shape, -1), 0
        for index, window in enumerate(self.windows):
            time = window.sample[:, 0] - window.sample[0, 0]
            pieces = max(1, round(time[-1] / BLOCK)) if len(time) > 1 else 1
            own = np.minimum((time / max(time[-1], 1e-9) * pieces).astype(int), pieces - 1)
            found[index, : len(own)] = np.where(window.usable, count + own, -1)
            count += pieces
        return found

    def only(self, chosen: np.ndarray) -> Data:
        """Return the data of some windows, (n,) indices."""
        return replace(
            self,
            windows=tuple(self.windows[i] for i in chosen),
            fold=self.fold[chosen],
            mask=self.mask[chosen],
            measured=self.measured[chosen],
        )


def whole_episodes(data: Data) -> Data:
    """Return the same logs with each episode as one window, for what is slow and for pictures."""
    windows = []
    for number, log in enumerate(data.logs):
        which = next(w.model for w in data.windows if w.log == number)
        start = 0
        for part in log.episodes():
            rows = (start, start, start + len(part))
            windows.append(_cut(log, number, which, data.models[which], data.joints, rows, start))
            start += len(part)
    longest = max(len(w.measured) for w in windows)
    mask = _masks(windows, longest)
    measured = np.array([_padded(w.measured, longest) for w in windows])
    return replace(
        data, windows=tuple(windows), fold=np.zeros(len(windows), int), mask=mask, measured=measured
    )


def _masks(windows: Sequence[Window], length: int) -> np.ndarray:
    """Return which rows of the windows are compared, (W, length)."""
    mask = np.zeros((len(windows), length), bool)
    for row, window in zip(mask, windows, strict=True):
        row[: len(window.usable)] = window.usable
    return mask


def _padded(values: np.ndarray, length: int) -> np.ndarray:
    return np.concatenate([values, np.repeat(values[-1:], length - len(values), axis=0)])


def _models(
    logs: Sequence[Log], model: str | Path | None
) -> tuple[list[mujoco.MjSpec], list[mujoco.MjModel], list[int]]:
    """Return the models, each once, and which one each log has.

    A log that says how long its robot's bus takes gets it as the delay of the model's actuators.
    """
    specs: list[mujoco.MjSpec] = []
    keys: list[tuple[str, float]] = []
    which = []
    for log in logs:
        path = log.model if model is None else Path(model)
        delay = log.meta.get("command_delay", 0.0)
        delay = float(delay) if isinstance(delay, int | float) else 0.0
        key = (str(path.resolve() if path else path), delay)
        if key not in keys:
            spec = switchable(load_model(log, model))
            _delay(spec, delay)
            keys.append(key)
            specs.append(spec)
        which.append(keys.index(key))
    return specs, [spec.copy().compile() for spec in specs], which


def _delay(spec: mujoco.MjSpec, delay: float) -> None:
    if delay <= 0:
        return
    for actuator in spec.actuators:
        if actuator.delay == 0:
            actuator.delay, actuator.interp = delay, 1
            actuator.nsample = max(actuator.nsample, int(np.ceil(delay / spec.option.timestep)) + 2)


def _check(log: Log, model: mujoco.MjModel) -> None:
    joints = [model.joint(i).name for i in range(model.njnt)]
    actuators = [model.actuator(i).name for i in range(model.nu)]
    driven = [
        joints[model.actuator_trnid[i, 0]]
        for i, name in enumerate(actuators)
        if name in log.actuators and model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
    ]
    check_names(log, joints, actuators, driven)


def _joints(logs: Sequence[Log], models: Sequence[mujoco.MjModel]) -> list[Joint]:
    """Return the hinges and slides that every log and model has."""
    found = []
    for i in range(models[0].njnt):
        name, kind = models[0].joint(i).name, int(models[0].jnt_type[i])
        column = f"qpos.{name}"
        if kind not in (2, 3) or not all(column in log.columns for log in logs):
            continue
        if any(name not in [m.joint(k).name for k in range(m.njnt)] for m in models):
            continue
        values = np.concatenate([log.column(column) for log in logs])
        unit = "rad" if kind == int(mujoco.mjtJoint.mjJNT_HINGE) else "m"
        spread = float(values.std())
        place = int(models[0].jnt_qposadr[i])
        found.append(Joint(name, place, unit, count_of(values), spread, 1.0))
    if not found:
        raise Sim2RealError("the logs have no hinge or slide in common that their models have too")
    if len({joint.unit for joint in found}) > 1:
        found = [joint._replace(scale=max(joint.spread, 1e-6)) for joint in found]
    return found


def count_of(values: np.ndarray) -> float:
    """Return the step between two readings of an encoder, 0 if they are not rounded."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9]
    if len(steps) < 3:
        return 0.0
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    whole = np.abs(steps / step - np.round(steps / step)) < 0.02
    return step if step > 1e-6 and whole[steps < 50 * step].mean() > 0.95 else 0.0


def _refuse_still(logs: Sequence[Log], joints: Sequence[Joint]) -> None:
    still = [j.name for j in joints if j.spread < STILL * max(j.count, 1e-4)]
    if len(still) == len(joints):
        names = ", ".join(still)
        place = logs[0].path or "the log"
        raise Sim2RealError(
            f"{place}: {names} never moved enough to tell anything; record motions with reversals "
            "and several speeds (run=record)"
        )


def _is_driven(model: mujoco.MjModel, qpos: int) -> bool:
    """Return whether a position servo drives the joint at that address."""
    return any(
        is_joint_servo(model, i) and model.jnt_qposadr[model.actuator_trnid[i, 0]] == qpos
        for i in range(model.nactuator)
    )


def _windows(
    logs: Sequence[Log],
    which: Sequence[int],
    models: Sequence[mujoco.MjModel],
    joints: Sequence[Joint],
    servo: bool,
) -> list[Window]:
    parts = [(n, part) for n, log in enumerate(logs) for part in log.episodes()]
    total = sum(part.time[-1] - part.time[0] for _, part in parts)
    length = float(np.clip(total / WINDOWS, SHORTEST, LONGEST)) if servo else STATE
    windows, start, before = [], 0, -1
    for number, part in parts:
        start = start if number == before else 0
        before = number
        pieces = max(1, round(float(part.time[-1] - part.time[0]) / length))
        cuts = _cuts(part, joints, pieces) if servo else _even(part, pieces)
        for first, last in pairwise(cuts):
            warm = int(np.searchsorted(part.time, part.time[first] - (WARM if servo else 0.0)))
            rows = (start + warm, start + first, start + last)
            if last - first > 1:
                own = which[number]
                windows.append(_cut(logs[number], number, own, models[own], joints, rows, start))
        start += len(part)
    if not windows:
        raise Sim2RealError("the logs are too short to be cut into windows; record a few seconds")
    return windows


def _even(part: Log, pieces: int) -> np.ndarray:
    return np.unique(np.linspace(0, len(part), pieces + 1).astype(int))


def _cuts(part: Log, joints: Sequence[Joint], pieces: int) -> np.ndarray:
    """Return the rows at which windows begin, and the end: about evenly, at calm moments."""
    time, even = part.time, _even(part, pieces)
    if pieces == 1:
        return even
    unrest = np.zeros(len(part))
    for joint in joints:
        speed = np.abs(np.gradient(part.column(f"qpos.{joint.name}"), time))
        unrest += speed / max(joint.spread, 1e-9)
    for name in part.actuators:
        command = part.column(f"ctrl.{name}")
        spread = max(float(command.std()), 1e-9)
        unrest += np.abs(np.gradient(command, time)) / spread
        if f"torque.{name}" in part.columns:
            unrest += 100.0 * (part.column(f"torque.{name}") <= 0)
    rate = (len(time) - 1) / (time[-1] - time[0])
    warm = max(1, round(WARM * rate))
    smooth = np.convolve(unrest, np.ones(5) / 5, "same")
    reach = max(1, int(0.25 * len(part) / pieces))
    cuts = [0]
    for cut in even[1:-1]:
        start = np.arange(cut - reach, cut + reach) - warm  # where its warm-up would begin
        start = start[(start > cuts[-1]) & (start + warm < len(part) - 2)]
        cuts.append(int(start[np.argmin(smooth[start])]) + warm if start.size else int(cut))
    return np.unique([*cuts, len(part)])


def _cut(
    log: Log,
    number: int,
    which: int,
    model: mujoco.MjModel,
    joints: Sequence[Joint],
    rows: tuple[int, int, int],
    episode_start: int,
) -> Window:
    """Return the window whose warm-up, comparison and end are at these rows of a log."""
    warm, first, last = rows
    inside = slice(warm, last)
    columns = {name: values[inside] for name, values in log.columns.items()}
    recording = to_recording(Log(columns, log.meta, log.path), model)
    origin = float(log.time[warm])
    if warm > episode_start:
        recording = recording._replace(qvel=_velocity(log, model, warm, episode_start, last))
        held = np.concatenate([to_ctrl(log, model, warm - 1)[None], recording.ctrl])
        powered = recording.powered
        powered = None if powered is None else np.concatenate([powered[:1], powered])
        time = np.concatenate([[0.0], recording.time - origin + 1e-6])
        recording = recording._replace(time=time, ctrl=held, powered=powered)
    else:
        recording = recording._replace(time=recording.time - origin)
    scored = slice(first, last)
    stamps = [f"stamp.{joint.name}" for joint in joints]
    sample = np.column_stack(
        [log.columns.get(s, log.time)[scored] - origin for s in stamps]
    )  # (T, M)
    measured = np.column_stack([log.column(f"qpos.{joint.name}")[scored] for joint in joints])
    spread = np.array([joint.spread for joint in joints])
    moving = [np.abs(np.diff(measured, axis=0)).mean(axis=0) / np.maximum(spread, 1e-9)]
    off = 0.0 if recording.powered is None else float(1 - recording.powered.mean())
    lively = float(np.mean(moving)) / max(float(np.diff(log.time[scored]).mean()), 1e-9)
    episode = int(log.episode[first])
    usable = _usable(log, warm, last)[first - warm :]
    rest = (sample, measured, usable, lively, off)
    return Window(number, episode, which, first, last, recording, *rest)


def _usable(log: Log, first: int, last: int) -> np.ndarray:
    """Return which rows say what a replay can know, (T,).

    Not a reading that was missing and held, and not the moments after a servo was switched on.
    """
    time = log.time[first:last]
    good = np.ones(last - first, bool)
    if "flag.fresh" in log.columns:
        good &= log.columns["flag.fresh"][first:last] > 0
    for name in log.actuators:
        column = f"torque.{name}"
        if column in log.columns:
            on = np.diff((log.columns[column][first:last] > 0).astype(int)) > 0
            for moment in time[1:][on]:
                good &= (time < moment - 0.03) | (time > moment + KICK)
    return good if good.sum() > 1 else np.ones(last - first, bool)


def to_ctrl(log: Log, model: mujoco.MjModel, row: int) -> np.ndarray:
    """Return the commands of one row, (nu,)."""
    two = {name: values[row : row + 2] for name, values in log.columns.items()}
    return to_recording(Log(two, log.meta, log.path), model).ctrl[0]


def _velocity(log: Log, model: mujoco.MjModel, row: int, start: int, end: int) -> np.ndarray:
    """Return the joints' velocities at a row: the slope of a line through its neighbours, (nv,)."""
    near = slice(max(start, row - 2), min(end, row + 3))
    qvel = np.zeros(model.nv)
    for i in range(model.njnt):
        name = model.joint(i).name
        if int(model.jnt_type[i]) in (2, 3) and f"qpos.{name}" in log.columns:
            time = log.columns.get(f"stamp.{name}", log.time)[near]
            values = log.column(f"qpos.{name}")[near]
            qvel[model.jnt_dofadr[i]] = np.polyfit(time - time.mean(), values, 1)[0]
    return qvel


def _folds(windows: Sequence[Window]) -> np.ndarray:
    """Return 0 or 1 for each window: like with like, in the order 0 1 1 0."""
    episodes = list(dict.fromkeys((w.log, w.episode) for w in windows))
    whole = len(episodes) >= 4
    groups = episodes if whole else list(range(len(windows)))
    key = [(w.log, w.episode) if whole else i for i, w in enumerate(windows)]

    def traits(group: object) -> tuple[float, float]:
        own = [w for w, k in zip(windows, key, strict=True) if k == group]
        return float(np.mean([w.off for w in own]) > 0.02), float(np.mean([w.lively for w in own]))

    order = sorted(groups, key=traits)
    side = {group: (0, 1, 1, 0)[place % 4] for place, group in enumerate(order)}
    return np.array([side[k] for k in key])
