"""Learning, not only stepping: PPO and SAC on Hopper, beside Stable-Baselines3's and TorchRL's.

Stable-Baselines3 runs as `PPO("MlpPolicy", "Hopper-v5")` does, on the CPU with one torch thread, at
which it is fastest beside nothing else. Each row goes on training from where its last run stopped.
"""

from collections.abc import Iterator
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any, Literal

import torch
from torch import nn

from benchmarks.rows.base import Row
from benchmarks.rows.others import TASK
from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.base import build
from sim2real.learning.algorithms.sac import SAC

BATCH = 2048  # environment steps of an iteration, in all rows of PPO but the tuned one


class Ours(Row):
    """An algorithm of this project with the settings of one of its presets.

    A run takes `amount` units, at least; `words` are further overrides, such as
    loss=fast_clip_ppo.
    """

    def __init__(
        self,
        name: str,
        preset: str,
        of: str,
        amount: int,
        unit: Literal["env steps", "updates"],
        setup: str,
        words: tuple[str, ...] = (),
        long: bool = False,
    ) -> None:
        self.long = long
        self.name, self.of, self.unit, self.setup = name, of, unit, setup
        self._words = words
        self._preset, self._amount = preset, amount

    def build(self) -> None:
        """Make the learner and warm it up."""
        few = ["algorithm.steps=10"] if self.unit == "updates" else []  # or a run would be too long
        tree = compose([f"algorithm={self._preset}", *self._words, *few])
        _, given = instantiate(tree, Path())
        self._learner = build(given["algorithm"], given["parts"])
        while not self._count():
            self._learner.iterate()
        self._learner.iterate()

    def _count(self) -> int:
        if self.unit == "env steps":
            return self._learner.frames
        assert isinstance(self._learner, SAC)  # whose presets alone count updates
        return self._learner.updates

    def work(self) -> tuple[float, int]:
        """Iterate on."""
        start = self._count()
        while self._count() - start < self._amount:
            self._learner.iterate()
        return self._count() - start, 0


class StableBaselines3(Row):
    """One of its algorithms with its defaults; TRPO is in its package of contributions."""

    of = None

    def __init__(self, name: str, algorithm: Literal["PPO", "SAC", "TRPO"], amount: int) -> None:
        self.name, self._algorithm, self._amount = name, algorithm, amount
        self._package = self.needs = "sb3_contrib" if algorithm == "TRPO" else "stable_baselines3"
        self.unit = "updates" if algorithm == "SAC" else "env steps"
        self.setup = f"its {algorithm}, defaults, 1 environment"

    def build(self) -> None:
        """Make the learner and warm it up."""
        maker = getattr(import_module(self._package), self._algorithm)  # an optional package
        self._learner = maker("MlpPolicy", TASK, device="cpu", seed=0)
        self._learner.learn(150 if self._algorithm == "SAC" else BATCH)

    def work(self) -> tuple[float, int]:
        """Learn on."""
        before = self._learner.num_timesteps
        self._learner.learn(self._amount, reset_num_timesteps=False)
        return self._learner.num_timesteps - before, 0

    def close(self) -> None:
        """Close the environment."""
        self._learner.get_env().close()


class TorchRLPPO(Row):
    """PPO put together of TorchRL's parts with the settings of its own MuJoCo example."""

    name = "ppo_torchrl_sota"
    of = "ppo_sb3"
    setup = "Collector, GAE, ClipPPOLoss; minibatches of 64, 10 epochs, 1 GymEnv"

    def __init__(self, amount: int) -> None:
        self._amount = amount

    def build(self) -> None:
        """Make all parts and do an iteration."""
        from torchrl.collectors import Collector

        env = _normalized_env()
        actor, critic = _networks(env)
        self._collector = Collector(env, actor, frames_per_batch=BATCH, total_frames=-1)
        self._batches: Iterator[Any] = iter(self._collector)
        self._update = _Update(actor, critic)
        self._update(next(self._batches))

    def work(self) -> tuple[float, int]:
        """Iterate on."""
        steps = 0
        while steps < self._amount:
            self._update(next(self._batches))
            steps += BATCH
        return steps, 0

    def close(self) -> None:
        """Close the environment."""
        self._collector.shutdown()


class _Update:
    """Ten epochs of TorchRL's loss over a batch, advantages computed anew for each."""

    def __init__(self, actor: Any, critic: Any) -> None:
        from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
        from torchrl.data.replay_buffers import SamplerWithoutReplacement
        from torchrl.objectives import ClipPPOLoss
        from torchrl.objectives.value import GAE

        self._advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic)
        self._loss = ClipPPOLoss(
            actor,
            critic,
            clip_epsilon=0.2,
            loss_critic_type="l2",
            entropy_coeff=0.0,
            critic_coeff=0.25,
            normalize_advantage=True,
        )
        self._samples = TensorDictReplayBuffer(
            storage=LazyTensorStorage(BATCH), sampler=SamplerWithoutReplacement(), batch_size=64
        )
        self._optimizers = [
            torch.optim.Adam(module.parameters(), lr=3e-4, eps=1e-5) for module in (actor, critic)
        ]

    def __call__(self, data: Any) -> None:
        for _ in range(10):
            with torch.no_grad():
                data = self._advantage(data)
            self._samples.extend(data.reshape(-1))
            for batch in self._samples:
                loss = self._loss(batch)
                (loss["loss_objective"] + loss["loss_entropy"]).backward()
                loss["loss_critic"].backward()
                for optimizer in self._optimizers:
                    optimizer.step()
                    optimizer.zero_grad()


def _normalized_env() -> Any:
    """Return Hopper with the example's transforms."""
    from torchrl import envs

    seen = ["observation"]
    transforms = envs.Compose(
        envs.VecNormV2(in_keys=seen, decay=0.99999, eps=1e-2),
        envs.ClipTransform(in_keys=seen, low=-10, high=10),  # type: ignore[call-arg]
        envs.RewardSum(),
        envs.StepCounter(),
        envs.DoubleToFloat(in_keys=seen),
    )
    return envs.TransformedEnv(envs.GymEnv(TASK), transforms)


def _networks(env: Any) -> tuple[Any, Any]:
    """Return the example's actor and critic: 64 x 64, tanh, actions squashed."""
    from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
    from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator

    inputs, actions = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    shape: dict[str, Any] = {
        "in_features": inputs,
        "activation_class": nn.Tanh,
        "num_cells": [64, 64],
    }
    mean, value = MLP(out_features=actions, **shape), MLP(out_features=1, **shape)
    for layer in chain(mean.modules(), value.modules()):
        if isinstance(layer, nn.Linear):
            nn.init.orthogonal_(layer.weight, 0.01 if layer in set(value.modules()) else 1.0)
            layer.bias.data.zero_()
    network = nn.Sequential(mean, AddStateIndependentNormalScale(actions))
    limits = {"low": env.action_spec.space.low, "high": env.action_spec.space.high}
    actor = ProbabilisticActor(
        TensorDictModule(network, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        spec=env.full_action_spec,
        distribution_class=TanhNormal,
        distribution_kwargs={**limits, "tanh_loc": False},
        return_log_prob=True,
    )
    return actor, ValueOperator(value, in_keys=["observation"])
