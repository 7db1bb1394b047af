"""From the state of every row a few rows on: what one-step scores and DROPO compare.

    provider = Steps(data, effects, rows=1)
    provider.errors(values)          # (n, W, k, M): W states, k rows on, M positions and speeds

Each simulation starts at a measured state and is given the logged commands. It needs all positions
and velocities of the model, and even rows. Commands on their way from before are the row's before.
Readings are divided by how much they change in a row, so that an error of 1 is that of a simulation
that stands still.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects import Effect
from envs.plant import Plant
from hardware.log import Log
from sim2real.diagnosis.data.impedance import gear_of, impedance_of
from sim2real.diagnosis.data.recording import check_log, columns_of, load_model, with_bus_delay
from sim2real.diagnosis.settings import TINY
from sim2real.identification.data import Recordings
from sim2real.identification.providers.base import AlignedProvider
from sim2real.identification.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError


class States(NamedTuple):
    """Rows of a log in the order of its model."""

    qpos: np.ndarray  # (R, nq)
    qvel: np.ndarray  # (R, nv)
    ctrl: np.ndarray  # (R, nu)
    episode: np.ndarray  # (R,)
    dt: float  # s between rows


class Steps(AlignedProvider):
    """Transitions of k rows.

    Args:
        data: logs with the state at every row.
        effects: whose values are looked for.
        rows: k, how many rows on.
        settings: see `Settings`.

    Raises:
        Sim2RealError: logs of several models or rates, a state that is not logged, rows that are
            uneven, servos that are switched off, impedance control, or episodes that are too short.
    """

    def __init__(
        self,
        data: Recordings,
        effects: Sequence[Effect],
        rows: int = 1,
        settings: Settings = DEFAULT,
    ) -> None:
        if rows < 1:
            raise Sim2RealError(f"rows={rows} must be at least 1, or null for whole windows")
        spec = with_bus_delay(load_model(data.logs[0], data.model), data.logs[0])
        self._spec, self.effects, self._fixed = spec, tuple(effects), tuple(data.fixed)
        self.rows, self._limit = rows, settings.step_rows
        self._plants: dict[int, Plant] = {}  # the newest, by its number of rows
        model = spec.copy().compile()
        found = [states(log, model, rows, settings) for log in data.logs]
        if len({round(one.dt / settings.uneven / found[0].dt) for one in found}) > 1:
            raise Sim2RealError(
                "the logs have different row intervals, which one-step scores cannot combine; "
                "identify them one by one, or use whole windows (identify.score.rows=null)"
            )
        self._nstep = _substeps(found[0].dt, model, settings)
        starts = [_starts(one.episode, rows) for one in found]
        state = [np.hstack([one.qpos, one.qvel]) for one in found]
        gather = [s[:, None] + np.arange(rows + 1) for s in starts]
        every = np.concatenate([s[g] for s, g in zip(state, gather, strict=True)])  # (W, k+1, M)
        self._start = every[:, 0]
        self._ctrl = np.concatenate(
            [one.ctrl[g[:, :-1]] for one, g in zip(found, gather, strict=True)]
        )  # (W, k, nu)
        self._held = np.concatenate(
            [_before(one, s) for one, s in zip(found, starts, strict=True)]
        )  # (W, nu)
        change = every[:, 1] - every[:, 0]
        scale = np.maximum(change.std(axis=0), TINY)  # (M,)
        moving = change.std(axis=0) > TINY
        self._moving = np.flatnonzero(moving)
        own = [one.episode[s] for one, s in zip(found, starts, strict=True)]
        log = np.repeat(np.arange(len(own)), [len(o) for o in own])
        pairs = np.column_stack([log, np.concatenate(own)])
        episode = np.unique(pairs, axis=0, return_inverse=True)[1].ravel()
        names = [name for name, moves in zip(_names(model), moving, strict=True) if moves]
        self._measured = every[:, 1:, self._moving] / scale[moving]  # (W, k, M)
        neutral = self._plant(1).space.neutral
        chunk = np.arange(len(every)) // settings.stretch
        super().__init__(
            self._measured, episode, scale[moving], names, np.zeros(len(names)), neutral, chunk
        )

    def errors_of(self, pieces: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return simulated minus measured over scale, (R, k, M)."""
        size = min(self._limit, len(pieces))
        plant, found = self._plant(size), []
        for first in range(0, len(pieces), size):
            own = np.arange(first, min(first + size, len(pieces)))
            padded = np.resize(own, size)  # the last batch is filled up with rows of its own
            found.append(self._roll(plant, pieces[padded], values[padded])[: len(own)])
        return np.concatenate(found) / self.scale - self._measured[pieces]

    def _roll(self, plant: Plant, pieces: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the readings after each of k rows, (R, k, M)."""
        every, nq = np.arange(len(pieces)), plant.nominal.nq
        plant.set_params(every, np.clip(values, plant.space.low, plant.space.high))
        start = self._start[pieces]
        seeds = np.zeros(len(pieces), np.uint64)
        plant.reset(every, start[:, :nq], start[:, nq:], seeds, self._held[pieces], measured=True)
        found = np.empty((len(pieces), self.rows, len(self._moving)))
        for row in range(self.rows):
            plant.step(None, self._ctrl[pieces, row], self._nstep)
            found[:, row] = np.hstack(plant.measured(None))[:, self._moving]
        return found

    def _plant(self, rows: int) -> Plant:
        if rows not in self._plants:
            self._plants.clear()
            self._plants[rows] = Plant(self._spec, self.effects, rows, fixed=self._fixed)
        return self._plants[rows]


def states(log: Log, model: mujoco.MjModel, rows: int, settings: Settings = DEFAULT) -> States:
    """Return a log's rows in the order of its model.

    Raises:
        Sim2RealError: see `Steps`.
    """
    check_log(log, model)
    place = log.path or "the log"
    if impedance_of(log) or any(
        (log.columns.get(f"torque.{name}", np.ones(1)) <= 0).any() for name in log.actuators
    ):
        raise Sim2RealError(
            f"{place}: gains in each row, or servos that are switched off, need whole windows; "
            "use identify=cma with identify.score.rows=null"
        )
    qpos, qvel = np.empty((len(log), model.nq)), np.empty((len(log), model.nv))
    for i in range(model.njnt):
        for kind, into, first, names in zip(
            ("qpos", "qvel"),
            (qpos, qvel),
            (int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])),
            columns_of(model, i),
            strict=True,
        ):
            for k, name in enumerate(names):
                into[:, first + k] = _column(log, f"{kind}.{name}")
    ctrl = np.zeros((len(log), model.nu))
    for i in range(model.nu):
        name = f"ctrl.{model.actuator(i).name}"
        if name in log.columns:
            ctrl[:, i] = gear_of(model, i) * log.column(name)
    parts = [part.time for part in log.episodes() if len(part) > rows]
    if not parts:
        raise Sim2RealError(
            f"{place}: no episode is longer than {rows} rows; give a smaller score.rows"
        )
    steps = np.concatenate([np.diff(time) for time in parts])
    dt = float(np.median(steps))
    if np.abs(steps - dt).max() > settings.uneven * dt:
        raise Sim2RealError(
            f"{place}: its rows are {steps.min():.4g} to {steps.max():.4g} s apart; a one-step "
            "score needs equal intervals: use whole windows (score.rows=null)"
        )
    return States(qpos, qvel, ctrl, log.episode, dt)


def _column(log: Log, name: str) -> np.ndarray:
    if name not in log.columns:
        raise Sim2RealError(
            f"{log.path or 'the log'} has no {name}, but a score that starts at every row needs "
            f"the full state there: log it, or use whole windows (score=k_step score.rows=null)"
        )
    return log.column(name)


def _substeps(dt: float, model: mujoco.MjModel, settings: Settings) -> int:
    """Return how many steps of the physics make a row."""
    count = max(1, round(dt / model.opt.timestep))
    if abs(count * model.opt.timestep - dt) > settings.uneven * dt:
        raise Sim2RealError(
            f"rows are {dt:.6g} s apart, which is not a multiple of the model's timestep "
            f"{model.opt.timestep:g} s; change the timestep, or use whole windows (score.rows=null)"
        )
    return count


def _starts(episode: np.ndarray, rows: int) -> np.ndarray:
    """Return the rows that have k more of their episode behind them."""
    found = np.arange(len(episode) - rows)
    return found[episode[found] == episode[found + rows]]


def _before(one: States, starts: np.ndarray) -> np.ndarray:
    """Return the commands before each start, its own at the start of an episode."""
    before = np.maximum(starts - 1, 0)
    same = one.episode[before] == one.episode[starts]
    return one.ctrl[np.where(same, before, starts)]


def _names(model: mujoco.MjModel) -> list[str]:
    both = [columns_of(model, i) for i in range(model.njnt)]
    positions = [f"qpos.{name}" for names, _ in both for name in names]
    return positions + [f"qvel.{name}" for _, names in both for name in names]
