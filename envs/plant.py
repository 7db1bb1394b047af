"""A plant: many simulations of one robot, each with its own parameters, and nothing of a task.

    plant = Plant(mujoco.MjSpec.from_file("arm.xml"), [make("link_mass", where="arm")], num_rows=64)
    plant.set_params(ids, values)                 # (n, P), each checked; constants of the model follow
    plant.reset(ids, qpos, qvel, seeds)
    failed = plant.step(ids, ctrl, nstep=4)       # ids None: all rows
    qpos, qvel = plant.measured(ids)              # what the robot's encoders would say

Contracts:

* `qpos` and `qvel` always have the layout of the model as given, whatever joints the effects added.
* Values are written from the model's own, never on top of a former draw, and `set_const` follows where a derived
  constant depends on them: without it Hopper's positions drift by 0.2 within 300 steps of a changed mass.
* A simulation that diverges is reset silently by the engine; `step` reads the warnings and says which rows that was.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from envs.effects.base import Effect, Measurement, SubstepRule
from envs.errors import TaskError
from envs.params import ParamSpace
from envs.quiet import quiet_engine


class Plant:
    """num_rows simulations of the spec's model under the effects.

    Args:
        spec: the robot; it is copied, not changed.
        effects: what may differ from it, in the order of the parameter space.
        num_rows: N, the number of simulations.
        threads: CPU threads that step them; 0 for all cores.
        persistent: keep a whole MjData per row, for derived quantities that a step does not compute.

    Raises:
        EffectError: an effect that the robot cannot have.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        effects: Sequence[Effect] = (),
        num_rows: int = 1,
        threads: int = 0,
        persistent: bool = False,
    ) -> None:
        if num_rows < 1:
            raise TaskError(f"num_rows={num_rows} must be at least 1")
        nominal = spec.copy()
        self.nominal = nominal.compile()
        spec = spec.copy()
        for effect in effects:
            effect.edit(spec)
        self.model = spec.compile()
        self.effects = tuple(effects)
        own = [effect.parameters(self.model) for effect in effects]
        self.space = ParamSpace([p for parameters in own for p in parameters])
        self.batch = Batch(self.model, num_rows, threads, persistent)
        self.num_rows = num_rows
        self.qpos, self.qvel, self.ctrl = (self.batch.bind(n) for n in ("qpos", "qvel", "ctrl"))  # live views
        self._bound = [effect.bind(self) for effect in effects]
        ends = np.cumsum([len(parameters) for parameters in own], dtype=int)
        self._columns = [slice(end - len(p), end) for end, p in zip(ends, own, strict=True)]
        self._rules = [b for b in self._bound if isinstance(b, SubstepRule)]
        self._measurements = [b for b in self._bound if isinstance(b, Measurement)]
        self.measures = bool(self._measurements)  # whether `measured` differs from the true state
        self._constants = any(effect.constants for effect in effects)
        self._warnings = self.batch.warning[..., 1]  # (N, kinds), how often each was raised in the running step
        self.params = self.space.points(num_rows)  # (N, P), the values in force
        every = np.arange(num_rows)
        self.set_params(every, self.params)

    def set_params(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put parameter values (n, P) into the rows ids (n,); raises ParameterError before anything is written."""
        if not self.space.size:
            return
        values = self.space.validate(values)
        for bound, columns in zip(self._bound, self._columns, strict=True):
            bound.write(ids, values[:, columns])
        if self._constants:
            self.batch.set_const(ids)
        self.params[ids] = values

    def reset(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray, seeds: np.ndarray) -> None:
        """Put the rows ids into a state and compute what depends on it.

        Args:
            ids: sorted, unique rows, (n,).
            qpos: positions [m, rad], (n, nq).
            qvel: velocities [m/s, rad/s], (n, nv).
            seeds: uint64, (n,), for the effects that need randomness.
        """
        self.batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.qpos[ids] = qpos
        self.qvel[ids] = qvel
        for bound in self._bound:
            bound.reset(ids, seeds)
        with quiet_engine():
            self.batch.forward(ids)
        self._warnings[ids] = 0

    def step(self, ids: np.ndarray | None, ctrl: np.ndarray, nstep: int) -> np.ndarray:
        """Advance by nstep substeps under constant controls.

        Args:
            ids: sorted, unique rows, (n,), or None for all.
            ctrl: controls in the actuators' units, (n, nu); the engine clamps them to their range.
            nstep: physics substeps.

        Returns:
            (n,) bool: the rows whose simulation broke (an engine error or warning, such as a diverged state).
        """
        rows = slice(None) if ids is None else ids
        self.ctrl[rows] = ctrl
        broken = np.zeros(self.num_rows, dtype=bool)
        if self._rules:
            for _ in range(nstep):
                for rule in self._rules:
                    rule.before_substep(rows)
                self._advance(ids, 1, broken)
        else:
            self._advance(ids, nstep, broken)
        warned = self._warnings[rows].any(axis=1)  # (n,)
        if warned.any():
            self._warnings[rows] = 0  # the engine's own reset clears counts: only what rose from 0 can be told
        return broken[rows] | warned

    def _advance(self, ids: np.ndarray | None, nstep: int, broken: np.ndarray) -> None:
        try:
            with quiet_engine():
                self.batch.step(ids, nstep)
        except SimulationError as error:
            broken[error.ids] = True

    def measured(self, ids: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Return what the sensors say of qpos (n, nq) and qvel (n, nv) in the rows ids (None: all)."""
        rows = slice(None) if ids is None else ids
        qpos, qvel = self.qpos[rows], self.qvel[rows]
        if self._measurements:
            qpos, qvel = qpos.copy(), qvel.copy()
            for measurement in self._measurements:
                measurement.measure(rows, qpos, qvel)
        return qpos, qvel
