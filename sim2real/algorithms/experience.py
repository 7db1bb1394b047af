"""What an actor meets in some steps of all rows, ready for learning.

    experience = gather(stream, policy, steps=128, rng=rng, normalizer=None)
    experience.observation                          # (T + 1, N, O), the last one not acted on

The collector of TorchRL gathers the same numbers in half as much time again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from sim2real.actor_critic import ActorCritic
from sim2real.algorithms.stream import EpisodeStream
from sim2real.conv_actor_critic import ConvActorCritic
from sim2real.normalizer import Normalizer

Tensor = torch.Tensor
LIMIT = 10.0  # deviations beyond which normalized observations are cut


@dataclass(frozen=True)
class Experience:
    """T steps of N rows.

    Attributes:
        observation: normalized, (T + 1, N, O) float32; after an end, of the next episode's start.
        raw: as the rows gave them, (T, N, O) float64.
        action: drawn from the policy, before they were cut at the limits, (T, N, A) float32.
        reward: (T, N) float64.
        terminated: where the task ended an episode, (T, N).
        over: where the task or the time limit did, (T, N).
        cut: last observations of the episodes that the time limit alone ended, (K, O), normalized.
        cut_at: their steps and rows, (K,) each.
    """

    observation: Tensor
    raw: np.ndarray
    action: Tensor
    reward: np.ndarray
    terminated: np.ndarray
    over: np.ndarray
    cut: Tensor
    cut_at: tuple[Tensor, Tensor]

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Flags as TorchRL's value estimators want them: done and terminated."""
        return self.over, self.terminated


def normalized(raw: np.ndarray, normalizer: Normalizer | None) -> np.ndarray:
    """Return observations (..., O) as networks see them."""
    if normalizer is None:
        return raw
    return np.clip((raw - normalizer.mean) / normalizer.std, -LIMIT, LIMIT)


@torch.no_grad()
def gather(
    stream: EpisodeStream,
    policy: ActorCritic | ConvActorCritic,
    steps: int,
    rng: np.random.Generator,
    normalizer: Normalizer | None,
) -> Experience:
    """Let a stochastic policy act for T steps.

    Args:
        stream: where; it goes on from where it is.
        policy: who acts; on its device the results are.
        steps: T.
        rng: source of the actions' noise.
        normalizer: of observations, unchanged; None shows them raw.
    """
    rows, device = stream.rows, policy.theta.device
    shape = (steps, rows.num_rows)
    seen = torch.empty(steps + 1, rows.num_rows, rows.observation_size, device=device)
    raw = np.empty((*shape, rows.observation_size))
    noise = torch.from_numpy(rng.standard_normal((*shape, rows.action_size), dtype=np.float32))
    action = noise.to(device) * policy.present.log_std.exp()
    reward = np.empty(shape)
    terminated, over = np.empty(shape, bool), np.empty(shape, bool)
    low, high = rows.action_low.astype(np.float32), rows.action_high.astype(np.float32)
    cut: list[tuple[int, np.ndarray, np.ndarray]] = []
    for t in range(steps):
        raw[t] = stream.observation
        seen[t] = torch.from_numpy(normalized(raw[t], normalizer))
        action[t] += policy.mean(seen[t])
        step = stream.step(np.clip(action[t].cpu().numpy(), low, high))
        reward[t], terminated[t] = step.reward, step.terminated
        over[t] = step.terminated | step.truncated
        ids = np.flatnonzero(step.truncated & ~step.terminated)
        if len(ids):
            cut.append((t, ids, normalized(step.observation[ids], normalizer)))
    seen[steps] = torch.from_numpy(normalized(stream.observation, normalizer))
    where, last = _join(cut, rows.observation_size)
    return Experience(seen, raw, action, reward, terminated, over, last.to(device), where)


def _join(
    cut: list[tuple[int, np.ndarray, np.ndarray]], size: int
) -> tuple[tuple[Tensor, Tensor], Tensor]:
    """Return steps (K,), rows (K,) and observations (K, O) of the episodes that were cut."""
    steps = [np.full(len(ids), t) for t, ids, _ in cut]
    empty = np.zeros(0, np.int64)
    where = (
        torch.from_numpy(np.concatenate([empty, *steps])),
        torch.from_numpy(np.concatenate([empty, *(ids for _, ids, _ in cut)])),
    )
    last = np.concatenate([np.zeros((0, size)), *(seen for _, _, seen in cut)])
    return where, torch.from_numpy(last).to(torch.float32)
