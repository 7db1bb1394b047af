"""A plant's rows under given commands, all their physics steps at once where that is possible.

    paths = roll(plant, ctrl)       # (N, K, nu) commands -> (N, K + 1, nq) what the encoders say

The rows must be reset. Where no effect of the plant acts between physics steps, the engine takes
many steps in one call; else the plant is stepped K times. Both give the same positions. A row
whose own schedule is shorter than K is simulated to its end and no further.
"""

from itertools import pairwise

import numpy as np
from mujoco.batch import SimulationError

from envs.effects.bound import Measurement
from envs.plant import Plant
from envs.quiet import quiet_engine
from envs.replay.impedance import ImpedanceGains
from envs.replay.recording import groups


def rollout(
    plant: Plant,
    ctrl: np.ndarray,
    off: np.ndarray | None = None,
    law: np.ndarray | None = None,
    steps: np.ndarray | None = None,
) -> np.ndarray:
    """Simulate K physics steps of every row, or as many of them as the row needs.

    Args:
        plant: N rows, reset to their start.
        ctrl: the command in force at each physics step, (N, K, nu).
        off: bit masks of the actuators that are switched off then, (N, K); the plant's model must
            be `switchable`. None: none ever is.
        law: of actuators under impedance control, (N, K, nu, 4); see `impedance.ImpedanceGains`.
        steps: that each row needs, (N,), of 1 to K; None: all K.

    Returns:
        What the encoders would have said at the start and after each step, (N, K + 1, nq); NaN from
        where a row diverged; the last position again where it was not needed any more.
    """
    power, laws = _Power(plant, off), ImpedanceGains(plant, law)
    ends = np.full(len(ctrl), ctrl.shape[1]) if steps is None else np.asarray(steps)
    if not (_is_plain(plant) and laws.steady):
        return _step(plant, ctrl, power, laws, ends)
    laws.act(0)
    paths = _roll(plant, ctrl, power, ends)
    laws.restore()
    return paths


def _awake(ends: np.ndarray, step: int) -> np.ndarray | None:
    """Return the rows that still have that step before them (n,); None: all."""
    rows = np.flatnonzero(ends > step)
    return None if len(rows) == len(ends) else rows


def _is_plain(plant: Plant) -> bool:
    """Return whether nothing of the plant acts between physics steps or remembers readings."""
    rules = [*plant.command_rules, *plant.measurements]
    return not plant.substep_rules and all(map(_has_path, rules))


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
        self._bits = 1 << groups(plant.model.nu)
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
        self._plant.override_field("actuator_damping", ids, damping)
        self._plant.batch.set_const(ids)

    def restore(self) -> None:
        """Switch everything on again."""
        if self._off is not None:
            self._mask[:] = 0
            self._plant.override_field("actuator_damping", np.arange(len(self._full)), self._full)


def _roll(plant: Plant, ctrl: np.ndarray, power: _Power, ends: np.ndarray) -> np.ndarray:
    """Let the engine take all steps at once, between switchings and ends of rows."""
    (rows, steps, _), start = ctrl.shape, _live(plant)
    ctrl = _shifted(plant, ctrl)
    raw = {k: np.empty((rows, steps + 1, v.shape[1])) for k, v in start.items()}
    for name, path in raw.items():
        path[:, 0] = start[name]
    broken = np.full(rows, steps + 1)  # from where a row's numbers mean nothing
    cuts, switches = np.union1d(power.cuts, ends[ends < steps]), set(power.cuts.tolist())
    for first, end in pairwise([*cuts.tolist(), steps]):
        if first in switches:
            power.switch(first)
        ids = _awake(ends, first)
        own = slice(None) if ids is None else ids
        count = rows if ids is None else len(ids)
        part = {name: np.empty((count, end - first, p.shape[2])) for name, p in raw.items()}
        refused = np.zeros(0, int)
        try:
            with quiet_engine():
                plant.batch.rollout(
                    end - first, ctrl[own, first:end], record=tuple(raw), ids=ids, out=part
                )
        except SimulationError as error:
            refused = error.ids
        for name, path in raw.items():
            path[own, first + 1 : end + 1] = part[name]
        for row in plant.take_warnings():
            broken[row] = min(broken[row], first + 1 + _stop(raw["qpos"][row, first + 1 : end + 1]))
        broken[refused] = np.minimum(broken[refused], first + 1)
    power.restore()
    for path in raw.values():
        _hold(path, ends)
    qpos = _measured(plant, raw)
    qpos[np.arange(steps + 1) >= broken[:, None]] = np.nan
    return qpos


