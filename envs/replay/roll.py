"""A plant's rows under given commands, all their physics steps at once where that is possible.

    paths = roll(plant, ctrl)       # (N, K, nu) commands -> (N, K + 1, nq) what the encoders say

The rows must be reset. Where no effect of the plant acts between physics steps, the engine takes
all K steps in one call; else the plant is stepped K times. Both give the same positions, but that a
delayed encoder is interpolated here between physics steps and there between readings.
"""

from __future__ import annotations

import numpy as np
from mujoco.batch import SimulationError

from envs.effects.sensing import _Offset, _SamplingDelay
from envs.effects.structure import MotorSide
from envs.plant import Plant
from envs.quiet import quiet_engine


def roll(plant: Plant, ctrl: np.ndarray, off: np.ndarray | None = None) -> np.ndarray:
    """Simulate K physics steps of every row.

    Args:
        plant: N rows, reset to their start.
        ctrl: the command in force at each physics step, (N, K, nu).
        off: bit masks of the actuators that are switched off then, (N, K); the plant's model must
            be `switchable`. None: none ever is.

    Returns:
        What the encoders would have said at the start and after each step, (N, K + 1, nq); NaN from
        where a row diverged.
    """
    power = _Power(plant, off)
    if _is_plain(plant):
        return _roll(plant, ctrl, power)
    return _step(plant, ctrl, power)


def _is_plain(plant: Plant) -> bool:
    """Return whether nothing of the plant acts between physics steps or remembers readings."""
    known = (_Offset, MotorSide, _SamplingDelay)
    rules = [*plant.command_rules, *plant.measurements]
    return not plant.substep_rules and all(isinstance(rule, known) for rule in rules)


class _Power:
    """Switches actuators off and on, their back-EMF included, at given physics steps."""

    def __init__(self, plant: Plant, off: np.ndarray | None) -> None:
        self._plant, self._off = plant, off
        if off is None or not off.any():
            self.cuts = np.zeros(1, int)
            self._off = None
            return
        changes = (np.diff(off, axis=1) != 0).any(axis=0)
        self.cuts = np.concatenate([[0], np.flatnonzero(changes) + 1])  # steps where any switches
        self._bits = 1 << np.arange(plant.model.nu)
        self._mask = plant.batch.expand("opt.disableactuator").reshape(plant.num_rows)
        self._full = plant.field("actuator_damping").copy()  # (N, nu)

    def switch(self, step: int) -> None:
        """Bring the actuators to what they are from this step on."""
        if self._off is None:
            return
        off = self._off[:, step]
        ids = np.arange(len(off)) if step == 0 else np.flatnonzero(off != self._off[:, step - 1])
        self._mask[ids] = off[ids]
        damping = np.where(off[ids, None] & self._bits, 0.0, self._full[ids])
        self._plant.hold("actuator_damping", ids, damping)
        self._plant.batch.set_const(ids)

    def restore(self) -> None:
        """Switch everything on again."""
        if self._off is not None:
            self._mask[:] = 0
            self._plant.hold("actuator_damping", np.arange(len(self._full)), self._full)


def _roll(plant: Plant, ctrl: np.ndarray, power: _Power) -> np.ndarray:
    """Let the engine take all steps between two switchings at once."""
    (rows, steps, _), layout = ctrl.shape, plant.layout
    ctrl = _shifted(plant, ctrl)
    raw = np.empty((rows, steps + 1, plant.model.nq))
    raw[:, 0] = layout.raw_qpos
    broken = np.full(rows, steps + 1)  # from where a row's numbers mean nothing
    for start, end in zip(power.cuts, [*power.cuts[1:], steps], strict=True):
        power.switch(int(start))
        out = None
        try:
            with quiet_engine():
                out = plant.batch.rollout(end - start, ctrl[:, start:end])
        except SimulationError as error:
            broken[error.ids] = np.minimum(broken[error.ids], start + 1)
        failed = plant.take_warnings()
        broken[failed] = np.minimum(broken[failed], start + 1)
        raw[:, start + 1 : end + 1] = raw[:, start : start + 1] if out is None else out["qpos"]
    power.restore()
    raw[np.arange(steps + 1) >= broken[:, None]] = np.nan
    return _measured(plant, raw)


def _shifted(plant: Plant, ctrl: np.ndarray) -> np.ndarray:
    """Return what arrives of the commands."""
    if not plant.command_rules:
        return ctrl
    ctrl = np.array(ctrl)
    for step in range(ctrl.shape[1]):
        now = ctrl[:, step]
        for rule in plant.command_rules:
            rule.command(slice(None), now)
    return ctrl


def _measured(plant: Plant, raw: np.ndarray) -> np.ndarray:
    """Return what encoders say of the engine's positions (N, K + 1, nq of the simulated model)."""
    qpos, layout = plant.layout.seen(raw), plant.layout
    for rule in plant.measurements:
        if isinstance(rule, MotorSide):
            continue
        if isinstance(rule, _SamplingDelay):
            qpos = _late(qpos, rule.value / plant.model.opt.timestep)
        else:
            n, k, nq = qpos.shape
            flat = qpos.reshape(n * k, nq)
            rule.measure(np.repeat(np.arange(n), k), flat, np.zeros((n * k, layout.qvel.shape[1])))
            qpos = flat.reshape(n, k, nq)
    return qpos


def _late(qpos: np.ndarray, delay: np.ndarray) -> np.ndarray:
    """Return positions (N, K, nq) as they were `delay` (N,) steps before."""
    steps = np.arange(qpos.shape[1]) - delay[:, None]  # (N, K)
    steps = np.maximum(steps, 0.0)
    before = np.minimum(steps.astype(int), qpos.shape[1] - 1)
    after = np.minimum(before + 1, qpos.shape[1] - 1)
    rows, share = np.arange(len(qpos))[:, None], (steps - before)[..., None]
    return qpos[rows, before] * (1 - share) + qpos[rows, after] * share


def _step(plant: Plant, ctrl: np.ndarray, power: _Power) -> np.ndarray:
    """Step the plant, whose effects act between physics steps."""
    rows, steps, _ = ctrl.shape
    paths = np.empty((rows, steps + 1, plant.qpos.shape[1]))
    paths[:, 0] = plant.measured(None)[0]
    broken = np.zeros(rows, bool)
    cuts = set(power.cuts.tolist())
    for step in range(steps):
        if step in cuts:
            power.switch(step)
        broken |= plant.step(None, ctrl[:, step], 1)
        paths[:, step + 1] = plant.measured(None)[0]
        if broken.any():
            paths[broken, step + 1] = np.nan
    power.restore()
    return paths
