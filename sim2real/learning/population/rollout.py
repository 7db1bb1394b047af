"""Whole episodes of one deterministic policy, each with a robot and luck of its own.

played = play(rows, algorithm.module(), values, seeds)
played.returns                                  # (n,)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from envs.rows import Rows


class Played(NamedTuple):
    """What n episodes came to."""

    returns: np.ndarray  # (n,)
    lengths: np.ndarray  # (n,) control steps
    failed: np.ndarray  # (n,) bool: a simulation error ended it


@torch.no_grad()
def play(rows: Rows, policy: nn.Module, values: np.ndarray, seeds: np.ndarray) -> Played:
    """Run one episode in each row.

    Args:
        rows: the world, N rows.
        policy: from raw observations (N, O) of all rows to actions (N, A); one that remembers keeps
            a memory for each row and is given fresh.
        values: the robots' parameters, (n, P), n at most N.
        seeds: of the episodes, (n,) uint64.
    """
    count = len(seeds)
    alive = np.arange(count)
    returns, lengths = np.zeros(count), np.zeros(count, np.int64)
    failed = np.zeros(count, bool)
    observation = np.array(rows.reset(alive, values, seeds), np.float64)  # (n, O)
    while len(alive):
        action = policy(torch.from_numpy(observation)).cpu().numpy().astype(np.float64)  # (n, A)
        step = rows.step(alive, action[alive])
        observation[alive] = step.observation
        returns[alive] += step.reward
        lengths[alive] += 1
        failed[alive] |= step.failed
        alive = alive[~(step.terminated | step.truncated)]
    return Played(returns, lengths, failed)
