"""The diagnosis of an arm's logs, and one fit of its values beside that of `mujoco.sysid`.

The arm is `arm6`, or its first three joints with the others fixed; the emulator makes its logs,
with friction in a joint and a weak gain that the model does not have. The two fits are of the same
six values, friction and gain of three joints, to the same log, both from the model as given
(`mujoco.sysid` from beside its bounds, at which it would stall), and count how often they replay
it: seconds of the robot simulated, over the log's length.

Each row works in a process of its own, so that its memory can be measured.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from benchmarks.rows.base import Row, Timing
from hardware.config import Robot, load_robot
from hardware.excite import excite
from hardware.log import Log, read_log, write_log
from hardware.stand import MODEL, angles_at_home, home_pose
from sim2real.exam.inject import keep_joints
from sim2real.exam.logs import SIZE, drive, motions
from sim2real.runs.files import write_text

HIDDEN = (  # what the emulated arm has and its model has not
    {"effect": "coulomb_friction", "where": "elbow", "value": 0.15},
    {"effect": "position_gain", "where": "shoulder", "value": 0.6},
)
ROUNDS = 6  # steps of a fit at most
PIECE = 3.0  # s of the windows that mujoco.sysid is given; the diagnosis cuts about as long ones
LARGEST = {"friction": 1.0, "gain": 3.0}  # its bounds: N·m, and a factor; the least is 0


class Recorded(NamedTuple):
    """Logs of the emulated arm, by path, and its model."""

    logs: tuple[Path, ...]
    model: Path


def record(folder: Path, joints: int, seconds: float, logs: int) -> Recorded:
    """Drive the emulated arm along motions; write its logs, at 100 Hz, and its model into a folder.

    The first so many joints move, the others are fixed; seconds are those of each log.
    """
    robot = _arm(folder, joints)
    paths = []
    for number in range(logs):
        rng = np.random.default_rng([7, number])
        plan = excite(robot, home_pose(robot), seconds, motions(robot), rng, SIZE)
        paths.append(folder / f"log_{number}.csv")
        write_log(paths[-1], drive(robot, HIDDEN, plan, seed=number))
    return Recorded(tuple(paths), Path(robot.model))


def _arm(folder: Path, joints: int) -> Robot:
    robot = load_robot("arm6")
    servos = robot.servos[:joints]
    moving = [servo.name for servo in servos]
    home = angles_at_home(mujoco.MjModel.from_xml_path(str(robot.model)))
    spec = keep_joints(Path(robot.model), moving)
    angles = [home[name] for name in moving]
    spec.add_key(name="home", qpos=angles, ctrl=angles)
    spec.compile()
    model = write_text(folder / MODEL, spec.to_xml())
    return replace(robot, servos=servos, model=model, rate=100.0)


class Worked(NamedTuple):
    """What a worker did."""

    amount: float  # seconds of log diagnosed, or replays
    seconds: float
    memory: int  # bytes that its process took at most
    values: tuple[float, ...]  # that it found


class Worker(Row):
    """A row whose work is done by a function in a process of its own."""

    of = None

    def __init__(
        self, work: Callable[[Recorded], Worked], joints: int, seconds: float, logs: int
    ) -> None:
        self._work, self._sizes = work, (joints, seconds, logs)
        self.found: Worked | None = None

    def build(self) -> None:
        """Record the logs and start the process."""
        self._folder = tempfile.TemporaryDirectory()
        self._recorded = record(Path(self._folder.name), *self._sizes)
        self._pool: Pool = multiprocessing.get_context("spawn").Pool(1)
        self._pool.apply(imported)

    def run(self) -> Timing:
        """Have it done once."""
        self.found = self._pool.apply(self._work, (self._recorded,))
        return Timing(self.found.amount, self.found.seconds, 0)

    def peak(self) -> float | None:
        """Return the bytes that the process took at most."""
        return None if self.found is None else float(self.found.memory)

    def close(self) -> None:
        """End the process and take the logs away."""
        self._pool.terminate()
        self._pool.join()
        self._folder.cleanup()


class Diagnose(Worker):
    """The whole diagnosis with all its candidates; the rate is seconds of log a second."""

    unit = "s of log"

    def __init__(
        self, name: str, joints: int, seconds: float, logs: int, long: bool = False
    ) -> None:
        super().__init__(diagnosed, joints, seconds, logs)
        self.name, self.long = name, long
        count = f"{logs} logs" if logs > 1 else "a log"
        self.setup = f"whole library, {count} of {seconds:g} s at 100 Hz, {joints} joints"


class Fit(Worker):
    """Six values fitted to a log of three joints, by this project or by mujoco.sysid."""

    unit = "replays"

    def __init__(self, by: Literal["sim2real", "sysid"], seconds: float) -> None:
        super().__init__(fitted if by == "sim2real" else fitted_by_sysid, 3, seconds, 1)
        self.name = "fit" if by == "sim2real" else "fit_sysid"
        if by == "sim2real":
            self.of = "fit_sysid"
        who = "Gauss-Newton on mujoco.batch" if by == "sim2real" else "mujoco.sysid's optimizer"
        self.setup = f"{who}, friction and gain of 3 joints, a log of {seconds:g} s"

    def missing(self) -> str | None:
        """Return why mujoco.sysid cannot be imported, or None: without its extra it is empty."""
        from mujoco import sysid

        if self.name == "fit_sysid" and not hasattr(sysid, "optimize"):
            return "fit_sysid: mujoco[sysid] is not installed; pip install '.[bench]'"
        return None


def imported() -> None:
    """Import what a worker needs, so that no run is timed with it."""
    import sim2real.diagnosis.diagnose  # noqa: F401


def diagnosed(recorded: Recorded) -> Worked:
    """Diagnose the logs."""
    from sim2real.diagnosis.diagnose import diagnose

    length = sum(_length(read_log(path)) for path in recorded.logs)
    begin = time.perf_counter()
    report = diagnose(list(recorded.logs), recorded.model)
    seconds = time.perf_counter() - begin
    return Worked(length, seconds, _peak(), tuple(cause.value for cause in report.values))


def fitted(recorded: Recorded) -> Worked:
    """Fit by this project's Gauss-Newton, both folds side by side."""
    from sim2real.diagnosis.data.dataset import Data
    from sim2real.diagnosis.data.simulate import Work
    from sim2real.diagnosis.inference.candidates import candidates
    from sim2real.diagnosis.inference.fit import Start
    from sim2real.diagnosis.inference.hypotheses import Hypothesis
    from sim2real.diagnosis.inference.judge import Judge

    data = Data.of([log := read_log(recorded.logs[0])], recorded.model)
    wanted = [(name, j) for name in ("coulomb_friction", "position_gain") for j in log.joints]
    by_name = {(c.name, c.place): c for c in candidates(data)}
    members = tuple(by_name[key] for key in wanted)
    judge = Judge(data, work=(work := Work()))
    before = work.seconds
    begin = time.perf_counter()
    neutral = np.concatenate([member.neutral for member in members])[None]
    (fit,) = judge.fitter.fit([Start(Hypothesis(members), neutral)], rounds=ROUNDS)
    seconds = time.perf_counter() - begin
    replays = (work.seconds - before) / _length(log)
    return Worked(replays, seconds, _peak(), tuple(fit.mean))


