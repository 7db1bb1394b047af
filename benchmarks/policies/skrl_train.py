"""skrl's PPO: an arm that follows sines, no normalizer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import nn

from benchmarks.policies.rows import Rows
from benchmarks.policies.tasks import ARM_SCALE, Policy

ROWS, ROLLOUT = 64, 32


def train(policy: Policy, frames: int, out: Path) -> dict[str, Any]:
    """Train, write the ONNX file, and return the description."""
    from skrl.agents.torch.ppo import PPO, PPO_CFG
    from skrl.envs.wrappers.torch import Wrapper
    from skrl.memories.torch import RandomMemory
    from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
    from skrl.trainers.torch import SequentialTrainer

    rows = Rows(policy.task(), ROWS)

    class Env(Wrapper):
        """Our rows as a wrapped environment."""

        num_envs, num_agents = ROWS, 1
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (rows.size,), np.float32)
        state_space = None
        action_space = gymnasium.spaces.Box(-4.0, 4.0, (rows.actions,), np.float32)

        def reset(self):
            return torch.from_numpy(rows.reset()), {}

        def step(self, actions):
            moved = rows.step(actions.numpy())
            flags = (torch.from_numpy(x)[:, None] for x in (moved.ended, moved.cut))
            reward = torch.from_numpy(moved.reward.astype(np.float32))[:, None]
            return torch.from_numpy(moved.seen), reward, *flags, {}

        def state(self):
            return None

        def render(self, *args, **kwargs):
            return None

        def close(self):
            pass

    def layers(size: int) -> nn.Sequential:
        return nn.Sequential(nn.Linear(rows.size, 32), nn.ELU(), nn.Linear(32, 32), nn.ELU(),
                             nn.Linear(32, size))  # fmt: skip

    class Acting(GaussianMixin, Model):
        def __init__(self, **spaces) -> None:
            Model.__init__(self, **spaces)
            GaussianMixin.__init__(self)
            self.net = layers(rows.actions)
            self.spread = nn.Parameter(torch.full((rows.actions,), -1.0))

        def compute(self, inputs, role=""):
            return self.net(inputs["observations"]), {"log_std": self.spread}

    class Judging(DeterministicMixin, Model):
        def __init__(self, **spaces) -> None:
            Model.__init__(self, **spaces)
            DeterministicMixin.__init__(self)
            self.net = layers(1)

        def compute(self, inputs, role=""):
            return self.net(inputs["observations"]), {}

    torch.manual_seed(0)
    env = Env(None)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    models = {name: kind(**spaces, device="cpu") for name, kind in
              (("policy", Acting), ("value", Judging))}  # fmt: skip
    memory = RandomMemory(memory_size=ROLLOUT, num_envs=ROWS, device="cpu")
    settings = PPO_CFG(rollouts=ROLLOUT, learning_rate=1e-3, mini_batches=4)
    settings.experiment.write_interval = settings.experiment.checkpoint_interval = 0
    agent = PPO(models=models, memory=memory, cfg=settings, device="cpu", **spaces)
    steps = max(frames // ROWS, ROLLOUT)
    SequentialTrainer(env=env, agents=agent, cfg={"timesteps": steps, "headless": True}).train()
    one = torch.zeros(1, rows.size)
    torch.onnx.export(models["policy"].net.eval(), (one,), str(out), input_names=["obs"],
                      output_names=["actions"], external_data=False)  # fmt: skip
    servos = rows.actions
    return {
        "name": "arm6 of skrl",
        "rate": 50.0,
        "default_pose": rows.pose,
        "observation": [
            {"term": "joint_position", "relative": True},
            {"term": "joint_velocity", "scale": 0.2},
            {"term": "other", "size": servos},
            {"term": "last_action"},
        ],
        "action": {"law": "joint_position", "scale": ARM_SCALE, "offset": "default_pose"},
    }
