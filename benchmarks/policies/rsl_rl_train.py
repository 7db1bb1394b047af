"""rsl_rl's PPO with legged_gym's observation: the normalizer is part of the exported network."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from benchmarks.policies.rows import Rows
from benchmarks.policies.tasks import LEGS_SCALE, Policy

ROWS, STEPS = 64, 24


def train(policy: Policy, frames: int, out: Path) -> dict[str, Any]:
    """Train, write the ONNX file, and return the description."""
    from rsl_rl.env import VecEnv
    from rsl_rl.runners import OnPolicyRunner

    class Env(VecEnv):
        """Our rows as a VecEnv."""

        def __init__(self) -> None:
            self.rows = Rows(policy.task(), ROWS)
            self.num_envs, self.num_actions = ROWS, self.rows.actions
            self.max_episode_length, self.device, self.cfg = self.rows.steps, "cpu", {}
            self.episode_length_buf = torch.zeros(ROWS, dtype=torch.long)
            self.seen = self.rows.reset()

        def get_observations(self):
            return TensorDict({"policy": torch.from_numpy(self.seen)}, [ROWS])

        def step(self, actions):
            moved = self.rows.step(actions.numpy())
            self.seen, over = moved.seen, moved.ended | moved.cut
            reward = torch.from_numpy(moved.reward.astype(np.float32))
            late = {"time_outs": torch.from_numpy((moved.cut & ~moved.ended).astype(np.float32))}
            return self.get_observations(), reward, torch.from_numpy(over.astype(np.int64)), late

    torch.manual_seed(0)
    net = {"class_name": "MLPModel", "hidden_dims": [32, 32], "activation": "elu"}
    gaussian = {"class_name": "GaussianDistribution", "init_std": 0.5}
    settings = {
        "num_steps_per_env": STEPS,
        "save_interval": 1000,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": {**net, "obs_normalization": True, "distribution_cfg": gaussian},
        "critic": {**net, "obs_normalization": True},
        "algorithm": {"class_name": "PPO", "learning_rate": 1e-3, "entropy_coef": 0.001},
    }
    env = Env()
    runner = OnPolicyRunner(env, settings, log_dir=None, device="cpu")
    runner.learn(max(frames // (ROWS * STEPS), 1))
    with TemporaryDirectory() as folder:
        runner.export_policy_to_onnx(folder, "policy.onnx")
        import onnx

        onnx.save(onnx.load(str(Path(folder) / "policy.onnx")), str(out))
    return {
        "name": "quad8 of rsl_rl",
        "base": "legged_gym",
        "default_pose": env.rows.pose,
        "observation": [
            {"term": "gyro", "scale": 0.25},
            {"term": "gravity"},
            {"term": "command", "size": 2, "scale": 2.0},
            {"term": "joint_position", "relative": True},
            {"term": "joint_velocity", "scale": 0.05},
            {"term": "last_action"},
        ],
        "action": {"law": "joint_position", "scale": LEGS_SCALE, "offset": "default_pose"},
    }
