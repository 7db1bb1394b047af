"""What simulation makes of the windows under many candidate values, side by side.

    simulator = Simulator(data)
    result = simulator.run((make("coulomb_friction", where="elbow"),), windows, values)
    result.error                # (R, T, M): simulated minus measured, in normalized units

Each row R is one window under one set of values. Plants are kept by their structure and size.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from copy import copy
from typing import Any, NamedTuple

import mujoco
import numpy as np

from envs.effects import Effect, make
from envs.plant import Fixed, Plant
from envs.replay import Readings, Schedule, interpolate, readings, schedule, simulate
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.thermal import Heat
from sim2real.diagnosis.data.windows import Window

ACTUATORS = tuple(
    f"actuator_{name}" for name in ("gainprm", "biasprm", "forcerange", "damping", "delay")
)
BYTES = 8  # of a number


class Simulated(NamedTuple):
    """What R rows came to."""

    error: np.ndarray  # (R, T, M) simulated minus measured, over scale; 0 where nothing is compared
    slope: np.ndarray  # (R, T, M) its change with the time of reading [1/s]
    lost: np.ndarray  # (R,) s from the window's start at which the row diverged; inf: it did not


class _Plan(NamedTuple):
    """What a window needs of the simulation."""

    schedule: Schedule
    at: Readings  # (T, M) when each joint was read


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
        threads: the number of threads of the physics; 0 for all cores.
    """

    def __init__(self, data: Data, fixed: Sequence[Fixed] = (), threads: int = 0) -> None:
        self.data, self.fixed, self.threads = data, tuple(fixed), threads
        self.settings = data.settings.simulation
        self.heat = Heat(data, self._paths)
        self.seconds = 0.0  # of robot time simulated
        self.steps = 0  # of physics, of all rows
        self._plants: OrderedDict[tuple[Any, ...], Plant] = OrderedDict()
        self._stepped: dict[tuple[Any, ...], bool] = {}  # by structure: whether Python steps it
        self._length = data.mask.shape[1]
        self._plans = [self._plan(window) for window in data.windows]
        self._places = np.array([joint.qpos for joint in data.joints])
        self._spread = np.array([joint.spread for joint in data.joints])

    def _plan(self, window: Window) -> _Plan:
        dt = self.data.models[window.model].opt.timestep
        padding = np.repeat(window.sample[-1:], self._length - len(window.sample), axis=0)
        sample = np.concatenate([window.sample, padding])  # (T, M)
        return _Plan(schedule(window.recording, dt), readings(sample, dt))

    def run(self, effects: Sequence[Effect], windows: np.ndarray, values: np.ndarray) -> Simulated:
        """Simulate rows.

        Args:
            effects: what may differ from the model.
            windows: the window of each row, (R,).
            values: of the effects' parameters, (R, P).
        """
        shape = (len(windows), self._length, len(self.data.joints))
        error, slope = np.zeros(shape), np.zeros(shape)
        lost = np.full(len(windows), np.inf)
        model = np.array([self.data.windows[i].model for i in windows])
        for index in np.unique(model):
            rows = np.flatnonzero(model == index)
            for chunk in np.array_split(rows, self._pieces(windows[rows], index)):
                part = self._chunk(effects, int(index), windows[chunk], values[chunk])
                error[chunk], slope[chunk], lost[chunk] = part
        return Simulated(error, slope, lost)

    def _pieces(self, windows: np.ndarray, model: int) -> int:
        steps = max(self._plans[i].schedule.steps for i in windows)
        width = self.data.models[model].nq + self.data.models[model].nu
        return max(
            1, int(np.ceil(len(windows) * steps * width * BYTES / self.settings.batch_bytes))
        )

    def _plant(self, effects: Sequence[Effect], model: int, rows: int) -> Plant:
        key = (model, rows, *map(key_of, effects))
        if key in self._plants:
            self._plants.move_to_end(key)
            return self._plants[key]
        spec, structure = self.data.specs[model], (model, *key[2:])
        few = rows < self.settings.threads_rows
        threads = 1 if self._stepped.get(structure, False) and few else self.threads
        plant = Plant(spec, effects, rows, threads, fixed=self.fixed)
        if structure not in self._stepped:
            self._stepped[structure] = bool(plant.substep_rules)
            if plant.substep_rules:
                return self._plant(effects, model, rows)
        self._plants[key] = plant
        if len(self._plants) > self.settings.plants:
            self._plants.popitem(last=False)
        return plant

    def _paths(
        self, number: int, weak: int | None, strength: float
    ) -> Iterator[tuple[mujoco.MjModel, np.ndarray, Schedule, np.ndarray]]:
        """Yield what the model does in each window of a log, one motor weakened; see `Heat`."""
        windows = np.array([i for i, w in enumerate(self.data.windows) if w.log == number])
        model = self.data.windows[windows[0]].model
        name = None if weak is None else self.data.models[model].actuator(weak).name
        effects = () if name is None else (make("motor_strength", where=name),)
        spec, count = self.data.specs[model], len(windows)
        plant = Plant(spec, effects, count, self.threads, fixed=self.fixed)  # none that is in use
        _set(plant, np.full((count, len(effects)), strength))
        plans = [self._plans[i].schedule for i in windows]
        motion, simulated = simulate(plant, plans), actuated(plant)
        bits = np.arange(plant.model.nu)
        for plan, path in zip(plans, motion.qpos, strict=True):
            on = (plan.off[:, None] >> bits & 1) == 0
            yield simulated, path[: plan.steps + 1], plan, on

    def _chunk(
        self, effects: Sequence[Effect], model: int, windows: np.ndarray, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        data, plans = self.data, [self._plans[i] for i in windows]
        plant = self._plant(effects, model, len(windows))
        _set(plant, values)
        motion = simulate(
            plant, [plan.schedule for plan in plans], lambda: self.heat.start(plant, windows)
        )
        steps = int(motion.steps.sum())
        self.seconds, self.steps = self.seconds + motion.dt * steps, self.steps + steps
        at = Readings(*(np.stack(part) for part in zip(*(plan.at for plan in plans), strict=True)))
        simulated, change = interpolate(motion.qpos[:, :, self._places], at)
        mask = data.mask[windows][..., None]
        error = np.where(mask, (simulated - data.measured[windows]) / data.scale, 0.0)
        slope = np.where(mask, change / motion.dt / data.scale, 0.0)
        limits = self.settings
        limit = np.maximum(limits.error_max * self._spread, limits.spread_min) / data.scale
        error = np.where(np.isfinite(error), np.clip(error, -limit, limit), limit)
        return error, np.nan_to_num(slope), motion.lost


def actuated(plant: Plant) -> mujoco.MjModel:
    """Return the model with its actuators as the first row of a plant has them."""
    model = copy(plant.nominal)
    model.actuator_forcelimited[:] = plant.model.actuator_forcelimited
    for name in ACTUATORS:
        values = plant.batch.expanded(name)
        getattr(model, name)[:] = getattr(plant.model, name) if values is None else values[0]
    return model


def _set(plant: Plant, values: np.ndarray) -> None:
    """Put values (N, P) into a plant's rows, none outside its range."""
    low, high = plant.space.low, plant.space.high
    plant.set_params(np.arange(plant.num_rows), np.clip(values, low, high))
