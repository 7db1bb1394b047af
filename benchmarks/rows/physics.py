"""The ceiling: `mujoco.batch` alone, replaying what a row above it did.

    simulation = make_simulation(256, kind=Recorder)
    ...                                              # anything that steps it
    replay = Replay(256, simulation.tape, threads=2)
    replay.run()

Contacts change what a step costs, so the controls, the starting states and the parameters are those
of the row that is compared, bit for bit. The clock runs while controls are written and simulations
step, and stops during resets: what a reset costs is charged to the rows above, not to physics.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from benchmarks.rows.base import Row, Timing
from envs.quiet import quiet_engine
from envs.rows import Step
from envs.simulation import Simulation
from envs.tasks import Hopper

FIELDS = ("body_mass", "geom_friction")  # of the model, that the randomization writes
STATE = ("qpos", "qvel", "qacc_warmstart")
NO_STAGE = mujoco.mjtStage.mjSTAGE_NONE.value  # pyright: ignore[reportAttributeAccessIssue]


class Start(NamedTuple):
    """Simulations put into a state under parameters."""

    ids: np.ndarray  # (n,)
    state: tuple[np.ndarray, ...]  # of STATE, (n, ·) each
    fields: tuple[np.ndarray, ...]  # of FIELDS, (n, …) each


class Advance(NamedTuple):
    """One control step of simulations."""

    ids: np.ndarray | None  # (n,), None: all
    control: np.ndarray  # (n, A)


Tape = list[Start | Advance]


def start(simulation: Simulation, ids: np.ndarray) -> Start:
    """Return the states and models that rows of a simulation have now."""
    batch = simulation.plant.batch
    state = tuple(batch.bind(name)[ids] for name in STATE)
    return Start(ids.copy(), state, tuple(batch.expand(name)[ids] for name in FIELDS))


class Recorder(Simulation):
    """Rows that remember all that was done with them; of Hopper with the parameters of `FIELDS`."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.tape: Tape = []

    def restart(self) -> None:
        """Forget what was, and begin the tape with where all the rows are."""
        self.tape = [start(self, np.arange(self.num_rows))]

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Reset, and record the states and models that came out."""
        observation = super().reset(ids, values, seeds)
        self.tape.append(start(self, ids))
        return observation

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Step, and record the controls."""
        self.tape.append(Advance(None if ids is None else ids.copy(), action.copy()))
        return super().step(ids, action)


class Replay:
    """A batch of its own that repeats a tape."""

    def __init__(self, num_rows: int, tape: Tape, threads: int) -> None:
        self.batch = Batch(Hopper().spec().compile(), num_rows, threads)
        self._tape = tape
        self._fields = [self.batch.expand(name) for name in FIELDS]
        self._state = [self.batch.bind(name) for name in STATE]
        self._ctrl = self.batch.bind("ctrl")

    def run(self) -> Timing:
        """Play the tape once."""
        steps, seconds = 0, 0.0
        for item in self._tape:
            if isinstance(item, Start):
                self._start(item)
                continue
            ids, control = item
            begin = time.perf_counter()
            self._ctrl[slice(None) if ids is None else ids] = control
            self.batch.step(ids, Hopper.frame_skip)
            seconds += time.perf_counter() - begin
            steps += len(control)
        return Timing(steps, seconds, 0)

    def _start(self, start: Start) -> None:
        for target, values in zip(self._fields, start.fields, strict=True):
            target[start.ids] = values
        self.batch.set_const(start.ids)
        self.batch.reset(start.ids, stage=NO_STAGE)
        for target, values in zip(self._state, start.state, strict=True):
            target[start.ids] = values


class RawPhysics(Row):
    """The replay of another row."""

    def __init__(
        self,
        name: str,
        num_rows: int,
        record: Callable[[], Tape],
        threads: int,
        of: str | None = "raw_physics",
    ) -> None:
        self.name, self.of, self.simulations = name, of, num_rows
        self._record, self._threads = record, threads
        self.setup = f"mujoco.batch, N = {num_rows}, {threads} threads, recorded controls"

    def build(self) -> None:
        """Record what is replayed."""
        self._replay = Replay(self.simulations, self._record(), self._threads)

    def run(self) -> Timing:
        """Play the tape once."""
        with quiet_engine():
            return self._replay.run()
