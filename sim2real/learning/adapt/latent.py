"""Latent search: hill climbing over the few latent numbers that a policy is conditioned on.

    LatentSearch(dims=2, mode="sequential", queries=9, parallel=1, sigma=1.0).start(theta, rng)

The latent numbers are the last of the parameters (`LatentPolicy`); all the others stay. After Yu et
al. 2020, "Learning fast adaptation with meta strategy optimization", who search them so in training
too; here training is evolution strategies over all parameters.
"""

from typing import Any

import numpy as np

from sim2real.learning.adapt.hillclimb import HillClimb
from sim2real.runs.errors import Sim2RealError


class LatentSearch(HillClimb):
    """`HillClimb` that perturbs the last parameters alone.

    Args:
        dims: latent numbers of the policy.
        climb: all else, as `HillClimb` takes it.

    Raises:
        Sim2RealError: no latent number, or values out of range.
    """

    def __init__(self, *, dims: int, **climb: Any) -> None:
        if dims < 1:
            raise Sim2RealError(f"adapt.dims={dims} must be at least 1")
        super().__init__(**climb)
        self.dims = dims

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        return f"a search of {self.dims} latent numbers by {super().__str__()}"

    def check(self, policy: Any) -> None:
        """Raise Sim2RealError for a policy that has not as many latent numbers."""
        own = getattr(policy, "latent", 0)
        if own != self.dims:
            raise Sim2RealError(
                f"adapt.dims={self.dims}: the policy has {own or 'no'} latent numbers to search; "
                + (f"set adapt.dims={own}" if own else "choose policy=latent, or another adapt")
            )

    def draw(self, rng: np.random.Generator, size: int) -> np.ndarray:
        """Draw the perturbations, (queries, size) float32, 0 but in the last `dims`."""
        noise = np.zeros((self.queries, size), np.float32)
        noise[:, -self.dims :] = super().draw(rng, self.dims)
        return noise