def fitted_by_sysid(recorded: Recorded) -> Worked:
    """Fit by mujoco.sysid's own optimizer, on windows of the same length."""
    from mujoco import sysid

    log, spec = read_log(recorded.logs[0]), mujoco.MjSpec.from_file(str(recorded.model))
    sequences = _sequences(sysid, log, spec)
    names = [f"{kind} {joint}" for kind in ("friction", "gain") for joint in log.joints]
    parameters = sysid.ParameterDict({name: _parameter(sysid, name, spec) for name in names})
    parameters.move_off_bounds()  # where it would stall
    replays = 0

    def residual(x: np.ndarray, own: Any) -> Any:
        nonlocal replays
        replays += x.shape[1] if x.ndim > 1 else 1
        return sysid.residual(x, own, [sequences])

    begin = time.perf_counter()
    found, _ = sysid.optimize(parameters, residual, verbose=False, max_iters=ROUNDS)
    seconds = time.perf_counter() - begin
    return Worked(replays, seconds, _peak(), tuple(found.as_vector().tolist()))


def _parameter(sysid: Any, name: str, model: mujoco.MjSpec) -> Any:
    kind, joint = name.split()
    stiffness = float(model.actuator(joint).gainprm[0])  # N·m/rad

    def friction(spec: mujoco.MjSpec, own: Any) -> None:
        spec.joint(joint).frictionloss = own.value[0]

    def gain(spec: mujoco.MjSpec, own: Any) -> None:
        sysid.apply_pgain(spec, joint, stiffness * own.value[0])

    neutral = 0.0 if kind == "friction" else 1.0
    modifier = friction if kind == "friction" else gain
    return sysid.Parameter(name, neutral, 0.0, LARGEST[kind], modifier=modifier)


def _sequences(sysid: Any, log: Log, spec: mujoco.MjSpec) -> Any:
    for joint in log.joints:
        kind = mujoco.mjtSensor.mjSENS_JOINTPOS
        spec.add_sensor(name=joint, type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
    model = spec.compile()
    rate = round(1 / float(np.median(np.diff(log.time))))
    rows, dt = round(PIECE * rate), model.opt.timestep
    qpos, qvel, ctrl = (
        np.column_stack([log.column(f"{kind}.{joint}") for joint in log.joints])
        for kind in ("qpos", "qvel", "ctrl")
    )
    states, controls, measured, names = [], [], [], []
    for first in range(0, len(log) - rows, rows):
        time_ = log.time[first : first + rows] - log.time[first]
        clock = np.arange(round(time_[-1] / dt) + 1) * dt
        held = ctrl[first + np.searchsorted(time_, clock + 1e-9, side="right") - 1]
        states.append(sysid.create_initial_state(model, qpos[first], qvel[first]))
        controls.append(sysid.TimeSeries(clock, held))
        grid = np.arange(rows - 1) / rate  # the same for all: it stacks them
        path = [np.interp(grid, time_, column) for column in qpos[first : first + rows].T]
        measured.append(sysid.TimeSeries.from_names(grid, np.column_stack(path), model))
        names.append(f"from {first}")
    return sysid.ModelSequences("arm", spec, names, states, controls, measured)


def _length(log: Log) -> float:
    return float(log.time[-1] - log.time[0])


def _peak() -> int:
    """Return the most memory that this process took [bytes]."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
