"""A plant: many simulations of one robot, each with its own parameters, and nothing of a task.

    plant = Plant(mujoco.MjSpec.from_file("arm.xml"), [make("link_mass", where="arm")], num_rows=64)
    plant.set_params(ids, values)                 # (n, P), each checked; the constants follow
    plant.reset(ids, qpos, qvel, seeds)
    failed = plant.step(ids, ctrl, nstep=4)       # ids None: all rows
    qpos, qvel = plant.measured(ids)              # what the robot's encoders would say

Contracts:

* `qpos` and `qvel` always have the layout of the model as given, whatever joints the effects added,
  and are the truth on the link's side of them. `model` is the simulated model with the added
  joints, `nominal` the one as given.
* Values are written from the model's own, never on top of a former draw, and `set_const` follows
  where a derived constant depends on them: without it Hopper's positions drift by 0.2 within 300
  steps of a changed mass.
* A simulation that diverges is reset silently by the engine; `step` reads the warnings and says
  which rows that was.
* `fixed` effects have fixed values and are not parameters; drawn effects come after them and
  compose with them. What the model states of its servos (`envs.servo_numbers`) comes first.
* Parameters and starts are NumPy arrays of the host whatever steps the simulations; what moves with
  them (`qpos`, `ctrl`, readings) are arrays of the engine, `arrays` (see `envs.physics`).
"""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, TypeVar, cast
from weakref import proxy

import mujoco
import numpy as np
from mujoco.batch import Batch

from envs.effects.base import Effect
from envs.effects.bound import BoundEffect, CommandRule, Measurement, SubstepRule
from envs.effects.goal import Goal
from envs.effects.history import CommandHistory
from envs.effects.layout import Layout, edited
from envs.effects.plant_view import PlantView
from envs.effects.pwm_slope import list_stated_slope
from envs.effects.registry import refuse_elsewhere
from envs.errors import EffectError, TaskError
from envs.memory import check_memory, row_bytes, share_memory
from envs.params import ParamSpace
from envs.physics import Engine, make_physics
from envs.physics.arrays import Array
from envs.quiet import quiet_engine
from envs.sparse_fault import warn_of_sparse_fault
from envs.substeps import Substeps

Fixed = tuple[Effect, Sequence[float]]
T = TypeVar("T")


