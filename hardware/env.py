"""A servo robot as a TorchRL environment, with the specs of its simulated twin.

    backend = ServoBackend(load_robot("quad8"), settle=0.5)       # no port: the emulated robot
    with HardwareEnv(Quad8(), backend, folder=Path("logs")) as env:
        env.arm()                                                 # nothing moves before this
        rollout = env.rollout(150, policy)
        rollout["next", "robot", "applied"]                       # what was really sent

The constructor opens nothing and moves nothing. A step takes one period of the robot's rate: the
action is written at once, the next deadline waited for, everything measured. What the policy asked
for is `action`; ("robot", "goal") is what the task made of it, ("robot", "applied") what the guard
sent, all the rest under "robot" says how the step went. An episode that the guard stops ends with
`failed`; `env.stopped` says why, and the next reset raises until `env.arm()`.

A real robot (a port, a pseudo terminal) raises in `reset` until it was armed, so nothing that
steps environments by itself (`check_env_specs`, a collector) can move one unasked; the emulated
robot arms itself. On leaving the `with` block the robot parks, torque goes off, and that is
verified. Ctrl-C and SIGTERM switch torque off at once.
"""

from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.data import Binary, Composite, Unbounded

from envs.params import ParamSpace
from envs.rows import Step
from envs.tasks.servo import ServoTask
from envs.torch_env import RowsEnv
from hardware.backends import Backend
from hardware.errors import RobotError
from hardware.rows import ActionRecord, RobotRows


class _Rows(RobotRows):
    """One robot as the rows of a `RowsEnv`: without parameters to draw."""

    space = ParamSpace(())

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Take a step; see `RobotRows`."""
        return Step(*super().step(ids, action))


class HardwareEnv(RowsEnv):
    """One robot, batch size (1,).

    Args:
        task: the task, of this robot.
        backend: the robot; see `hardware/backends.py`.
        folder: where each episode's log goes; None writes none.
        device: where tensors go.
        dtype: the dtype of observations, actions and rewards.
        seed: the seed of the episodes' starting poses.
        num_envs: 1: there is one robot.
        cut: whether actions are cut at the task's limits (see `RowsEnv`).

    Raises:
        RobotError: several robots, the task of another one, or a sensor that there is not.
    """

    def __init__(
        self,
        task: ServoTask,
        backend: Backend,
        folder: Path | None = None,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        seed: int = 0,
        num_envs: int = 1,
        cut: bool = True,
    ) -> None:
        if num_envs != 1:
            raise RobotError(f"num_envs={num_envs}: {backend.robot.name} is one robot; give 1")
        super().__init__(_Rows(task, backend, folder), device, dtype, seed, cut=cut)

    @property
    def robot(self) -> RobotRows:
        """The robot under the environment, in NumPy."""
        return self.rows  # type: ignore[return-value]

    @property
    def stopped(self) -> str | None:
        """Why the guard stopped the robot, or None."""
        return self.robot.stopped

    def arm(self) -> None:
        """Let the robot move from now on; for a real one, clear the space around it before.

        Raises:
            HardwareError: a robot that is not as its file says, or cannot be armed.
        """
        self.robot.arm()

    def _make_specs(self) -> None:
        super()._make_specs()
        self.observation_spec["robot"] = Composite(
            {name: self._spec_of(value) for name, value in _entries(self.robot.note).items()},
            shape=self.batch_size,
        )

    def _spec_of(self, value: np.ndarray) -> Unbounded | Binary:
        shape = torch.Size((1, *value.shape))
        if value.dtype == bool:
            return Binary(n=shape[-1], shape=shape, dtype=torch.bool, device=self.device)
        dtype = torch.int64 if value.dtype == np.int64 else torch.float64
        return Unbounded(shape, dtype=dtype, device=self.device)

    def _seen(self, ids: np.ndarray | None) -> dict[str, Any]:
        values = _entries(self.robot.note)
        note = {name: torch.from_numpy(value.copy())[None] for name, value in values.items()}
        return super()._seen(ids) | {"robot": self._wrap(note)}

    def _wrap(self, data: dict[str, Any]) -> TensorDictBase:
        return super()._wrap({name: value.to(self.device) for name, value in data.items()})

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Park, switch torque off, verify, let go; does nothing the second time.

        Raises:
            HardwareError: parking failed, or a servo did not confirm that it is off.
        """
        self.robot.close()
        if not self.is_closed:
            super().close(raise_if_closed=raise_if_closed)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _entries(note: ActionRecord) -> dict[str, np.ndarray]:
    """Return the outcome of the last action, by name."""
    return {
        "goal": note.goal,
        "applied": note.applied,
        "limited": note.limited,
        "fresh": note.fresh,
        "age": np.array([note.age]),
        "missed": np.array([note.missed], np.int64),
    }
