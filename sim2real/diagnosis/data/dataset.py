"""Logs cut into windows: what a diagnosis and a comparison replay.

    data = Data.of(read_logs("logs/"), model="arm.xml")
    data.measured, data.mask                    # (W, T, M), (W, T)

A window is a piece of an episode, replayed from the measured state at its start; its first moments
are simulated and not compared (`warm_s`), so that neither a rough start velocity nor a command on
its way counts. Windows start at moments of little motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from envs.effects.command import delay_commands
from hardware.log import Log
from sim2real.diagnosis.data.impedance import impedance_of
from sim2real.diagnosis.data.noise_floor import count_of, noise_floor, rounding
from sim2real.diagnosis.data.pairs import is_scalar, scalars
from sim2real.diagnosis.data.recording import (
    as_recorded,
    bus_delay,
    check_log,
    load_model,
    shorten,
)
from sim2real.diagnosis.data.refuse import refuse_clock, refuse_loose_base
from sim2real.diagnosis.data.states import with_states
from sim2real.diagnosis.data.windows import Joint, Window, cut
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings
from sim2real.runs.errors import Sim2RealError


@dataclass(frozen=True)
class Data:
    """Windows of all logs, padded to one length T."""

    logs: tuple[Log, ...]
    specs: tuple[mujoco.MjSpec, ...]  # the models, each once; their actuators can be switched off
    models: tuple[mujoco.MjModel, ...]  # each spec, compiled
    joints: tuple[Joint, ...]  # M compared positions
    windows: tuple[Window, ...]  # W of them
    mask: np.ndarray  # (W, T) which rows are compared
    measured: np.ndarray  # (W, T, M)
    settings: Settings = DEFAULT  # of this and all later stages
    late: tuple[float, ...] = ()  # s by which commands arrive later than in each model; empty: 0
    starts: np.ndarray | None = None
    """What one standard deviation of each unknown of a start changes of errors, (W, T, M, D), where
    starts are estimated; None: they are measured."""

    @staticmethod
    def of(
        logs: Sequence[Log], model: str | Path | None = None, settings: Settings = DEFAULT
    ) -> Data:
        """Cut logs of one robot into windows; without a model each log names its own.

        Raises:
            Sim2RealError: no model, a log whose joints never move, or logs without a joint in
                common.
            LogError: a log that names what the model lacks.
        """
        specs, models, which = _models(logs, model)
        own = [models[index] for index in which]
        for log, robot in zip(logs, own, strict=True):
            check_log(log, robot)
        logs = [with_states(log, robot) for log, robot in zip(logs, own, strict=True)]
        joints = _joints(logs, own, settings)
        for log, robot in zip(logs, own, strict=True):
            refuse_loose_base(log, robot, [joint.name for joint in joints])
        _refuse_short(logs, settings)
        _refuse_still(logs, joints, settings)
        windows = cut(logs, which, models, joints, settings.windows)
        about = tuple(logs), tuple(specs), tuple(models), tuple(joints)
        return Data(*about, **_stacked(windows), settings=settings)

    @property
    def scale(self) -> np.ndarray:
        """What errors are divided by, (M,)."""
        return np.array([joint.scale for joint in self.joints])

    @property
    def which(self) -> list[int]:
        """The number of each log's model."""
        own = {window.log: window.model for window in self.windows}
        return [own.get(number, 0) for number in range(len(self.logs))]

    @property
    def log_models(self) -> list[mujoco.MjModel]:
        """The model of each log."""
        return [self.models[index] for index in self.which]

    def floors(self) -> np.ndarray:
        """Return the noise floor of each joint [rad or m], (M,)."""
        found = noise_floor(self.logs, self.settings)
        return np.array([max(found.get(j.name, j.floor), rounding(j.count)) for j in self.joints])

    @property
    def unit(self) -> str:
        """The unit of errors after that: rad or m where all joints agree, else "spread"."""
        units = {joint.unit for joint in self.joints}
        return units.pop() if len(units) == 1 else "spread"

    def blocks(self, seconds: float) -> np.ndarray:
        """Return the block that each row is in, (W, T); -1 where none.

        Args:
            seconds: length of a block, which may span several windows of an episode; what is
                shorter than a second is about a second of one window.
        """
        least, found = self.settings.bootstrap.block_s, np.full(self.mask.shape, -1)
        known: dict[tuple[int, ...], int] = {}
        for i, (window, time) in enumerate(zip(self.windows, self.times(), strict=True)):
            if seconds > least:
                own = [(window.log, window.episode, int(t // seconds)) for t in time]
            else:
                since = window.sample[:, 0] - window.sample[0, 0]
                pieces = max(1, round(since[-1] / least))
                own = [(i, min(int(t / max(since[-1], TINY) * pieces), pieces - 1)) for t in since]
            numbers = [known.setdefault(key, len(known)) for key in own]
            found[i, : len(own)] = np.where(window.usable, numbers, -1)
        return found

    def times(self) -> list[np.ndarray]:
        """Return when the rows of each window were written, (T,) s from their episode's start."""
        return [self.logs[w.log].time[w.first : w.first + len(w.usable)] for w in self.windows]

    def mean_squares(self, error: np.ndarray) -> np.ndarray:
        """Return each joint's mean square over the compared rows, (M,), of errors (W, T, M)."""
        return (error**2).sum(axis=(0, 1)) / max(int(self.mask.sum()), 1)

    def window_squares(self, error: np.ndarray) -> np.ndarray:
        """Return each window's square over its compared rows, (W,), of errors (W, T, M)."""
        return (error**2).sum(axis=(1, 2)) / np.maximum(self.mask.sum(axis=1), 1)

    def with_windows(self, windows: Sequence[Window]) -> Data:
        """Return the data with other windows of the same logs."""
        return replace(self, **_stacked(windows), starts=None)

    def only(self, chosen: np.ndarray) -> Data:
        """Return the data of some windows, (n,) indices."""
        return replace(
            self,
            windows=tuple(self.windows[i] for i in chosen),
            mask=self.mask[chosen],
            measured=self.measured[chosen],
            starts=None if self.starts is None else self.starts[chosen],
        )

    def stepping(self, most: float) -> Data | None:
        """Return the data with models that take longer time steps.

        A delay of less than a step would act as a whole one. So all commands are sent a step early
        and arrive a step later, interpolated.

        Args:
            most: longest step [s]; each model's own is multiplied by the largest integer that fits.

        Returns:
            None if no model can take longer steps.
        """
        specs, late = tuple(spec.copy() for spec in self.specs), list[float]()
        for spec in specs:
            times = max(int(most / spec.option.timestep * (1 + TINY)), 1)
            spec.option.timestep *= times
            late.append(spec.option.timestep if times > 1 else 0.0)
            delay_commands(spec, late[-1])
        if not any(late):
            return None
        models = tuple(spec.copy().compile() for spec in specs)
        return replace(self, specs=specs, models=models, late=tuple(late))

    def halve_steps(self) -> Data:
        """Return the data with models that take time steps half as long."""
        specs = tuple(spec.copy() for spec in self.specs)
        for spec in specs:
            shorten(spec, 2)
        return replace(self, specs=specs, models=tuple(spec.copy().compile() for spec in specs))


def _stacked(windows: Sequence[Window]) -> dict[str, Any]:
    """Return windows, which of their rows are compared and what was measured, padded."""
    longest, mask, measured = max(len(window.usable) for window in windows), [], []
    for window in windows:
        ahead = (0, longest - len(window.usable))
        mask.append(np.pad(window.usable, ahead))
        measured.append(np.pad(window.measured, (ahead, (0, 0)), "edge"))
    return {"windows": tuple(windows), "mask": np.array(mask), "measured": np.array(measured)}


def _models(
    logs: Sequence[Log], model: str | Path | None
) -> tuple[list[mujoco.MjSpec], list[mujoco.MjModel], list[int]]:
    """Return the models, each once, and which one each log has.

    A log that says how long its robot's bus takes gets it as the delay of the model's actuators.
    """
    specs: dict[tuple[str, float, tuple[str, ...]], mujoco.MjSpec] = {}
    which = []
    for log in logs:
        path = log.model if model is None else Path(model)
        key = (str(path.resolve() if path else path), bus_delay(log), impedance_of(log))
        if key not in specs:
            specs[key] = as_recorded(load_model(log, model), log)
        which.append(list(specs).index(key))
    return [*specs.values()], [spec.copy().compile() for spec in specs.values()], which


def _joints(
    logs: Sequence[Log], models: Sequence[mujoco.MjModel], settings: Settings
) -> list[Joint]:
    """Return the hinges and slides that every log and model has."""
    found, still = [], dict(zip(("rad", "m"), settings.preflight.still, strict=True))
    logged = set.intersection(*(set(scalars(log)) for log in logs))
    modelled = set.intersection(*({m.joint(k).name for k in range(m.njnt)} for m in models))
    for i in range(models[0].njnt):
        name = models[0].joint(i).name
        if is_scalar(models[0], i) and name in logged & modelled:
            values = np.concatenate([log.column(f"qpos.{name}") for log in logs])
            unit = "rad" if models[0].jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE else "m"
            step, spread = count_of(logs, name, settings), float(values.std())
            step = step if spread else still[unit]  # it never changed: below what counts as moving
            found.append(Joint(name, int(models[0].jnt_qposadr[i]), unit, step, spread, 1.0))
    if not found:
        raise Sim2RealError("the logs have no hinge or slide in common that their models have too")
    if len({joint.unit for joint in found}) > 1:
        found = [joint._replace(scale=max(joint.spread, still[joint.unit])) for joint in found]
    return found


def _refuse_short(logs: Sequence[Log], settings: Settings) -> None:
    """Raise Sim2RealError if logs are not in seconds, or too short for any interval."""
    least = settings.bootstrap.block_s
    for log in logs:
        refuse_clock(log, settings)
    total = sum(float(part.time[-1] - part.time[0]) for log in logs for part in log.episodes())
    if total < least:
        place = f"{logs[0].path or 'the log'}" + (f" and {len(logs) - 1} more" if logs[1:] else "")
        raise Sim2RealError(
            f"{place}: {total:.3g} s of recordings are too short for a diagnosis, which needs "
            f"{least:g} s; record a minute (run=record), or look at the unit of `time`"
        )


def _refuse_still(logs: Sequence[Log], joints: Sequence[Joint], settings: Settings) -> None:
    counts, least = settings.preflight.counts, settings.preflight.count_min
    still = [j.name for j in joints if j.spread < counts * max(j.count, least)]
    if len(still) == len(joints):
        raise Sim2RealError(
            f"{logs[0].path or 'the log'}: {', '.join(still)} never moved enough to be diagnosed; "
            "record motions with reversals and several speeds (run=record)"
        )
