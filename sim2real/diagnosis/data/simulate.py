"""What simulation makes of the windows under many candidate values, side by side.

    simulator = Simulator(data)
    result = simulator.run((make("coulomb_friction", where="elbow"),), windows, values)
    result.error                # (R, T, M): simulated minus measured, in normalized units

Each row R is one window under one set of values. The engine steps many rows with all cores by
itself; where effects act between its steps, processes share the rows. A row's numbers are the same
wherever it is simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import partial
from typing import Any, NamedTuple, TypeVar

import mujoco
import numpy as np

from envs.effects import Effect, make
from envs.effects.supply import ThermalDerating
from envs.errors import EffectError
from envs.plant import Fixed, Plant
from envs.replay import (
    InterpolationPoints,
    Schedule,
    groups,
    interpolate,
    readings,
    schedule,
    simulate,
)
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.lean import lean
from sim2real.diagnosis.data.thermal import Heat
from sim2real.diagnosis.data.together import cores, is_free, is_helper, together
from sim2real.diagnosis.data.windows import Window
from sim2real.diagnosis.data.windup import Windup

ACTUATORS = tuple(
    f"actuator_{name}" for name in ("gainprm", "biasprm", "forcerange", "damping", "delay")
)
BYTES = 8  # of a number
# Sizes of batches and processes, which no number of an answer depends on.
BATCH = 5e7  # bytes of one batch
SHARED = 24  # rows from which processes share what Python steps
SHARE = 192  # rows of such a share, at most
T = TypeVar("T")


class Simulated(NamedTuple):
    """What R rows came to."""

    error: np.ndarray  # (R, T, M) simulated minus measured, over scale; 0 where nothing is compared
    slope: np.ndarray  # (R, T, M) its change with the time of reading [1/s]
    lost: np.ndarray  # (R,) s from the window's start at which the row diverged; inf: it did not


class Run(NamedTuple):
    """R rows to be simulated, each a window under values of the effects' parameters."""

    effects: tuple[Effect, ...]
    windows: np.ndarray  # (R,)
    values: np.ndarray  # (R, P)
    off: np.ndarray | None = None  # (R,) str, what each misremembers at its start; "": nothing

    def part(self, rows: np.ndarray) -> Run:
        """Return some of the rows, (n,)."""
        off = None if self.off is None else self.off[rows]
        return Run(self.effects, self.windows[rows], self.values[rows], off)


class Work:
    """Physics steps and seconds of robot time, of all rows that were simulated.

    `on_run` is called after each simulation, for the progress.
    """

    def __init__(self, on_run: Callable[[], None] = lambda: None) -> None:
        self.seconds, self.steps, self.on_run = 0.0, 0, on_run

    def add(self, seconds: float, steps: int) -> None:
        """Count what was simulated."""
        self.seconds, self.steps = self.seconds + seconds, self.steps + steps

    def apart(self, task: Callable[[], T]) -> tuple[T, tuple[float, int]]:
        """Return what a task returns, and what it simulated, which is not counted here."""
        kept, self.seconds, self.steps = (self.seconds, self.steps), 0.0, 0
        try:
            return task(), (self.seconds, self.steps)
        finally:
            self.seconds, self.steps = kept


class _Lean(NamedTuple):
    """A model without what cannot change its motions, as it is simulated."""

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    stepped: dict[tuple[Any, ...], bool]  # by structure of effects: whether Python steps it


def key_of(effect: Effect) -> tuple[Any, ...]:
    """Return what distinguishes an effect's structure from others'."""
    extra = tuple(sorted(effect.extra.items()))
    options = tuple(sorted((k, str(v)) for k, v in effect.options().items()))
    return (effect.name, effect.where, effect.side, effect.how, effect.free, extra, options)


