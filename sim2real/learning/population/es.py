"""Evolution strategy on a flat vector: ask for candidates, tell their fitness.

    settings = StrategySettings(
        pairs=64, sigma=0.05, learning_rate=0.01, optimizer="adam",
        estimator="antithetic", shaping="centred_ranks",
    )
    strategy = EvolutionStrategy(theta, rng, settings)
    for _ in range(100):
        strategy.tell(fitness(strategy.ask()))      # higher is better
    strategy.mean

It climbs the Gaussian-smoothed fitness J(m) = E f(m + sigma g), g ~ N(0, I), whose gradient is
E f(m + sigma g) g / sigma (Nesterov and Spokoiny 2017; Salimans et al. 2017). Ranks in [-0.5, 0.5]
are of Salimans et al.; keeping the best directions is augmented random search (Mania et al. 2018).
"""

from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from scipy.stats import rankdata

from envs.memory import check_memory
from sim2real.runs.errors import Sim2RealError

COPIES = 4  # of a parameter vector for each direction: its noise, its step, a candidate each way
Estimator = Literal["antithetic", "forward_fd"]
Shaping = Literal["centred_ranks", "standardized", "none"]


def shape_fitness(fitness: np.ndarray, shaping: Shaping) -> np.ndarray:
    """Make fitness independent of its scale.

    Args:
        fitness: values of the candidates, (J,).
        shaping: "centred_ranks": ranks spread over [-0.5, 0.5], ties share theirs; "standardized":
            zero mean and unit standard deviation; "none": as it is. Equal values become 0 in the
            first two.

    Returns:
        Shaped values, (J,) float64.
    """
    fitness = np.asarray(fitness, np.float64)
    if shaping == "none":
        return fitness
    if shaping == "standardized":
        spread = fitness.std()
        return (fitness - fitness.mean()) / spread if spread > 0 else np.zeros_like(fitness)
    return (rankdata(fitness) - 1) / max(len(fitness) - 1, 1) - 0.5


def orthogonal_directions(rng: np.random.Generator, count: int, size: int) -> np.ndarray:
    """Draw Gaussian-like directions that are orthogonal within blocks of `size`.

    Each row alone is distributed as N(0, I): a uniform direction with a chi(size) norm.

    Returns:
        Directions, (count, size).
    """
    blocks = []
    for start in range(0, count, size):
        block = rng.standard_normal((size, min(size, count - start)))  # (P, k)
        q, r = np.linalg.qr(block)
        blocks.append((q * np.sign(np.diagonal(r))).T)
    norms = np.linalg.norm(rng.standard_normal((count, size)), axis=1)
    return np.concatenate(blocks) * norms[:, None]


@dataclass(frozen=True, kw_only=True)
class StrategySettings:
    """The settings of an evolution strategy.

    Raises:
        Sim2RealError: for values out of range.
    """

    pairs: int  # n, directions per iteration
    sigma: float  # standard deviation of the perturbations, in parameter units
    learning_rate: float  # step size of the optimizer
    optimizer: Literal["sgd", "adam"]  # "sgd" or "adam", of torch.optim
    # "antithetic" evaluates both signs of each direction (J = 2n); "forward_fd" one sign and the
    # mean itself, last (J = n + 1)
    estimator: Estimator
    shaping: Shaping  # see `shape_fitness`
    # keep the k directions with the largest |F+ - F-| (antithetic) or F (forward); 0 keeps all
    top_k: int = 0
    orthogonal: bool = False  # draw orthogonal directions instead of independent ones
    weight_decay: float = 0.0  # pull of the mean towards 0, as torch.optim defines it

    def __post_init__(self) -> None:
        for name in ("sigma", "learning_rate"):
            if not getattr(self, name) > 0:
                raise Sim2RealError(f"algorithm.{name}={getattr(self, name)} must be above 0")
        if not self.weight_decay >= 0:
            raise Sim2RealError(f"algorithm.weight_decay={self.weight_decay} must be at least 0")
        if self.pairs < 1 or not 0 <= self.top_k <= self.pairs:
            raise Sim2RealError(
                f"algorithm: pairs={self.pairs} must be at least 1 and top_k={self.top_k} "
                "between 0 (off) and pairs"
            )
        allowed = {
            "optimizer": (self.optimizer, ("sgd", "adam")),
            "estimator": (self.estimator, ("antithetic", "forward_fd")),
            "shaping": (self.shaping, ("centred_ranks", "standardized", "none")),
        }
        for name, (value, choices) in allowed.items():
            if value not in choices:
                raise Sim2RealError(
                    f"algorithm.{name}={value!r} is not one of {', '.join(choices)}"
                )


