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
from envs.replay import ROUNDING, Recording
from envs.rollout import roll
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.thermal import Heat
from sim2real.diagnosis.data.windows import Window

LOST = 10.0  # times a joint's spread: the error of a simulation that diverged
PLANTS = 12  # kept at a time
MANY = 400  # rows from which threads pay in a plant that is stepped from Python
ACTUATORS = tuple(
    f"actuator_{name}" for name in ("gainprm", "biasprm", "forcerange", "damping", "delay")
)
LARGEST = 2.5e8  # bytes of one batch's paths


class Simulated(NamedTuple):
    """What R rows came to."""

    error: np.ndarray  # (R, T, M) simulated minus measured, over scale; 0 where nothing is compared
    slope: np.ndarray  # (R, T, M) its change with the time of reading [1/s]
    lost: np.ndarray  # (R,) s from the window's start at which the row diverged; inf: it did not


class _Plan(NamedTuple):
    """What a window needs of the simulation."""

    steps: int
    ctrl: np.ndarray  # (K, nu)
    off: np.ndarray  # (K,) bit masks
    before: np.ndarray  # (T, M) step before each reading
    share: np.ndarray  # (T, M) of the way to the next step


def key_of(effect: Effect) -> tuple[Any, ...]:
    """Return what tells an effect's structure from others'."""
    extra = tuple(sorted(effect.extra.items()))
    options = tuple(sorted((k, str(v)) for k, v in effect.options().items()))
    return (effect.name, effect.where, effect.side, effect.how, effect.free, extra, options)


