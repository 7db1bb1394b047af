"""The robot is stepped by the collector of training, with the transforms of training."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import torch

from envs.tasks import Bench1
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.env import HardwareEnv
from sim2real.config.compose import compose, prepare
from sim2real.learning.algorithms.base import build

WORDS = ["env=bench1", "env.task.seconds=0.4", "algorithm=ppo", "algorithm.num_rows=4"]
WORDS += ["algorithm.steps=32", "algorithm.minibatch_size=32", "algorithm.epochs=1"]


def test_a_collector_drives_the_emulated_bus_as_it_drives_the_simulation() -> None:
    """Same specs of what is seen and done, same transforms with the statistics of training."""
    _, given = prepare(compose(WORDS), Path())
    learner: Any = build(given["algorithm"], given["parts"])
    learner.iterate()
    trained = learner.trained()
    backend = ServoBackend(load_robot("bench1"), settle=0.1)
    robot = trained.environment.over(partial(HardwareEnv, Bench1(seconds=0.4), backend))
    twin, env = trained.world(1), trained.world(1, robot)
    try:
        for one, other in ((twin.observation_spec, env.observation_spec),):
            assert one["observation"] == other["observation"]
        assert twin.action_spec == env.action_spec and twin.reward_spec == env.reward_spec
        chains: list[Any] = [twin.transform, env.transform]
        assert [type(t) for t in chains[0]] == [type(t) for t in chains[1]]
        make = given["parts"].part("collector")
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
