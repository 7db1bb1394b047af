"""Whole episodes of one deterministic policy, each with its own robot and random numbers.

played = play(trained.world(50), trained.actor(trained.theta), values, seeds)
played.returns                                  # (n,)
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from envs.torch_env import RowsEnv

Watch = Callable[[EnvBase, np.ndarray], None]


class EpisodeResults(NamedTuple):
    """Returns, lengths and failures of n episodes."""

    returns: np.ndarray  # (n,)
    lengths: np.ndarray  # (n,) control steps
    failed: np.ndarray  # (n,) bool: a simulation error ended it


@torch.no_grad()
def run_episodes(
    env: EnvBase,
    actor: TensorDictModuleBase,
    values: np.ndarray | None,
    seeds: np.ndarray,
    watch: Watch | None = None,
) -> EpisodeResults:
    """Run one episode in each row; rows that are done run on, unnoticed.

    Args:
        env: the world with its transforms, N rows.
        actor: maps the environment's entries to "action".
        values: the robots' parameters, (N, P); None for the world's own.
        seeds: seeds of the episodes, (N,) uint64. A world that is not one over rows takes them all
            together as one seed.
        watch: called before each step with the environment and the rows whose episodes go on, (N,)
            bool.
    """
    count = len(seeds)
    returns, lengths = np.zeros(count), np.zeros(count, np.int64)
    failed, alive = np.zeros(count, bool), np.ones(count, bool)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        now = _start(env, values, seeds)
        while alive.any():
            if watch is not None:
                watch(env, alive)
            step, now = env.step_and_maybe_reset(actor(now))
            after = step["next"]
            returns += np.where(alive, _column(after, "reward"), 0.0)
            lengths += alive
            if (broken := after.get("failed", None)) is not None:
                failed |= alive & broken[..., 0].cpu().numpy()
            alive &= ~_column(after, "done")
    return EpisodeResults(returns, lengths, failed)


def _start(env: EnvBase, values: np.ndarray | None, seeds: np.ndarray) -> TensorDictBase:
    if not isinstance(env.base_env, RowsEnv):
        env.set_seed(int(np.bitwise_xor.reduce(seeds) % 2**31))
        return env.reset()
    own = env.base_env.rows.space.points(len(seeds)) if values is None else values
    return env.reset(values=own, seeds=seeds)


def _column(data: TensorDictBase, name: str) -> np.ndarray:
    return np.asarray(data[name][..., 0].cpu())
