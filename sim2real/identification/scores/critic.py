"""EASI's critic: a network that learns, generation after generation, to part real from simulated.

    score = Critic(variant="gp")
    numbers = score(real, simulated, turn)       # trains, then judges: (n,)

The critic is that of a Wasserstein GAN on transitions. `paper` is EASI's (Dong et al. 2024, and its
code): inputs as they are, weights clipped to 0.01. `gp` standardizes observation, action and change
and takes a gradient penalty (Gulrajani et al. 2017) instead of clipping.
"""

from itertools import pairwise
from typing import Any, Literal

import numpy as np
import torch
from torch import nn

from sim2real.identification.scores.base import Score
from sim2real.runs.distances import standardize
from sim2real.runs.errors import Sim2RealError

VARIANTS = ("gp", "paper")
HALF = 0.5


class Critic(Score):
    """A critic as a score: the less real it thinks a simulation, the larger.

    Args:
        variant: "gp" or "paper".
        updates: gradient steps per generation.
        batch: transitions of each world in a step; the simulated ones evenly of all simulations.
        hidden: widths of the layers.
        lr: learning rate of RMSprop.
        clip: what weights are clipped to ("paper").
        penalty: weight of the gradient penalty ("gp").

    Raises:
        Sim2RealError: an unknown variant or a number out of its range.
    """

    aligned = False
    rows = None

    def __init__(
        self,
        variant: Literal["gp", "paper"] = "gp",
        updates: int = 20,
        batch: int = 4800,
        hidden: tuple[int, ...] = (128, 128),
        lr: float = 3e-4,
        clip: float = 0.01,
        penalty: float = 10.0,
    ) -> None:
        if variant not in VARIANTS:
            raise Sim2RealError(f"score.variant={variant!r} must be one of: {', '.join(VARIANTS)}")
        if updates < 1 or batch < 1 or not hidden or not lr > 0 or not clip > 0 or penalty < 0:
            raise Sim2RealError(
                f"score: updates={updates} and batch={batch} must be at least 1, lr={lr:g} and "
                f"clip={clip:g} above 0, penalty={penalty:g} not negative, hidden not empty"
            )
        self.variant, self.updates, self.batch = variant, updates, batch
        self.hidden, self.lr, self.clip, self.penalty = tuple(hidden), lr, clip, penalty
        self._observation, self._seed = 0, 0
        self._net: nn.Sequential | None = None
        self._optimizer: torch.optim.RMSprop | None = None
        self._loaded: dict[str, np.ndarray] = {}

    def begin(self, observation: int, seed: int) -> None:
        """Forget everything; transitions then have observations of this size."""
        self._observation, self._seed, self._net, self._loaded = observation, seed, None, {}

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Train on this generation, then return how unreal each simulation seems, (n,)."""
        first = self._inputs(real, real)
        second = self._inputs(real, simulated)  # (n, N', F)
        net, optimizer = self._made(first.shape[-1])
        rng = torch.Generator().manual_seed(turn)
        for _ in range(self.updates):
            self._update(net, optimizer, first, second, rng)
        with torch.no_grad():
            return -net(second)[..., 0].mean(dim=1).double().numpy()

    def judged(self, real: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return how real transitions (..., 2 O + A) seem, (...): the larger, the more."""
        seen = self._inputs(real, values)
        net, _ = self._made(seen.shape[-1])
        with torch.no_grad():
            return net(seen)[..., 0].double().numpy()

    def _inputs(self, real: np.ndarray, values: np.ndarray) -> torch.Tensor:
        """Return the network's inputs for transitions (..., 2 O + A)."""
        if self.variant == "gp":
            return torch.as_tensor(standardize(real, values), dtype=torch.float32)
        size = self._observation
        after = values[..., :size] + values[..., -size:]
        given = np.concatenate([values[..., :-size], after], axis=-1)
        return torch.as_tensor(given, dtype=torch.float32)

    def _made(self, size: int) -> tuple[nn.Sequential, torch.optim.RMSprop]:
        if self._net is not None and self._optimizer is not None:
            return self._net, self._optimizer
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._seed)
            widths, layers = (size, *self.hidden), list[nn.Module]()
            for one, other in pairwise(widths):
                layers += [nn.Linear(one, other), nn.ReLU()]
            net = nn.Sequential(*layers, nn.Linear(widths[-1], 1))
        optimizer = torch.optim.RMSprop(net.parameters(), lr=self.lr)
        self._net, self._optimizer = net, optimizer
        self._restore()
        return net, optimizer

    def _update(
        self,
        net: nn.Sequential,
        optimizer: torch.optim.RMSprop,
        real: torch.Tensor,
        simulated: torch.Tensor,
        rng: torch.Generator,
    ) -> None:
        """Take one gradient step."""
        count, length = simulated.shape[:2]
        each = max(1, self.batch // count)
        picked = torch.randint(length, (count, each), generator=rng)
        fake = simulated[torch.arange(count)[:, None], picked].flatten(0, 1)
        true = real[torch.randint(len(real), (len(fake),), generator=rng)]
        if self.variant == "paper":
            with torch.no_grad():
                for weight in net.parameters():
                    weight.clamp_(-self.clip, self.clip)
        loss = HALF * (net(fake).mean() - net(true).mean())
        if self.variant == "gp":
            share = torch.rand((len(fake), 1), generator=rng)
            between = (share * true + (1 - share) * fake).requires_grad_()
            (slope,) = torch.autograd.grad(net(between).sum(), between, create_graph=True)
            loss = loss + self.penalty * ((slope.norm(dim=1) - 1) ** 2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()

    def state(self) -> dict[str, Any]:
        """Return weights and the optimizer's averages as arrays."""
        if self._net is None or self._optimizer is None:
            return {}
        found = {f"net.{i}": p.detach().numpy() for i, p in enumerate(self._net.parameters())}
        for i, weight in enumerate(self._net.parameters()):
            found[f"square.{i}"] = self._optimizer.state[weight]["square_avg"].numpy()
        return {name: array.copy() for name, array in found.items()}

    def load(self, state: dict[str, Any]) -> None:
        """Go back to a state."""
        self._net, self._loaded = None, dict(state)

    def _restore(self) -> None:
        """Put a loaded state into the network and its optimizer."""
        if not self._loaded or self._net is None or self._optimizer is None:
            return
        with torch.no_grad():
            for i, weight in enumerate(self._net.parameters()):
                weight.copy_(torch.from_numpy(self._loaded[f"net.{i}"]))
                self._optimizer.state[weight] = {
                    "step": torch.tensor(0.0),
                    "square_avg": torch.from_numpy(self._loaded[f"square.{i}"].copy()),
                }
        self._loaded = {}
