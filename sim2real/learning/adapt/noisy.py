"""Adapts by returns that are measured badly: how much noise an operator bears.

    operator = NoisyReturns(HillClimb(mode="batch", queries=7, parallel=7), law="one_sided",
                            scale=0.5)

The operator receives each return with an error; what scores the adapted policy is exact. The laws
are those of ES-MAML's noise study (Song et al., "Rapidly Adaptable Legged Robots via Evolutionary
Meta-Learning", IROS 2020).
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np

from envs.errors import did_you_mean
from sim2real.learning.adapt.base import Adaptation, BatchedSession
from sim2real.learning.modules.value import Critic
from sim2real.runs.errors import Sim2RealError

Law = Literal["gaussian", "one_sided"]
WORDS = 8  # numbers of the last perturbation whose bits seed a member's errors


class NoisyReturns(Adaptation):
    """Tells another operator returns with errors.

    Args:
        operator: that adapts by returns.
        law: "gaussian" adds `scale` times a standard normal number to each return; "one_sided"
            takes `scale` times the size of one away, in a share of the episodes: an error that
            only ever hurts, such as a stumble over a cable.
        scale: size of the errors, in units of the return.
        share: probability that "one_sided" strikes an episode; of no effect for "gaussian".

    Raises:
        Sim2RealError: an unknown law, a negative scale, a share outside [0, 1], or an operator
            that needs more of its episodes than their returns.
    """

    def __init__(
        self, operator: Adaptation, law: Law = "one_sided", scale: float = 0.5, share: float = 0.2
    ) -> None:
        if law not in get_args(Law):
            raise Sim2RealError(
                f"adapt.law={law!r} is unknown{did_you_mean(law, get_args(Law))}; choose one of: "
                f"{', '.join(get_args(Law))}"
            )
        if not scale >= 0 or not 0 <= share <= 1:
            raise Sim2RealError(
                f"adapt.scale={scale} must be at least 0, adapt.share={share} in [0, 1]"
            )
        if operator.explores or operator.needs_log:
            raise Sim2RealError(
                f"adapt=noisy makes returns noisy, but {operator} does not adapt by returns alone; "
                "choose adapt@adapt.operator=hillclimb, batch, average or gradient"
            )
        self.operator, self.scale, self.share = operator, scale, share
        self.law: Law = law

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        return f"{self.operator}; {self.law} errors of {self.scale:g} in the returns"

    @property
    def stages(self) -> tuple[int, ...]:
        """Those of the operator."""
        return self.operator.stages

    @property
    def queries(self) -> int:
        """Perturbations of the operator, and one whose bits seed the errors."""
        return self.operator.queries + 1

    def check(self, policy: Any) -> None:
        """Raise Sim2RealError for a policy that the operator cannot adapt."""
        self.operator.check(policy)

    def bind_policy(self, actor: Any, critic: Critic | None = None) -> NoisyReturns:
        """Return this recipe for a policy's actor."""
        return NoisyReturns(
            self.operator.bind_policy(actor, critic), self.law, self.scale, self.share
        )

    def bind_environment(self, environment: Any) -> NoisyReturns:
        """Return this recipe for policies of an environment."""
        return NoisyReturns(
            self.operator.bind_environment(environment), self.law, self.scale, self.share
        )

    def draw(self, rng: np.random.Generator, size: int) -> np.ndarray:
        """Draw the operator's perturbations and one more, (queries, size) float32."""
        own = self.operator.draw(rng, size)
        return np.concatenate([own, rng.standard_normal((1, size), dtype=np.float32)])

    def errors(self, seed: np.ndarray) -> np.ndarray:
        """Return the errors (E,) of a member's episodes, which its last perturbation (P,) seeds."""
        rng = np.random.default_rng(np.frombuffer(seed[:WORDS].tobytes(), np.uint32))
        drawn = self.scale * rng.standard_normal(self.episodes)
        if self.law == "gaussian":
            return drawn
        return -np.abs(drawn) * (rng.random(self.episodes) < self.share)

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> NoisyCohort:
        """Start members with given perturbations; see the base class."""
        return NoisyCohort(self, thetas, np.asarray(noise, np.float32))


class NoisyCohort(BatchedSession):
    """Members of another cohort, which receive wrong values; `values` are the true ones."""

    def __init__(self, operator: NoisyReturns, thetas: np.ndarray, noise: np.ndarray) -> None:
        super().__init__(operator.stages, thetas, noise)
        self._errors = np.array([operator.errors(one) for one in noise[:, -1]])  # (n, E)
        self._inner = operator.operator.start_batch(thetas, noise[:, :-1])
        self.results = self._inner.results  # the same array: both change together

    def candidates(self, members: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Return the parameters to try; see the base class."""
        return self._inner.candidates(members, episodes)

    def _advance(self, members: np.ndarray, stage: int) -> None:
        episodes = np.arange(self._ends[stage], self._ends[stage + 1])
        who, which = np.repeat(members, len(episodes)), np.tile(episodes, len(members))
        self._inner.tell(who, which, self.values[who, which] + self._errors[who, which])
        self.results = self._inner.results