class EvolutionStrategy:
    """Estimates the gradient of the smoothed fitness and climbs it.

    Args:
        mean: where to start, (P,).
        rng: source of the perturbations, owned by this object from now on.
        settings: how it searches.

    Raises:
        EnvsError: more directions than the machine has memory for.
    """

    def __init__(
        self, mean: np.ndarray, rng: np.random.Generator, settings: StrategySettings
    ) -> None:
        needed = COPIES * settings.pairs * np.asarray(mean, np.float64).nbytes
        check_memory(needed, f"algorithm.pairs={settings.pairs} directions", "fewer pairs")
        self.pairs, self.sigma = settings.pairs, settings.sigma
        self.estimator: Estimator = settings.estimator
        self.shaping: Shaping = settings.shaping
        self.top_k, self.orthogonal = settings.top_k, settings.orthogonal
        self._rng = rng
        self._mean = torch.tensor(np.asarray(mean), dtype=torch.float64)  # (P,)
        make = torch.optim.Adam if settings.optimizer == "adam" else torch.optim.SGD
        self._optimizer = make(
            [self._mean],
            lr=settings.learning_rate,
            weight_decay=settings.weight_decay,
            maximize=True,
        )
        self._noise: np.ndarray | None = None

    @property
    def mean(self) -> np.ndarray:
        """The current parameters, (P,) float64, a copy."""
        return self._mean.numpy().copy()

    @property
    def size(self) -> int:
        """J, candidates that `ask` returns."""
        return 2 * self.pairs if self.estimator == "antithetic" else self.pairs + 1

    def ask(self) -> np.ndarray:
        """Draw candidates around the mean.

        Returns:
            (J, P) float64: all + signs, then all - signs in the same order; or all + signs, then
            the mean.
        """
        size = len(self._mean)
        if self.orthogonal:
            self._noise = orthogonal_directions(self._rng, self.pairs, size)  # (n, P)
        else:
            self._noise = self._rng.standard_normal((self.pairs, size))
        mean, step = self._mean.numpy(), self.sigma * self._noise
        other = mean - step if self.estimator == "antithetic" else mean[None]
        return np.concatenate([mean + step, other])

    def tell(self, fitness: np.ndarray) -> dict[str, float]:
        """Move the mean by the fitness of the last candidates.

        Args:
            fitness: (J,), higher is better.

        Returns:
            `gradient_norm`, the length of the estimated gradient.

        Raises:
            Sim2RealError: before `ask`, or for a wrong number of values or values that are not
                finite.
        """
        if self._noise is None:
            raise Sim2RealError("evolution strategy: tell() before ask()")
        fitness = np.asarray(fitness, np.float64)
        if fitness.shape != (self.size,) or not np.isfinite(fitness).all():
            raise Sim2RealError(
                f"evolution strategy: fitness must be {self.size} finite numbers, got shape "
                f"{fitness.shape} with {int((~np.isfinite(fitness)).sum())} not finite"
            )
        gradient = self._estimate(shape_fitness(fitness, self.shaping))
        self._noise = None
        return self.step(gradient)

    def step(self, gradient: np.ndarray) -> dict[str, float]:
        """Move the mean along a gradient that was estimated elsewhere, (P,)."""
        if np.any(gradient):
            self._mean.grad = torch.from_numpy(np.array(gradient, np.float64))
            self._optimizer.step()
        return {"gradient_norm": float(np.sqrt((gradient**2).sum()))}

    def _estimate(self, fitness: np.ndarray) -> np.ndarray:
        """Estimate the gradient from shaped fitness, (P,)."""
        assert self._noise is not None
        if self.estimator == "antithetic":
            slopes = (fitness[: self.pairs] - fitness[self.pairs :]) / 2  # (n,)
            merit = np.abs(slopes)
        else:
            slopes = fitness[: self.pairs] - fitness[self.pairs]
            merit = slopes
        noise = self._noise
        if self.top_k:
            kept = np.sort(np.argsort(-merit, kind="stable")[: self.top_k])
            slopes, noise = slopes[kept], noise[kept]
        # Summed row by row, not by BLAS: the same bits on any number of threads.
        return (slopes[:, None] * noise).sum(axis=0) / (len(slopes) * self.sigma)

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on: tensors, numbers and names."""
        return {
            "mean": self._mean.clone(),
            "optimizer": deepcopy(self._optimizer.state_dict()),
            "rng": self._rng.bit_generator.state,
            "noise": None if self._noise is None else torch.from_numpy(self._noise.copy()),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned."""
        self._mean.copy_(torch.as_tensor(state["mean"]))
        self._optimizer.load_state_dict(deepcopy(state["optimizer"]))
        self._rng.bit_generator.state = state["rng"]
        noise = state["noise"]
        self._noise = None if noise is None else noise.numpy().copy()
