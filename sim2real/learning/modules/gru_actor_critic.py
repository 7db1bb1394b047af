"""Actor and critic with a memory: they tell robots apart by how they answer.

    policy = GRUActorCritic(11, 3, low, high, hidden=(64,), activation="tanh", log_std=0.0,
                            memory=64, window=16)
    mean, memory = policy.advance(torch.cat([observation, memory], -1))  # acting, (N, O + M)
    mean, log_std, value = policy(windows)                               # learning, (S, L, O + M)

A gated recurrent unit (Cho et al. 2014) turns what was seen into M numbers, which the actor and the
critic see beside the observation. What they are given is the observation and the memory before it,
all zeros at an episode's start. When learning, windows of L steps start from the memory that acting
had there and carry their own on, so gradients reach L steps back; an all-zero memory within a
window starts it anew.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from sim2real.learning.modules.acting import Actor
from sim2real.learning.modules.actor_critic import ActorCritic
from sim2real.learning.modules.policy import Activation
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class GRUActorCritic(ActorCritic):
    """An actor and critic over observation and memory.

    Args:
        observation_size: O, numbers in an observation.
        action_size: A, numbers in an action.
        action_low: the actions' lower limits, (A,), in the actions' units.
        action_high: the actions' upper limits, (A,).
        hidden: widths of the hidden layers of both, which follow the memory.
        activation: the hidden layers' nonlinearity.
        log_std: logarithm of the actions' first standard deviation.
        memory: M, numbers that are remembered.
        window: L, steps that a gradient reaches back.

    Raises:
        Sim2RealError: for sizes or names that make no network.
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        action_low: np.ndarray,
        action_high: np.ndarray,
        *,
        hidden: tuple[int, ...],
        activation: Activation,
        log_std: float,
        memory: int,
        window: int,
    ) -> None:
        if memory < 1 or window < 1:
            raise Sim2RealError(f"policy.memory={memory} and window={window} must be at least 1")
        limits = (action_low, action_high)
        shape = {"hidden": hidden, "activation": activation, "log_std": log_std}
        super().__init__(observation_size + memory, action_size, *limits, **shape)  # type: ignore[arg-type]
        self.memory, self.window, self.seen = memory, window, observation_size
        self._gates = [(3 * memory, observation_size), (3 * memory,)]
        self._gates += [(3 * memory, memory), (3 * memory,)]
        count = sum(int(np.prod(shape)) for shape in self._gates)
        self.theta = nn.Parameter(torch.zeros(self._count + count))  # (P,)

    @property
    def shape(self) -> dict[str, int | str | list[int]]:
        """What parameters must fit: sizes and nonlinearity."""
        return super().shape | {"observation_size": self.seen, "memory": self.memory}

    def gates(self, flat: Tensor) -> list[Tensor]:
        """Return the unit's weights and biases, as `torch.nn.GRUCell` orders them."""
        parts = flat[self._count :].split([int(np.prod(shape)) for shape in self._gates])
        wx, bx, wh, bh = (p.view(shape) for p, shape in zip(parts, self._gates, strict=True))
        return [wx, wh, bx, bh]

    @torch.no_grad()
    def initialize(self, generator: torch.Generator) -> None:
        """Draw the heads as `ActorCritic` does, the unit uniform within 1 / sqrt(M), as torch."""
        super().initialize(generator)
        reach = self.memory**-0.5
        self.theta[self._count :].uniform_(-reach, reach, generator=generator)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Map steps (B, O + M) or windows of steps (S, L, O + M) to means, deviations, values.

        Returns:
            Means (..., A), log deviations (A,), values (...).
        """
        windows = observation if observation.dim() == 3 else observation[:, None]
        remembered = self._remember(windows)  # (S, L, M)
        both = torch.cat([windows[..., : self.seen], remembered], -1)
        mean, log_std, value = super().forward(both.flatten(0, 1))
        lead = observation.shape[:-1]
        return mean.view(*lead, -1), log_std, value.view(lead)

    def _remember(self, windows: Tensor) -> Tensor:
        """Return the memory after each step, (S, L, M)."""
        wx, wh, bx, bh = self.gates(self.theta)
        inputs = F.linear(windows[..., : self.seen], wx, bx)  # (S, L, 3 M)
        before = windows[..., self.seen :]
        kept = (before != 0).any(-1, keepdim=True).to(windows.dtype)  # (S, L, 1)
        memory, after = before[:, 0], []
        for step in range(windows.shape[1]):
            memory = _unit(inputs[:, step], memory * kept[:, step], wh, bh)
            after.append(memory)
        return torch.stack(after, 1)

    @torch.no_grad()
    def advance(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Map observations and memories (N, O + M) to means (N, A) and the next memories (N, M)."""
        memory = self._remember(observation[:, None])[:, 0]
        return super().mean(torch.cat([observation[:, : self.seen], memory], -1)), memory

    def mean(self, observation: Tensor) -> Tensor:
        """Map observations and memories (B, O + M) to means (B, A)."""
        return self.advance(observation)[0]

    def actor(self, mean: np.ndarray, std: np.ndarray) -> Actor:
        """Return the deterministic policy, on the CPU; it remembers what it is given.

        Args:
            mean: what normalization subtracts from an observation, (O,).
            std: what it divides by, (O,).
        """
        size, memory = self.seen, self.memory
        plain = super().actor(np.zeros(size + memory), np.ones(size + memory))
        cell = nn.GRUCell(size, memory)
        with torch.no_grad():
            for own, value in zip(cell.parameters(), self.gates(self.theta.cpu()), strict=True):
                own.copy_(value)
        network = Remembering(cell, plain.network)
        return Actor(network, mean, std, self.action_low, self.action_high)


class Remembering(nn.Module):
    """A network behind a memory of its own, one for each row that it is given.

    Every call gives it the next observation of the same rows; another number of rows, or `forget`,
    starts afresh.

    Args:
        cell: the memory.
        network: from observation and memory (N, O + M) to actions (N, A).
    """

    def __init__(self, cell: nn.GRUCell, network: nn.Module) -> None:
        super().__init__()
        self.cell, self.network = cell, network
        self._memory: Tensor | None = None

    def forget(self) -> None:
        """Start afresh."""
        self._memory = None

    def forward(self, observation: Tensor) -> Tensor:
        """Map the next observations (N, O), or (O,) of one row, to actions."""
        rows = observation if observation.dim() == 2 else observation[None]
        before = self._memory
        if before is None or len(before) != len(rows):
            before = rows.new_zeros(len(rows), self.cell.hidden_size)
        self._memory = memory = self.cell(rows, before)
        action = self.network(torch.cat([rows, memory], -1))
        return action if observation.dim() == 2 else action[0]


def _unit(inputs: Tensor, memory: Tensor, wh: Tensor, bh: Tensor) -> Tensor:
    """Return the next memory (S, M), the gates in the order of torch: reset, update, new."""
    size = memory.shape[1]
    own = F.linear(memory, wh, bh)
    both = torch.sigmoid(inputs[:, : 2 * size] + own[:, : 2 * size])
    new = torch.tanh(inputs[:, 2 * size :] + both[:, :size] * own[:, 2 * size :])
    return torch.lerp(new, memory, both[:, size:])
