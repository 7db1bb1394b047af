"""What an actor meets in some steps of all rows, ready for learning.

    experience = gather(stream, policy, steps=128, rng=rng, normalizer=None)
    experience.observation                          # (T + 1, N, O), the last one not acted on

TorchRL's collector over the same rows and actor takes two thirds more time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from sim2real.learning.algorithms.stream import EpisodeStream
from sim2real.learning.modules.actor_critic import ActorCritic
from sim2real.learning.modules.conv_actor_critic import ConvActorCritic
from sim2real.learning.modules.gru_actor_critic import GRUActorCritic
from sim2real.learning.modules.normalizer import Normalizer

Tensor = torch.Tensor
LIMIT = 10.0  # deviations beyond which normalized observations are cut


@dataclass(frozen=True)
class Experience:
    """T steps of N rows.

    Attributes:
        observation: normalized, (T + 1, N, O) float32; after an end, of the next episode's start.
        raw: as the rows gave them, (T, N, O) float64; (T, N, 0) if nothing normalizes them.
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
    memory: Tensor | None = None,
) -> Experience:
    """Let a stochastic policy act for T steps.

    Args:
        stream: where; it goes on from where it is.
        policy: who acts; on its device the results are.
        steps: T.
        rng: source of the actions' noise.
        normalizer: of observations, unchanged; None shows them raw.
        memory: of a policy that remembers, (N, M), taken further; it follows the observation in
            what the experience shows.
    """
    rows, device = stream.rows, policy.theta.device
    shape, size = (steps, rows.num_rows), rows.observation_size
    width = size if memory is None else size + memory.shape[1]
    seen = torch.empty(steps + 1, rows.num_rows, width, device=device)
    raw = np.empty((*shape, size if normalizer else 0))
    noise = torch.from_numpy(rng.standard_normal((*shape, rows.action_size), dtype=np.float32))
    action = noise.to(device) * policy.present.log_std.exp()
    reward = np.empty(shape)
    terminated, over = np.empty(shape, bool), np.empty(shape, bool)
    low, high = rows.action_low.astype(np.float32), rows.action_high.astype(np.float32)
    cut: list[tuple[int, np.ndarray, Tensor]] = []
    for t in range(steps):
        raw[t] = stream.observation[:, : raw.shape[-1]]
        _show(stream.observation, normalizer, memory, seen[t])
        action[t] += _mean(policy, seen[t], memory)
        step = stream.step(np.clip(action[t].cpu().numpy(), low, high))
        reward[t], terminated[t] = step.reward, step.terminated
        over[t] = step.terminated | step.truncated
        ids = np.flatnonzero(step.truncated & ~step.terminated)
        if len(ids):
            last = torch.empty(len(ids), width, device=device)
            _show(step.observation[ids], normalizer, None if memory is None else memory[ids], last)
            cut.append((t, ids, last))
        if memory is not None:
            memory[torch.from_numpy(over[t]).to(device)] = 0.0
    _show(stream.observation, normalizer, memory, seen[steps])
    ends = torch.cat([seen[0, :0], *(last for _, _, last in cut)])
    return Experience(seen, raw, action, reward, terminated, over, ends, _places(cut))


def _show(
    raw: np.ndarray, normalizer: Normalizer | None, memory: Tensor | None, out: Tensor
) -> None:
    """Write what the policy sees of raw observations (n, O) into out (n, O + M)."""
    out[:, : raw.shape[1]] = torch.from_numpy(normalized(raw, normalizer))
    if memory is not None:
        out[:, raw.shape[1] :] = memory


def _mean(policy: ActorCritic | ConvActorCritic, seen: Tensor, memory: Tensor | None) -> Tensor:
    """Return the means (N, A) of the actions, and take the memory further."""
    if memory is None:
        return policy.mean(seen)
    assert isinstance(policy, GRUActorCritic)
    mean, after = policy.advance(seen)
    memory.copy_(after)
    return mean


def _places(cut: list[tuple[int, np.ndarray, Tensor]]) -> tuple[Tensor, Tensor]:
    """Return steps (K,) and rows (K,) of the episodes that were cut."""
    empty = np.zeros(0, np.int64)
    steps = [np.full(len(ids), t) for t, ids, _ in cut]
    rows = [ids for _, ids, _ in cut]
    return tuple(torch.from_numpy(np.concatenate([empty, *x])) for x in (steps, rows))  # type: ignore[return-value]
