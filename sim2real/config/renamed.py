"""Renamed keys: whoever types the old name is given the new one."""

from __future__ import annotations

RENAMED = {
    "algorithm.adam_eps": "optimizer.eps",
    "algorithm.alpha": "loss.alpha_init",
    "algorithm.buffer_size": "buffer.storage.max_size",
    "algorithm.clip_epsilon": "loss.clip_epsilon",
    "algorithm.critic_coeff": "loss.critic_coeff",
    "algorithm.entropy_coeff": "loss.entropy_coeff",
    "algorithm.gamma": "advantage.gamma",
    "algorithm.learning_rate": "optimizer.lr",
    "algorithm.lmbda": "advantage.lmbda",
    "algorithm.normalize_advantage": "loss.normalize_advantage",
    "algorithm.normalize_observations": "transforms.observation_norm (transforms=normalized)",
    "algorithm.normalize_rewards": "transforms.reward_scaling (transforms=normalized)",
    "algorithm.target_entropy": "loss.target_entropy",
    "env.frames": "transforms.stack.N",
    "env.grey": "transforms=pixels, or transforms=colour",
    "policy.activation": "policy.actor.activation_class and policy.critic.activation_class",
    "policy.hidden": "policy.actor.num_cells and policy.critic.num_cells",
    "policy.memory": "policy.memory.hidden_size",
    "policy.size": "env.size",
}


def renamed(key: str) -> str:
    """Return " (it is now ...)" for an old key, "" for any other."""
    new = RENAMED.get(key)
    return f" (it is now {new})" if new else ""
