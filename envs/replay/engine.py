"""From recordings to positions: start the rows, roll them, read their encoders.

See the package for the rules.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from envs.effects.history import CommandHistory
from envs.errors import EnvsError, TaskError
from envs.plant import Plant
from envs.replay.derivative import add_derivatives
from envs.replay.recording import ROUNDING, Recording, Schedule, schedule
from envs.replay.rollout import rollout


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


class InterpolationPoints(NamedTuple):
    """Moments on the clock of a simulation, of any shape."""

    before: np.ndarray  # the physics step at or before each
    share: np.ndarray  # of the way to the next step, in [0, 1)


class Motion(NamedTuple):
    """The simulated paths of N rows."""

    dt: float  # s between physics steps
    qpos: np.ndarray  # (N, K + 1, nq) what the encoders say; NaN from where a row diverged
    steps: np.ndarray  # (N,) of each row's own schedule; beyond, its last position is held

    @property
    def lost(self) -> np.ndarray:
        """When each row diverged [s], (N,); inf: it did not."""
        bad = np.isnan(self.qpos).any(axis=2)  # (N, K + 1)
        bad &= np.arange(self.qpos.shape[1]) <= self.steps[:, None]
        return np.where(bad.any(axis=1), bad.argmax(axis=1) * self.dt, np.inf)

    def at_rows(
        self, row: int, recording: Recording, columns: Sequence[int] | None = None
    ) -> np.ndarray:
        """Return a row's encoder readings at the times of a recording's positions, (T, M).

        Args:
            row: of the plant; it replayed that recording.
            recording: of T rows.
            columns: M places in qpos; None for all.
        """
        path, every = self.qpos[row], range(self.qpos.shape[2])
        chosen = list(every if columns is None else columns)
        read = recording.time[:, None] if recording.read is None else recording.read[:, chosen]
        before, share = readings(read, self.dt)
        return interpolate(path[None][..., chosen], InterpolationPoints(before[None], share[None]))[
            0
        ][0]


def readings(times: np.ndarray, dt: float) -> InterpolationPoints:
    """Return moments [s] on the clock of a simulation; before its start it moved as it begins."""
    at = times / dt
    before = np.maximum(at, 0.0).astype(int)
    return InterpolationPoints(before, at - before)


def interpolate(qpos: np.ndarray, at: InterpolationPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return positions at some moments, and their change until the next physics step.

    Args:
        qpos: positions at physics steps, (N, K + 1, M).
        at: moments, (N, T, M) or (N, T, 1).

    Returns:
        Two arrays (N, T, M).
    """
    row, joint = np.arange(len(qpos))[:, None, None], np.arange(qpos.shape[2])
    here, after = qpos[row, at.before, joint], qpos[row, at.before + 1, joint]
    change = after - here
    return here + at.share * change, change


def simulate(
    plant: Plant, plans: Sequence[Schedule], warm: Callable[[], None] | None = None
) -> Motion:
    """Simulate schedules, one in each row of the plant, under the parameters that it has.

    Args:
        plant: the model and its parameters; made of a `switchable` spec where servos are switched
            off.
        plans: N, one for each row.
        warm: called between reset and first step, for what effects remember from before the start.

    Raises:
        TaskError: a number of schedules that is not the plant's number of rows.
    """
    if len(plans) != plant.num_rows:
        raise TaskError(f"{len(plans)} recordings for a plant of {plant.num_rows} rows")
    every, steps = np.arange(plant.num_rows), np.array([plan.steps for plan in plans])
    qpos, qvel, held = (np.stack([getattr(p, n) for p in plans]) for n in ("qpos", "qvel", "held"))
    known = [plan.act for plan in plans if plan.act is not None]
    act = np.stack(known) if len(known) == len(plans) else None
    seeds = np.zeros(len(every), np.uint64)
    plant.reset(every, qpos, qvel, seeds, ctrl=held, measured=True, act=act)
    if plant.model.nhistory and any(plan.past is not None for plan in plans):
        _remember(plant, plans, held)
    if warm is not None:
        warm()
    longest = int(steps.max())
    ctrl = np.stack([_extended(plan.ctrl, longest) for plan in plans])  # (N, K, nu)
    ctrl = add_derivatives(plant.model, ctrl, held)
    off = np.stack([_extended(plan.off, longest) for plan in plans])  # (N, K)
    known = [plan.law for plan in plans if plan.law is not None]
    if 0 < len(known) < len(plans):
        raise TaskError("only some recordings contain gains (impedance control); separate them")
    law = np.stack([_extended(one, longest) for one in known]) if known else None  # (N, K, nu, 4)
    return Motion(plant.model.opt.timestep, rollout(plant, ctrl, off, law, steps), steps)


def _remember(plant: Plant, plans: Sequence[Schedule], held: np.ndarray) -> None:
    """Let delay lines hold what was sent before the start, changed as `held`, (N, nu), was."""
    samples = int(plant.model.actuator_history[:, 0].max())
    moments = -plant.model.opt.timestep * np.arange(samples, 0, -1)
    past = np.stack([_sent_before(plan, moments) for plan in plans])  # (N, samples, nu)
    moved = plant.batch.bind("ctrl") - held  # by an encoder's offset
    every = np.arange(plant.num_rows)
    CommandHistory(plant).fill(every, past + moved[:, None])
    plant.physics.started(every)


def _sent_before(plan: Schedule, moments: np.ndarray) -> np.ndarray:
    """Return the commands in force at moments [s] before the start, (P, nu)."""
    if plan.since is None or plan.past is None:
        return np.tile(plan.held, (len(moments), 1))
    latest = np.searchsorted(plan.since, moments + ROUNDING, side="right") - 1
    return plan.past[np.maximum(latest, 0)]


def replay(
    plant: Plant, recordings: Sequence[Recording], columns: Sequence[int] | None = None
) -> list[np.ndarray]:
    """Replay recordings, one in each row of the plant, under the parameters that it has.

    Args:
        plant: see `simulate`.
        recordings: N, one for each row.
        columns: M places in qpos that are read; None for all.

    Returns:
        What the encoders would have said when they were read, N arrays of (T, M) [m, rad].

    Raises:
        TaskError: a number of recordings that is not the plant's number of rows.
        DivergedError: the first simulation that broke.
    """
    dt = plant.model.opt.timestep
    motion = simulate(plant, [schedule(recording, dt) for recording in recordings])
    lost = motion.lost
    if np.isfinite(lost).any():
        first = int(lost.argmin())
        raise DivergedError(first, float(lost[first]))
    return [motion.at_rows(row, one, columns) for row, one in enumerate(recordings)]


def _extended(values: np.ndarray, length: int) -> np.ndarray:
    """Return the values with the last one repeated up to a length."""
    return np.concatenate([values, np.repeat(values[-1:], length - len(values), axis=0)])