class Simulator:
    """Replays windows of the data.

    Args:
        data: the windows.
        fixed: effects that are known, and part of the model.
        threads: of the physics; 0 for all cores.
    """

    def __init__(self, data: Data, fixed: Sequence[Fixed] = (), threads: int = 0) -> None:
        self.data, self.fixed, self.threads = data, tuple(fixed), threads
        self.heat = Heat(data, self._paths)
        self.seconds = 0.0  # of robot time simulated
        self._plants: OrderedDict[tuple[Any, ...], Plant] = OrderedDict()
        self._stepped: dict[tuple[Any, ...], bool] = {}  # by structure: whether Python steps it
        self._length = data.mask.shape[1]
        self._plans = [self._plan(window) for window in data.windows]
        self._places = np.array([joint.qpos for joint in data.joints])
        self._spread = np.array([joint.spread for joint in data.joints])

    def _plan(self, window: Window) -> _Plan:
        dt = self.data.models[window.model].opt.timestep
        recording = window.recording
        steps = int(np.ceil(max(window.sample.max(), recording.time[-1]) / dt - ROUNDING)) + 1
        clock = np.arange(steps) * dt + ROUNDING
        latest = np.maximum(np.searchsorted(recording.time, clock, side="right") - 1, 0)
        powered = recording.powered
        off = np.zeros(steps, np.int64)
        if powered is not None:
            off = (~powered[latest] << np.arange(powered.shape[1])).sum(axis=1)
        at = np.clip(window.sample / dt, 0, steps - 1e-9)  # (T, M)
        at = np.concatenate([at, np.repeat(at[-1:], self._length - len(at), axis=0)])
        before = at.astype(int)
        return _Plan(steps, recording.ctrl[latest], off, before, at - before)

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
        steps = max(self._plans[i].steps for i in windows)
        width = self.data.models[model].nq + self.data.models[model].nu
        return max(1, int(np.ceil(len(windows) * steps * width * 8 / LARGEST)))

    def _plant(self, effects: Sequence[Effect], model: int, rows: int) -> Plant:
        key = (model, rows, *map(key_of, effects))
        if key in self._plants:
            self._plants.move_to_end(key)
            return self._plants[key]
        spec, structure = self.data.specs[model], (model, *key[2:])
        threads = 1 if self._stepped.get(structure, False) and rows < MANY else self.threads
        plant = Plant(spec, effects, rows, threads, fixed=self.fixed)
        if structure not in self._stepped:
            self._stepped[structure] = bool(plant.substep_rules)
            if plant.substep_rules:
                return self._plant(effects, model, rows)
        self._plants[key] = plant
        if len(self._plants) > PLANTS:
            self._plants.popitem(last=False)
        return plant

    def _paths(
        self, number: int, weak: int | None, strength: float
    ) -> Iterator[tuple[mujoco.MjModel, np.ndarray, np.ndarray, np.ndarray]]:
        """Yield what the model does in each window of a log, one motor weakened; see `Heat`."""
        windows = np.array([i for i, w in enumerate(self.data.windows) if w.log == number])
        model = self.data.windows[windows[0]].model
        name = None if weak is None else self.data.models[model].actuator(weak).name
        effects = () if name is None else (make("motor_strength", where=name),)
        plant = self._plant(effects, model, len(windows))
        values = np.full((len(windows), len(effects)), strength)
        plans, ctrl, off = self._begin(plant, windows, values)
        simulated, bits = _actuated(plant), np.arange(ctrl.shape[2])
        for plan, path, held, mask in zip(plans, roll(plant, ctrl, off), ctrl, off, strict=True):
            on = (mask[: plan.steps, None] >> bits & 1) == 0
            yield simulated, path[: plan.steps + 1], held[: plan.steps], on

    def _begin(
        self, plant: Plant, windows: np.ndarray, values: np.ndarray
    ) -> tuple[list[_Plan], np.ndarray, np.ndarray]:
        """Put each row at the start of its window, under its values.

        Returns:
            The plans, the commands (R, K, nu) and the motors that are off (R, K).
        """
        plans = [self._plans[i] for i in windows]
        steps = max(plan.steps for plan in plans)
        ctrl = np.stack([_held(plan.ctrl, steps) for plan in plans])
        off = np.stack([_held(plan.off, steps) for plan in plans])
        _start(plant, [self.data.windows[i].recording for i in windows], values)
        return plans, ctrl, off

    def _chunk(
        self, effects: Sequence[Effect], model: int, windows: np.ndarray, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        data, every = self.data, np.arange(len(windows))
        plant = self._plant(effects, model, len(windows))
        plans, ctrl, off = self._begin(plant, windows, values)
        self.heat.start(plant, windows)
        paths = roll(plant, ctrl, off)[:, :, self._places]  # (R, K + 1, M)
        dt = data.models[model].opt.timestep
        self.seconds += off.size * dt
        bad = np.asarray(np.isnan(paths).any(axis=2))  # (R, K + 1)
        lost = np.where(np.any(bad, axis=1), bad.argmax(axis=1) * dt, np.inf)
        before = np.stack([plan.before for plan in plans])  # (R, T, M)
        share = np.stack([plan.share for plan in plans])
        row, joint = every[:, None, None], np.arange(paths.shape[2])
        here, after = paths[row, before, joint], paths[row, before + 1, joint]
        simulated = here + share * (after - here)
        mask = data.mask[windows][..., None]
        error = np.where(mask, (simulated - data.measured[windows]) / data.scale, 0.0)
        slope = np.where(mask, (after - here) / dt / data.scale, 0.0)
        limit = np.maximum(LOST * self._spread, 1e-3) / data.scale
        error = np.where(np.isfinite(error), np.clip(error, -limit, limit), limit)
        return error, np.nan_to_num(slope), lost


def _actuated(plant: Plant) -> mujoco.MjModel:
    """Return the model with its actuators as the first row of a plant has them."""
    model = copy(plant.nominal)
    model.actuator_forcelimited[:] = plant.model.actuator_forcelimited
    for name in ACTUATORS:
        values = plant.batch.expanded(name)
        getattr(model, name)[:] = getattr(plant.model, name) if values is None else values[0]
    return model


def _held(values: np.ndarray, length: int) -> np.ndarray:
    """Return the values with the last one repeated up to a length."""
    return np.concatenate([values, np.repeat(values[-1:], length - len(values), axis=0)])


def _start(plant: Plant, recordings: Sequence[Recording], values: np.ndarray) -> None:
    """Put each row at the start of its recording, under its values."""
    every = np.arange(plant.num_rows)
    low, high = plant.space.low, plant.space.high
    plant.set_params(every, np.clip(values, low, high))
    qpos = np.stack([r.qpos for r in recordings])
    qvel = np.stack([r.qvel for r in recordings])
    first = np.stack([r.ctrl[0] for r in recordings])
    seeds = np.zeros(plant.num_rows, np.uint64)
    plant.reset(every, qpos, qvel, seeds, ctrl=first, measured=True)
