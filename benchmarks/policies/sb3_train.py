"""Stable-Baselines3's PPO: a normalizer outside the network, three frames, the newest first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

from benchmarks.policies.rows import Rows
from benchmarks.policies.tasks import LEG_SCALE, Policy

HISTORY, ROWS = 3, 16


def train(policy: Policy, frames: int, out: Path) -> dict[str, Any]:
    """Train, write the ONNX file, and return the description."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.running_mean_std import RunningMeanStd
    from stable_baselines3.common.vec_env import VecNormalize
    from stable_baselines3.common.vec_env.base_vec_env import VecEnv

    class Env(VecEnv):
        """Our rows as a VecEnv."""

        def __init__(self) -> None:
            self.rows = Rows(policy.task(), ROWS, HISTORY)
            seen = gymnasium.spaces.Box(-np.inf, np.inf, (self.rows.size,), np.float32)
            super().__init__(ROWS, seen, gymnasium.spaces.Box(-1, 1, (self.rows.actions,)))

        def reset(self):
            return self.rows.reset()

        def step_async(self, actions):
            self._action = actions

        def step_wait(self):
            moved = self.rows.step(self._action)
            infos: list[dict] = [{} for _ in range(ROWS)]
            for i in np.flatnonzero(moved.ended | moved.cut):
                infos[i]["terminal_observation"] = moved.last[i]
                infos[i]["TimeLimit.truncated"] = bool(moved.cut[i] and not moved.ended[i])
            return moved.seen, moved.reward.astype(np.float32), moved.ended | moved.cut, infos

        def close(self):
            pass

        def get_attr(self, attr_name, indices=None):
            return [None] * ROWS

        def set_attr(self, attr_name, value, indices=None):
            raise NotImplementedError

        def env_method(self, method_name, *args, indices=None, **kwargs):
            raise NotImplementedError

        def env_is_wrapped(self, wrapper_class, indices=None):
            return [False] * ROWS

    raw = Env()
    env = VecNormalize(raw, norm_reward=True, clip_obs=10.0)
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=256,
        batch_size=256,
        seed=0,
        device="cpu",
        policy_kwargs={"net_arch": [32, 32]},
    )
    model.learn(frames)
    network = torch.nn.Sequential(
        model.policy.mlp_extractor.policy_net, model.policy.action_net
    ).eval()
    one = torch.zeros(1, env.observation_space.shape[0])
    torch.onnx.export(network, (one,), str(out), input_names=["obs"], output_names=["actions"],
                      external_data=False)  # fmt: skip
    seen = env.obs_rms
    assert isinstance(seen, RunningMeanStd)  # a dict where observations are
    mean, std = seen.mean, np.sqrt(seen.var + env.epsilon)
    return {
        "name": "hopper2 of Stable-Baselines3",
        "rate": 100.0,
        "joints": ["hip", "knee"],
        "default_pose": raw.rows.pose,
        "observation": [
            {"term": "joint_position", "relative": True},
            {"term": "joint_velocity", "scale": 0.1},
            {"term": "phase", "frequency": 3.5},
            {"term": "last_action"},
        ],
        "history": {"length": HISTORY, "layout": "frame", "order": "newest_first"},
        "normalizer": {"mean": np.round(mean, 6).tolist(), "std": np.round(std, 6).tolist()},
        "action": {
            "law": "joint_position",
            "scale": LEG_SCALE,
            "offset": "default_pose",
            "clip": 1.0,
        },
    }