class Simulator:
    """Replays windows of the data.

    Args:
        data: the windows.
        fixed: effects that are known, and part of the model.
        threads: the number of threads of the physics, and of processes; 0 for all cores.
        work: counts what is simulated; None: by itself.
        models: of the data, as what is simulated; None: they are made.
    """

    def __init__(
        self,
        data: Data,
        fixed: Sequence[Fixed] = (),
        threads: int = 0,
        work: Work | None = None,
        models: Sequence[_Lean] | None = None,
    ) -> None:
        self.data, self.fixed, self.threads = data, tuple(fixed), threads
        self.heat, self._windup = Heat(data, self.paths), Windup(data)
        self.work = Work() if work is None else work
        if models is None:
            specs = [lean(spec) for spec in data.specs]
            models = [_Lean(spec, spec.copy().compile(), {}) for spec in specs]
        self._models, self._length = models, data.mask.shape[1]
        self._plans, self._read = [], []  # what is asked for; when each joint was read, (T, M)
        for window in data.windows:
            more = (0, self._length - len(window.sample)), (0, 0)
            dt = data.models[window.model].opt.timestep
            lead = data.late[window.model] if data.late else 0.0
            self._plans.append(schedule(window.recording, dt, lead))
            self._read.append(readings(np.pad(window.sample, more, "edge"), dt))

    def of(self, data: Data) -> Simulator:
        """Return a simulator of other windows of the same models, effects, cores and work."""
        return Simulator(data, self.fixed, self.threads, self.work, self._models)

    def run(self, effects: Sequence[Effect], windows: np.ndarray, values: np.ndarray) -> Simulated:
        """Simulate rows.

        Args:
            effects: what may differ from the model.
            windows: the window of each row, (R,).
            values: of the effects' parameters, (R, P).
        """
        return self.run_each([Run(tuple(effects), windows, values)])[0]

    def run_each(self, runs: Sequence[Run]) -> list[Simulated]:
        """Simulate the rows of several runs.

        What Python steps is done on several cores, side by side, and so is what is small; many rows
        that the engine steps itself are done one chunk after the other, on all cores.
        """
        found, jobs = [], []
        for run in runs:
            shape = (len(run.windows), self._length, len(self.data.joints))
            found.append(Simulated(np.zeros(shape), np.zeros(shape), np.full(shape[0], np.inf)))
        for result, run in zip(found, runs, strict=True):
            effects, windows = run.effects, run.windows
            models = np.array([self.data.windows[i].model for i in windows], int)
            for model in np.unique(models).tolist():
                rows, stepped = np.flatnonzero(models == model), self._is_stepped(effects, model)
                for effect in effects:
                    if isinstance(effect, ThermalDerating):
                        motors = effect.actuators(self.data.models[model])
                        self.heat.learn(windows[rows], motors)
                for chunk in np.array_split(rows, self._pieces(windows[rows], model)):
                    alone = len(chunk) >= SHARED and not stepped
                    for own in self._shares(chunk) if stepped else [chunk]:
                        task = partial(self._chunk, model, run.part(own))
                        jobs.append((task, alone, result, own))
        shared = iter(self.together([task for task, alone, *_ in jobs if not alone]))
        for task, alone, result, own in jobs:
            for all_, some in zip(result, task() if alone else next(shared), strict=True):
                all_[own] = some
        return found

    def together(self, tasks: Sequence[Callable[[], T]]) -> list[T]:
        """Return what tasks return that simulate with this, done on several cores."""
        results = together([partial(self.work.apart, task) for task in tasks], self.threads)
        for _, part in results:
            self.work.add(*part)
        return [result for result, _ in results]

    def _shares(self, rows: np.ndarray) -> list[np.ndarray]:
        """Return rows (n,) in as many shares as there are processes, where that saves time."""
        if len(rows) < SHARED or not is_free():
            return [rows]
        hands = self.threads or cores()
        count = hands * int(np.ceil(len(rows) / (hands * SHARE)))
        return np.array_split(rows, min(count, 2 * len(rows) // SHARED))  # few effects in each

    def _is_stepped(self, effects: Sequence[Effect], model: int) -> bool:
        """Return whether rows take one core: something acts between steps, or a helper asks."""
        if is_helper() or any(plan.law is not None for plan in self._plans):
            return True
        known = self._models[model].stepped
        for own in [(effect,) for effect in effects] or [()]:
            key = tuple(map(key_of, own))
            if key not in known:
                known[key] = bool(self._make(model, own, 1, 1).substep_rules)
            if known[key]:
                return True
        return False

    def _pieces(self, windows: np.ndarray, model: int) -> int:
        steps = max(self._plans[i].steps for i in windows)
        width = self.data.models[model].nq + self.data.models[model].nu
        return max(1, int(np.ceil(len(windows) * steps * width * BYTES / BATCH)))

    def _make(self, model: int, effects: Sequence[Effect], rows: int, threads: int) -> Plant:
        own, threads = self._models[model], 1 if is_helper() else threads
        return Plant(own.spec, effects, rows, threads, fixed=self.fixed, nominal=own.model)

    def paths(
        self, number: int, strengths: np.ndarray | None = None
    ) -> Iterator[tuple[mujoco.MjModel, np.ndarray, Schedule, np.ndarray]]:
        """Yield what the model does in each window of a log, motors weakened; see `Heat`."""
        windows = [i for i, window in enumerate(self.data.windows) if window.log == number]
        if not windows:
            return
        model = self.data.models[index := self.data.windows[windows[0]].model]
        if strengths is None:
            strengths = np.ones((len(windows), model.nu))
        weak = np.flatnonzero((strengths != 1).any(axis=0))
        effects = [make("motor_strength", where=model.actuator(int(i)).name) for i in weak]
        plant = self._make(index, effects, len(windows), self.threads)  # none that is in use
        _set(plant, strengths[:, weak])
        plans, bits = [self._plans[i] for i in windows], groups(model.nu)
        for row, (plan, path) in enumerate(zip(plans, simulate(plant, plans).qpos, strict=True)):
            on = (plan.off[:, None] >> bits & 1) == 0
            yield _actuated(plant, row), path[: plan.steps + 1], plan, on

    def _start(self, plant: Plant, windows: np.ndarray, off: np.ndarray | None) -> None:
        """Let effects remember what came before the windows that a plant's rows replay, (R,)."""
        self.heat.start(plant, windows)
        self._windup.start(plant, windows)
        parts = {part.memory: part for part in (*plant.layout.joints, *plant.substep_rules)}
        for name in () if off is None else np.unique(off[off != ""]).tolist():
            if name not in parts:
                raise EffectError(
                    f"no part of an effect has memory={name!r}, which its `memory` lists; let its "
                    f"substep rule have it (here: {', '.join(sorted(filter(None, parts)))})"
                )
            rows = np.flatnonzero(off == name)
            parts[name].misremember(rows)
            plant.physics.started(rows)

    def _chunk(self, model: int, run: Run) -> Simulated:
        effects, windows, values, off = run
        data, plans = self.data, [self._plans[i] for i in windows]
        threads = 1 if self._is_stepped(effects, model) else self.threads
        plant = self._make(model, effects, len(windows), threads)
        _set(plant, values)
        motion = simulate(plant, plans, lambda: self._start(plant, windows, off))
        steps = int(motion.steps.sum())
        self.work.add(motion.dt * steps, steps)
        at = map(np.stack, zip(*(self._read[i] for i in windows), strict=True))
        places = [joint.qpos for joint in data.joints]
        simulated, change = interpolate(motion.qpos[:, :, places], InterpolationPoints(*at))
        mask = data.mask[windows][..., None]
        error = np.where(mask, (simulated - data.measured[windows]) / data.scale, 0.0)
        slope = np.where(mask, change / motion.dt / data.scale, 0.0)
        spread = [max(joint.spread, data.settings.preflight.count_min) for joint in data.joints]
        limit = data.settings.simulation.error_max * np.array(spread) / data.scale
        error = np.where(np.isfinite(error), np.clip(error, -limit, limit), limit)
        self.work.on_run()
        return Simulated(error, np.nan_to_num(slope), motion.lost)


def errors_as_given(
    data: Data, windows: Sequence[Window], fixed: Sequence[Fixed] = ()
) -> np.ndarray:
    """Return the errors of other windows of the data with the model as given, (W, T, M)."""
    some, every = data.with_windows(windows), np.arange(len(windows))
    return Simulator(some, fixed).run((), every, np.zeros((len(every), 0))).error


def _actuated(plant: Plant, row: int) -> mujoco.MjModel:
    """Return the model with its actuators as a row of a plant has them."""
    model = copy(plant.nominal)
    model.actuator_forcelimited[:] = plant.model.actuator_forcelimited
    for name in ACTUATORS:
        values = plant.batch.expanded(name)
        getattr(model, name)[:] = getattr(plant.model, name) if values is None else values[row]
    return model


def _set(plant: Plant, values: np.ndarray) -> None:
    """Put values (N, P) into a plant's rows, none outside its range."""
    low, high = plant.space.low, plant.space.high
    plant.set_params(np.arange(plant.num_rows), np.clip(values, low, high))
