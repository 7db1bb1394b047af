"""A policy that plays in its own simulator, with effects, and what its robot would measure there.

    player = load_player("outputs/train/quad8_es/…")      # or policy.npz, .onnx, .pt2 of a task
    episodes = player([Drawn(make("payload", where="torso"), (0.25,), (0.24, 0.26))], 32, seed=0)
    episodes[0].columns["qpos.hip_fl"], episodes[0].returned

The simulator is that of the policy's training, without what training drew. Episodes of one seed
start alike whatever the effects are.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
from scipy.spatial.transform import Rotation
from tensordict.nn import TensorDictModule
from torchrl.envs import EnvBase

from envs.mujoco import MujocoEnv
from envs.simulation import Simulation
from envs.tasks import servo as servo_tasks
from envs.tasks.servo import ServoTask
from sim2real.deployment.actors import LoadedPolicy, load_actor
from sim2real.deployment.deploy import servo_task
from sim2real.deployment.trained import load_policy
from sim2real.diagnosis.closed_loop.check import Drawn
from sim2real.diagnosis.closed_loop.measured import AXES, QUATERNION, Episode, as_measured
from sim2real.evaluation.cause_costs import HALF, Cause, CoalitionRollouts
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError

EXPORT = ("policy.json", "policy.npz")
MODULES = (".onnx", ".pt2")
FREE = int(mujoco.mjtJoint.mjJNT_FREE)


def load_player(path: str | Path, task: str | None = None) -> PolicySimulator:
    """Return a policy that plays.

    Args:
        path: a run's folder or a checkpoint in it, or a file as `load_actor` reads it.
        task: the class name of the task, which the log may say; of an export its own counts.

    Raises:
        Sim2RealError: a policy that cannot be read, or whose task is not known.
    """
    path = Path(path).expanduser()
    folder = path.parent if path.name in EXPORT else path
    if path.suffix not in MODULES and not (folder / EXPORT[0]).is_file():
        return PolicySimulator(load_policy(path))
    actor = load_actor(path)
    return PolicySimulator(_of_file(actor, path, actor.task or task))


def _of_file(actor: LoadedPolicy, path: Path, name: str | None) -> TrainedPolicy:
    """Return a function of observations as a trained policy of a task of ours."""
    kind = getattr(servo_tasks, name or "", None)
    if not (isinstance(kind, type) and issubclass(kind, ServoTask)):
        raise Sim2RealError(
            f"{path}: the file does not name a known task of a servo robot (it names {name}), so "
            f"the policy cannot run in a simulator; give the run that trained it"
        )

    def act(observation: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(actor(observation.numpy()))

    task: ServoTask = getattr(servo_tasks, kind.__name__)()
    module = TensorDictModule(act, ["observation"], ["action"])
    return TrainedPolicy(
        np.zeros(0, np.float32),
        lambda theta: module,
        EnvironmentFactory(partial(MujocoEnv, task, dtype=torch.float64)),
        {},
        0,
        dtype=torch.float64,
        source=path,
    )


class PolicySimulator:
    """A policy that plays; see the module's text.

    Args:
        trained: the policy, of a task of a servo robot.

    Attributes:
        name: its file.
        step: s of a control step.
        needs_tracker: whether the task pays for where the base is.

    Raises:
        Sim2RealError: a policy of another kind of task.
    """

    def __init__(self, trained: TrainedPolicy) -> None:
        self.task = servo_task(trained.environment)
        self.trained = trained
        self.name = str(trained.source)
        self.step = float(self.task.dt)
        self.needs_tracker = self.task.with_distance_reward() is not None

    def __call__(self, effects: Sequence[Drawn], episodes: int, seed: int) -> list[Episode]:
        """Play episodes in the simulator with effects.

        Args:
            effects: with values and intervals; the first value is drawn from its interval.
            episodes: their number.
            seed: of starts, noise and values.
        """
        causes = [Cause(e, values, _std(ci), ci) for e, values, ci in effects]
        game = CoalitionRollouts(self.trained, causes, episodes, seed)
        every = frozenset(range(len(causes)))
        environment, values = game.robots(every, [every])
        watch = _Watch(self.task, episodes)
        played = self.trained.run_episodes(game.seeds, environment, values[0], watch=watch)
        return [
            Episode(watch.columns(row, int(count)), self.step, float(paid))
            for row, (count, paid) in enumerate(zip(played.lengths, played.returns, strict=True))
        ]


def _std(ci: tuple[float, float] | None) -> float:
    return 0.0 if ci is None else (ci[1] - ci[0]) / 2 / HALF


class _Watch:
    """Writes down what all robots of a task measure before each step."""

    def __init__(self, task: ServoTask, count: int) -> None:
        model = task.spec().compile()
        self._joints = {
            f"qpos.{model.joint(int(j)).name}": int(model.jnt_qposadr[j])
            for j in model.actuator_trnid[:, 0]
        }
        self._sites = {
            model.site(i).name: model.site_quat[i].copy()
            for i in range(model.nsite)
            if int(model.jnt_type[0]) == FREE
            and int(model.site_bodyid[i]) == int(model.jnt_bodyid[0])
        }
        self._rows: list[dict[str, np.ndarray]] = []

    def __call__(self, env: EnvBase, alive: np.ndarray) -> None:
        """Take one row of all robots."""
        base: Any = env.base_env
        rows = base.rows
        assert isinstance(rows, Simulation)
        state = rows.measured()
        row = {name: state.qpos[:, place].copy() for name, place in self._joints.items()}
        for site, own in self._sites.items():
            row |= _imu(site, own, state.qpos[:, 3:7], state.qvel[:, 3:6])
        self._rows.append(row)

    def columns(self, row: int, count: int) -> dict[str, np.ndarray]:
        """Return the channels of one robot in its first `count` rows."""
        one = {
            name: np.array([values[name][row] for values in self._rows[:count]])
            for name in self._rows[0]
        }
        return as_measured(one)


def _imu(site: str, own: np.ndarray, turn: np.ndarray, spin: np.ndarray) -> dict[str, np.ndarray]:
    """Return an IMU's columns at a site (4,), of bases' turns (N, 4) and angular speeds (N, 3)."""
    mount = Rotation.from_quat(own, scalar_first=True)
    whole = (Rotation.from_quat(turn, scalar_first=True) * mount).as_quat(scalar_first=True)
    gyro = mount.inv().apply(spin)
    found = {f"quat.{site}.{part}": whole[:, i] for i, part in enumerate(QUATERNION)}
    return found | {f"gyro.{site}.{axis}": gyro[:, i] for i, axis in enumerate(AXES)}