class Plant:
    """num_rows simulations of the spec's model under the effects.

    Args:
        spec: the robot; it is copied, not changed.
        effects: what may differ from it, in the order of the parameter space.
        num_rows: N, the number of simulations.
        threads: CPU threads that step them; 0 for all cores.
        persistent: keep a whole MjData per row, for derived quantities that a step does not
            compute.
        fixed: effects that all rows have, each with its values, as `load_effects` returns them.
        goal: whether a task gives the rows a goal; without one the effect `goal` is refused.
        nominal: the spec compiled, where that has been done; it is kept, not changed.
        physics: what steps the simulations, `batch` or `warp`.
        device: where `warp` steps them.

    Attributes:
        qpos: true positions [m, rad], (N, nq) of the model as given; read only where effects added
            joints.
        qvel: true velocities, (N, nv).
        ctrl: the commands in force, (N, nu).
        applied: torques and forces that substep rules add to the simulated model's dofs, (N, nv of
            `model`).
        time: the time of each simulation [s], (N,).
        arrays: where the engine's arrays are.

    Raises:
        EffectError: an effect that the robot or the engine cannot have, or the same one fixed and
            drawn where they do not compose.
        TaskError: an engine that is not there or cannot step the model; a wrong number that the
            model states of a servo.
        ParameterError: a fixed value outside its range.
        EnvsError: more simulations than the machine has memory for.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        effects: Sequence[Effect] = (),
        num_rows: int = 1,
        threads: int = 0,
        persistent: bool = False,
        fixed: Sequence[Fixed] = (),
        goal: bool = False,
        nominal: mujoco.MjModel | None = None,
        physics: Engine = "batch",
        device: Any = "cpu",
    ) -> None:
        if num_rows < 1:
            raise TaskError(f"num_rows={num_rows} must be at least 1")
        self.nominal = spec.copy().compile() if nominal is None else nominal
        fixed = [*list_stated_slope(self.nominal), *fixed]
        _refuse_doubles(effects, [effect for effect, _ in fixed])
        every = [effect for effect, _ in fixed] + list(effects)
        refuse_elsewhere(every, physics)
        if not goal and any(isinstance(effect, Goal) for effect in every):
            raise EffectError(
                "goal belongs to a task, but no task here has one: robots, recordings and "
                "diagnoses have none; remove it, or use a task that has a goal, such "
                "as env=halfcheetah_direction"
            )
        self.model, keep = edited(spec, self.nominal, every)
        if not persistent:
            share_memory(self.model)
        warn_of_sparse_fault(self.model)
        self.effects = tuple(effects)
        own = [effect.parameters(self.model) for effect in every]
        drawn = own[len(fixed) :]
        self.space = ParamSpace([p for parameters in drawn for p in parameters])
        constants = [
            ParamSpace(p).validate(np.atleast_2d(v)) for p, (_, v) in zip(own, fixed, strict=False)
        ]

        needed = num_rows * row_bytes(self.model)
        check_memory(needed, f"{num_rows} simulations side by side", "fewer rows")
        self.batch = Batch(self.model, num_rows, threads, persistent)
        self.physics = make_physics(physics, self.batch, device)
        self.arrays = self.physics.arrays
        self.num_rows = num_rows
        self.ctrl, self.applied, self.time = (
            self.physics.bind(n) for n in ("ctrl", "qfrc_applied", "time")
        )
        self._held = self.batch.bind("ctrl")  # on the host
        self.layout = Layout(self.batch, self.nominal, keep, self.physics)
        self.qpos, self.qvel = self.layout.qpos, self.layout.qvel
        # live values of the fields that effects write, (N, ...)
        self._fields: dict[str, np.ndarray] = {}
        self._substeps = Substeps(num_rows, self.physics)
        self._shared: dict[str, Any] = {}  # mechanisms that several effects are parts of
        view = cast(
            PlantView, proxy(self)
        )  # models are large: none waits for the garbage collector
        self._bound = [effect.bind(view) for effect in every]
        ends = np.cumsum([len(parameters) for parameters in drawn], dtype=int)
        columns = [slice(end - len(p), end) for end, p in zip(ends, drawn, strict=True)]
        self._fixed = list(zip(self._bound, constants, strict=False))
        self._drawn = list(zip(self._bound[len(fixed) :], columns, strict=True))
        self._collect(every, view)

        self.params = self.space.points(num_rows)  # (N, P), the values in force
        self._set(np.arange(num_rows), self.params)

    def _collect(self, effects: Sequence[Effect], view: PlantView) -> None:
        """Sort what is bound by what it does."""
        history = [CommandHistory(view)] if self.model.nhistory else []
        parts = [*self._bound, *self._shared.values(), *history]
        parts.sort(key=lambda part: part.order)
        self._parts = list({id(part): part for part in parts}.values())
        self._commands = [b for b in self._parts if isinstance(b, CommandRule)]
        self._measurements = [b for b in self._parts if isinstance(b, Measurement)]
        starters = [
            b for b in self._parts if type(b).on_episode_start is not BoundEffect.on_episode_start
        ]
        self._starters = sorted(
            starters, key=lambda b: not isinstance(b, CommandRule)
        )  # commands first, then the effects that act on them
        own = [id(bound) for bound in self._bound]
        single = [b for b in self._bound if isinstance(b, SubstepRule) and own.count(id(b)) == 1]
        rules = [b for b in self._parts if isinstance(b, SubstepRule)]
        self._substeps.use(rules, single)
        self._fresh = np.zeros(self.num_rows, dtype=bool)  # reset, and no command seen yet
        self.measures = bool(self._measurements)  # whether `measured` differs from the true state
        if self.measures:
            self._sensed = self._copies(slice(None))
        self._constants = any(effect.constants for effect in effects)

    @property
    def substep_rules(self) -> tuple[SubstepRule, ...]:
        """The rules that act before each physics substep."""
        return self._substeps.rules

    @property
    def command_rules(self) -> tuple[CommandRule, ...]:
        """The rules that act on the command of each control step."""
        return tuple(self._commands)

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """The rules that change the readings of the sensors."""
        return tuple(self._measurements)

    def take_warnings(self) -> np.ndarray:
        """Return the rows in which the engine warned since the last look (n,), and forget it."""
        return np.flatnonzero(self.arrays.host(self.physics.broken(slice(None))))

    def field(self, name: str) -> np.ndarray:
        """Return a model field's values per row, (N, ...), for a bound effect to write."""
        if name not in self._fields:
            self._fields[name] = self.batch.expand(name)
        return self._fields[name]

    def live(self, name: str) -> np.ndarray:
        """Return the same for a substep rule to change; each substep starts as `write` left it."""
        return self._substeps.live(name, self.field(name))

    def now(self, name: str) -> Array:
        """Return a live field in the engine, (N, ...), for rules that are prepared or act."""
        return self._substeps.now(name)

    def override_field(self, name: str, ids: np.ndarray, values: np.ndarray) -> None:
        """Let a field that was given out be values (n, ...) in the rows ids, from now on.

        Live fields return to them before each substep; new parameters undo it.
        """
        self._fields[name][ids] = values
        self._substeps.hold(name, ids)

    def is_field_written(self, name: str) -> bool:
        """Return whether an effect writes that model field, so that rows may differ in it."""
        return name in self._fields

    def field_values(self, name: str, ids: np.ndarray) -> np.ndarray:
        """Return a model field in the rows ids (n,), (n, ...); read only."""
        if name in self._fields:
            return self._fields[name][ids]
        own = np.asarray(getattr(self.model, name))
        return np.broadcast_to(own, (len(ids), *own.shape))

    def shared_mechanism(self, name: str, make: Callable[[], T]) -> T:
        """Return the mechanism of that name, made once for all the effects that are parts of it."""
        if name not in self._shared:
            self._shared[name] = make()
        return self._shared[name]

    def set_params(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put parameter values (n, P) into the rows ids (n,).

        Raises:
            ParameterError: a value outside its range; nothing was written then.
        """
        if self.space.size:
            self._set(np.asarray(ids), self.space.validate(values))

    def _set(self, ids: np.ndarray, values: np.ndarray) -> None:
        for name, live in self._fields.items():
            live[ids] = attrgetter(name)(self.model)
        for bound, constants in self._fixed:
            bound.write(ids, np.repeat(constants, len(ids), axis=0))
        for bound, columns in self._drawn:
            bound.write(ids, values[:, columns])
            away = values[:, columns] != self.space.neutral[columns]
            self._substeps.place(bound, ids, away.any(axis=1))
        self._substeps.written(ids)
        if self._constants:
            self.batch.set_const(ids)
        self.physics.written(ids)
        self.params[ids] = values

    def reset(
        self,
        ids: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
        seeds: np.ndarray,
        ctrl: np.ndarray | None = None,
        measured: bool = False,
        act: np.ndarray | None = None,
    ) -> None:
        """Put the rows ids into a state and compute what depends on it.

        Args:
            ids: sorted, unique rows, (n,).
            qpos: positions [m, rad], (n, nq).
            qvel: velocities [m/s, rad/s], (n, nv).
            seeds: uint64, (n,), for the effects that need randomness.
            ctrl: commands held from before, (n, nu); None: the first one of the first step.
            measured: qpos and qvel are what sensors said, which an offset, a play or an IMU's
                mounting sets apart from the truth.
            act: states of actuators that have one, (n, na); None: those of the model.
        """
        self.batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        if measured:
            qpos, qvel = np.array(qpos, dtype=np.float64), np.array(qvel, dtype=np.float64)
            for measurement in reversed(self._measurements):
                measurement.unmeasure(ids, qpos, qvel)
        self.layout.write(ids, qpos, qvel, measured)
        if act is not None and self.model.na:
            self.batch.bind("act")[ids] = act
        for bound in self._parts:
            bound.reset(ids, seeds)
        if self._starters:
            self._fresh[ids] = ctrl is None
        if ctrl is not None:
            self._start(ids, ctrl)
        with quiet_engine():
            self.batch.forward(ids)
        self.physics.started(ids)
        rows = self.arrays.rows(ids)
        self.layout.read(rows)
        self._sense(rows)

    def step(self, ids: np.ndarray | None, ctrl: Array, nstep: int) -> Array:
        """Advance by nstep substeps under constant controls.

        Args:
            ids: sorted, unique rows, (n,), or None for all.
            ctrl: controls in the actuators' units, (n, nu); the engine clamps them to their range.
            nstep: physics substeps.

        Returns:
            (n,) bool: the rows whose simulation broke (an engine error or warning, such as a
            diverged state).
        """
        broken = self.advance(ids, ctrl, nstep)
        rows = self.arrays.rows(ids)
        self.layout.read(rows)
        self._sense(rows)
        return broken

    def advance(self, ids: np.ndarray | None, ctrl: Array, nstep: int) -> Array:
        """Do as `step` does, but read no sensors: `qpos`, `qvel` and `measured` stay behind.

        Code that replays many steps reads `layout.raw_qpos`, and turns the whole path into
        readings.
        """
        rows = self.arrays.rows(ids)
        sent = self._received(ids, rows, ctrl) if self._starters or self._commands else ctrl
        self.ctrl[rows] = sent
        if self._substeps.rules:
            for _ in range(nstep):
                self._substeps.apply(ids, self.applied)
                self.physics.step(ids, 1)
        else:
            self.physics.step(ids, nstep)
        return self.physics.broken(rows)

    def _received(self, ids: np.ndarray | None, rows: Any, ctrl: Array) -> Array:
        """Return the commands (n, nu) as they arrive in the rows ids, which the engine indexes."""
        ctrl = self.arrays.xp.asarray(ctrl, dtype=self.arrays.dtype, copy=True)
        fresh = self._fresh if ids is None else self._fresh[ids]
        if fresh.any():
            here = np.arange(self.num_rows) if ids is None else ids
            self._start(here[fresh], self.arrays.host(ctrl[self.arrays.own(fresh)]))
            self.physics.started(here[fresh])
        for rule in self._commands:
            rule.command(rows, ctrl)
        return ctrl

    def _start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        """Let the rows ids have held the commands (n, nu) before their episodes."""
        held = np.array(ctrl, dtype=np.float64)
        for bound in self._starters:
            bound.on_episode_start(ids, held)
        self._held[ids] = held
        self._fresh[ids] = False

    def _copies(self, rows: Any) -> tuple[Array, Array]:
        xp = self.arrays.xp
        return xp.asarray(self.qpos[rows], copy=True), xp.asarray(self.qvel[rows], copy=True)

    def _sense(self, rows: Any) -> None:
        if not self.measures:
            return
        qpos, qvel = self._copies(rows)
        with np.errstate(all="ignore"):
            for measurement in self._measurements:
                measurement.measure(rows, qpos, qvel)
        self._sensed[0][rows], self._sensed[1][rows] = qpos, qvel

    def measured(self, ids: np.ndarray | None) -> tuple[Array, Array]:
        """Return sensor readings of qpos (n, nq) and qvel (n, nv) in the rows ids (None: all)."""
        return self.readings(self.arrays.rows(ids))

    def readings(self, rows: Any) -> tuple[Array, Array]:
        """Return the same in rows that the engine's arrays index."""
        if not self.measures:
            return self.qpos[rows], self.qvel[rows]
        xp = self.arrays.xp
        qpos, qvel = (xp.asarray(sensed[rows], copy=True) for sensed in self._sensed)
        return qpos, qvel


def _refuse_doubles(drawn: Sequence[Effect], fixed: Sequence[Effect]) -> None:
    """Raise EffectError where an effect is fixed twice, or fixed and drawn without composing."""
    places = [(effect.name, effect.where) for effect in fixed]
    for effect in fixed:
        if places.count((effect.name, effect.where)) > 1:
            raise EffectError(f"{effect.label()} is fixed twice; keep one of them")
    for effect in drawn:
        if (effect.name, effect.where) not in places:
            continue
        if not effect.composes or effect.how == "set":
            remedy = "draw it with how: add or scale, or" if effect.composes else "either"
            raise EffectError(
                f"{effect.label()} is both fixed and drawn; {remedy} remove it from one of the two"
            )
