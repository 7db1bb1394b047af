"""The robot is stepped as its simulation is: by a collector, with somebody's own parts."""

from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.data import Composite, Unbounded
from torchrl.envs import StepCounter, Transform

from envs.mujoco import MujocoEnv
from envs.tasks import Bench1
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.env import HardwareEnv
from hardware.log import read_log
from sim2real.deployment.deploy import run_deployment
from sim2real.deployment.robot_env import on_robot, robot_of
from sim2real.deployment.session import Deployment
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import RunInterrupted
from tests.sim2real.trained import make_learner

WORDS = ["env=bench1", "env.task.seconds=0.4", "algorithm=ppo", "algorithm.num_rows=4"]
WORDS += ["algorithm.steps=32", "algorithm.minibatch_size=32", "algorithm.epochs=1"]
STEPS = 20  # of an episode that a transform ends


def test_a_collector_drives_the_emulated_bus_as_it_drives_the_simulation() -> None:
    """Same specs of what is seen and done, same transforms with the statistics of training."""
    learner: Any = make_learner(WORDS)
    learner.iterate()
    trained = learner.trained()
    backend = ServoBackend(load_robot("bench1"), settle=0.1)
    robot = trained.environment.with_base(partial(HardwareEnv, Bench1(seconds=0.4), backend))
    twin, env = trained.make_env(1), trained.make_env(1, robot)
    try:
        for one, other in ((twin.observation_spec, env.observation_spec),):
            assert one["observation"] == other["observation"]
        assert twin.action_spec == env.action_spec and twin.reward_spec == env.reward_spec
        chains: list[Any] = [twin.transform, env.transform]
        assert [type(t) for t in chains[0]] == [type(t) for t in chains[1]]
        make = learner.parts.part("collector")
        collector = make(env, learner.policy.actor, frames_per_batch=40, total_frames=40)
        batch = next(iter(collector))
        assert batch.shape == (1, 40) and batch["next", "done"].sum() == 2
        assert batch["next", "robot", "fresh"].all()
        mean, std = learner.collecting.env.transform.transforms[1].affine()
        raw = torch.from_numpy(env.base_env._last)
        seen = ((raw - mean) / std).clamp(-10, 10).float()
        torch.testing.assert_close(collector._carrier["observation"], seen)
        assert float(std.min()) < 0.9
    finally:
        env.close()


class Before(Transform):
    """Shows the step before beside the present one, and turns actions about."""

    def __init__(self) -> None:
        super().__init__(["observation"], ["both"], ["action"], ["action"])
        self.before = torch.zeros(0)

    def _show(self, after: TensorDictBase, before: torch.Tensor) -> TensorDictBase:
        self.before = after.get("observation")
        return after.set("both", torch.cat([before, self.before], -1))

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        return self._show(next_tensordict, self.before)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._show(tensordict_reset, tensordict_reset.get("observation"))

    def _inv_apply_transform(self, action: torch.Tensor) -> torch.Tensor:
        return -action

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Return the specs with both steps."""
        seen = observation_spec["observation"]
        both = torch.Size((*seen.shape[:-1], 2 * seen.shape[-1]))
        observation_spec["both"] = Unbounded(both, dtype=seen.dtype, device=seen.device)
        return observation_spec


@pytest.mark.parametrize("cut", [True, False])
def test_somebody_s_own_transform_and_actor_drive_the_emulated_bus(cut: bool, tmp_path) -> None:
    """The log has what they say of what the task observed; returns are not rounded on the way.

    An episode may end by a transform before its task ends it.
    """
    task = Bench1(seconds=0.6)
    transforms: Any = {"before": Before, "steps": partial(StepCounter, max_steps=STEPS)}
    own = EnvironmentFactory(partial(MujocoEnv, task), transforms=transforms)
    size, low, high = own.observation_and_action_spec()
    gains = torch.linspace(-1.5, 1.5, 2 * size)[:, None]
    actor = TensorDictModule(lambda both: both @ gains, ["both"], ["action"])
    trained = TrainedPolicy(
        np.zeros(0, np.float32), lambda theta: actor, own, {}, 0, clips_actions=cut
    )
    deployment = Deployment(trained.theta, NoAdaptation(), trials=2, seed=0)
    backend = ServoBackend(load_robot("bench1"), settle=0.1)
    env = on_robot(trained, task, backend, tmp_path / "logs")
    run_deployment(env, trained, deployment, tmp_path)
    log = robot_of(env).log.last
    assert log is not None and len(log) == STEPS + 1 < task.max_steps
    seen = np.stack([log.column(f"obs.{i}") for i in range(size)], 1)[:STEPS]
    both = np.concatenate([np.vstack([seen[:1], seen[:-1]]), seen], 1)
    said = -both @ gains.double().numpy()
    asked = np.clip(said, low, high) if cut else said
    np.testing.assert_allclose(log.column("action.0")[:STEPS], asked[:, 0], atol=1e-5)
    assert ((said < low) | (said > high)).any() and ((said > low) & (said < high)).any()
    paid = log.column("reward")[:STEPS]
    assert deployment.before[1] == np.cumsum(paid)[-1]
    assert deployment.before[1] != np.cumsum(paid.astype(np.float32), dtype=float)[-1]


def test_ctrl_c_in_a_policy_stands_in_the_log(tmp_path) -> None:
    """The episode that it broke off does not look complete; the log says what robot it was."""
    calls: list[int] = []

    def act(seen: torch.Tensor) -> torch.Tensor:
        calls.append(1)
        if len(calls) == 8:
            raise KeyboardInterrupt
        return torch.zeros(1, 1)

    own = EnvironmentFactory(partial(MujocoEnv, Bench1(seconds=0.6)))
    actor = TensorDictModule(act, ["observation"], ["action"])
    trained = TrainedPolicy(np.zeros(0, np.float32), lambda theta: actor, own, {}, 0)
    deployment = Deployment(trained.theta, NoAdaptation(), trials=1, seed=0)
    backend = ServoBackend(load_robot("bench1"), settle=0.1)
    env = on_robot(trained, Bench1(seconds=0.6), backend, tmp_path / "logs")
    with pytest.raises(RunInterrupted, match="torque is off"):
        run_deployment(env, trained, deployment, tmp_path)
    log = read_log(tmp_path / "logs" / "episode-0000.csv")
    assert (len(log), log.meta["stopped"], log.meta["emulated"]) == (8, "KeyboardInterrupt", True)
    assert backend.world is not None and not backend.world.firmware.torque_on.any()