def _hold(paths: np.ndarray, ends: np.ndarray) -> None:
    """Let paths (N, K + 1, ...) stay from their ends (N,) on where they are then."""
    for path, end in zip(paths, ends, strict=True):
        path[end + 1 :] = path[end]


def _stop(path: np.ndarray) -> int:
    """Return from where positions (K, nq) of a simulation that stopped are repeated."""
    moves = np.flatnonzero((np.diff(path, axis=0) != 0).any(axis=1))
    return int(moves[-1]) + 1 if moves.size else 0


def _shifted(plant: Plant, ctrl: np.ndarray) -> np.ndarray:
    """Return the commands as they arrive."""
    if not plant.command_rules:
        return ctrl
    ctrl = np.array(ctrl)
    for step in range(ctrl.shape[1]):
        now = ctrl[:, step]
        for rule in plant.command_rules:
            rule.command(slice(None), now)
    return ctrl


def _measured(plant: Plant, raw: dict[str, np.ndarray]) -> np.ndarray:
    """Return the encoders' readings, (N, K + 1, nq), along paths of the simulated model."""
    qpos = plant.layout.encoder_positions(raw["qpos"])
    qvel = (
        plant.layout.encoder_velocities(raw["qvel"])
        if "qvel" in raw
        else np.empty((*qpos.shape[:2], 0))
    )
    for rule in plant.measurements:
        rule.measure_path(plant.model.opt.timestep, qpos, qvel)
    return qpos


def _step(
    plant: Plant, ctrl: np.ndarray, power: _Power, laws: ImpedanceGains, ends: np.ndarray
) -> np.ndarray:
    """Step the plant, whose effects act between physics steps."""
    (rows, steps, _), along = ctrl.shape, all(map(_has_path, plant.measurements))
    take = plant.advance if along else plant.step
    live = _live(plant) if along else {"qpos": plant.measured(None)[0]}
    raw = {name: np.empty((steps + 1, *now.shape)) for name, now in live.items()}
    for name, now in live.items():
        raw[name][0] = now
    broken = np.full(rows, steps + 1)  # from where a row's numbers mean nothing
    cuts, changes = set(power.cuts.tolist()), {0, *ends.tolist()}
    sent = np.ascontiguousarray(ctrl.swapaxes(0, 1))  # (K, N, nu)
    every, ids = np.arange(rows), None
    own: np.ndarray | slice = slice(None)
    with quiet_engine():
        for step in range(steps):
            if step in changes:
                ids = _awake(ends, step)
                own = slice(None) if ids is None else ids
            if step in cuts:
                power.switch(step)
            laws.act(step)
            failed = take(ids, sent[step, own], 1)
            if failed.any():
                failed = every[own][failed]
                broken[failed] = np.minimum(broken[failed], step + 1)
            if not along:
                live["qpos"][own] = plant.measured(ids)[0]
            for name, now in live.items():
                raw[name][step + 1] = now
    power.restore()
    laws.restore()
    paths = {name: np.ascontiguousarray(path.swapaxes(0, 1)) for name, path in raw.items()}
    qpos = _measured(plant, paths) if along else paths["qpos"]
    qpos[np.arange(steps + 1) >= broken[:, None]] = np.nan
    return qpos


def _live(plant: Plant) -> dict[str, np.ndarray]:
    """Return the current state that readings are computed from, (N, ...) each."""
    layout = plant.layout
    needs_speed = any(rule.needs_speed for rule in plant.measurements)
    return {"qpos": layout.raw_qpos, **({"qvel": layout.raw_qvel} if needs_speed else {})}


def _has_path(rule: object) -> bool:
    """Return whether a measurement can be computed from a whole path."""
    along = type(rule).measure_path if isinstance(rule, Measurement) else Measurement.measure_path
    return along is not Measurement.measure_path
