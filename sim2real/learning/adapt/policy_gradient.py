"""Adaptation by one policy gradient from whole episodes, as MAML adapts (Finn et al. 2017).

    operator = PolicyGradient(trajectories=20, rate=0.1, surrogate="likelihood", advantage=judge)
    session = operator.bind_policy(trained.actor(theta)).start(theta, rng)
    while (candidate := session.ask()) is not None:
        session.tell(value, steps)                  # of an episode whose actions were drawn
    adapted = session.result                        # theta + rate * gradient of the return

The gradient needs every step of an episode, and actions that vary, where the other operators need
returns alone. PG-MAML trains through the same step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import torch
from torch.func import grad

from sim2real.learning.adapt.base import Adaptation, BatchedSession
from sim2real.learning.adapt.linear_gae import LinearGAE
from sim2real.learning.adapt.steps import COLUMNS, StepsSession
from sim2real.learning.modules.functional_actor import FunctionalActor, log_prob
from sim2real.learning.modules.value import Critic
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
SURROGATES = ("likelihood", "ratio")


class TransitionBatch(NamedTuple):
    """Steps that were taken in a task, S of them; with a dimension before, in B tasks."""

    seen: tuple[Tensor, ...]  # what the policy saw, (S, O) each
    action: Tensor  # (S, A), as drawn
    log_prob: Tensor  # (S,), when they were drawn
    advantage: Tensor  # (S,)
    weight: Tensor  # (S,), of each step in means over the task: it sums to 1


@dataclass(frozen=True, kw_only=True)
class PolicyGradient(Adaptation):
    """theta - rate * gradient of the loss of K episodes.

    Raises:
        Sim2RealError: for values out of range.
    """

    explores: ClassVar[bool] = True
    trajectories: int  # K, episodes of an adaptation
    rate: float  # step size
    # what is differentiated, with one and the same gradient where the episodes were drawn:
    # "likelihood", log pi A (REINFORCE, Williams 1992), or "ratio", pi / pi_old A, whose second
    # derivatives vary less between samples (Rothfuss et al. 2019, "ProMP").
    surrogate: Literal["likelihood", "ratio"]
    advantage: LinearGAE  # what actions are judged by
    law: FunctionalActor | None = None  # of the policy that adapts; see `bind_policy`

    def __post_init__(self) -> None:
        if self.trajectories < 1 or not self.rate > 0:
            raise Sim2RealError(
                f"adapt: trajectories={self.trajectories} must be at least 1, rate={self.rate} "
                "above 0"
            )
        if self.surrogate not in SURROGATES:
            raise Sim2RealError(
                f"adapt.surrogate={self.surrogate!r} is not one of {', '.join(SURROGATES)}"
            )

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        return f"a policy gradient, {self.episodes} episodes with drawn actions"

    @property
    def stages(self) -> tuple[int, ...]:
        """All episodes are of the unchanged policy."""
        return (self.trajectories,)

    @property
    def queries(self) -> int:
        """None: the actions vary, not the parameters."""
        return 0

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> BatchedSession:
        """Raise Sim2RealError: populations tell returns, and this needs the steps."""
        raise Sim2RealError(
            "adapt=policy_gradient learns from the steps of episodes, but a population reports "
            "only returns; use adapt=gradient or adapt=hillclimb, or algorithm=pg_maml"
        )

    def bind_policy(self, actor: Any, critic: Critic | None = None) -> PolicyGradient:
        """Return this operator for a policy; Sim2RealError unless its actions are Gaussian."""
        return replace(self, law=FunctionalActor(actor))

    def start(self, theta: np.ndarray, rng: np.random.Generator) -> PolicyGradientSession:
        """Start one adaptation.

        Raises Sim2RealError before `bind_policy` has said of which policy.
        """
        if self.law is None:
            raise Sim2RealError(
                "adapt=policy_gradient: set the policy that adapts with bind_policy(actor)"
            )
        return PolicyGradientSession(self, self.law, theta)

    def loss(self, law: FunctionalActor, theta: Tensor, one: TransitionBatch) -> Tensor:
        """Return the loss of parameters (P,) on a task's experience, which a step lowers."""
        score = log_prob(law(theta, *one.seen), one.action)
        if self.surrogate == "ratio":
            score = (score - one.log_prob).exp()
        return -(one.weight * score * one.advantage).sum()

    def step(self, law: FunctionalActor, theta: Tensor, one: TransitionBatch) -> Tensor:
        """Return the adapted parameters, (P,), a function that can be differentiated."""
        return theta - self.rate * grad(lambda x: self.loss(law, x, one))(theta)

    def experience(
        self,
        seen: Sequence[Tensor],
        action: Tensor,
        log_probs: Tensor,
        reward: Tensor,
        alive: Tensor,
    ) -> TransitionBatch:
        """Put episodes (..., M, T, ...) together, the leading dimensions being tasks.

        Args:
            seen: what the policy saw, (..., M, T, O) each.
            action: as drawn, (..., M, T, A).
            log_probs: when they were drawn, (..., M, T).
            reward: (..., M, T).
            alive: whether the episode was going on before the step, (..., M, T) bool.
        """
        advantage = self.advantage(torch.cat(tuple(seen), -1), reward, alive)
        weight = alive.to(action.dtype)
        weight = weight / weight.sum((-2, -1), keepdim=True)
        return TransitionBatch(
            tuple(x.flatten(-3, -2) for x in seen),
            action.flatten(-3, -2),
            *(x.flatten(-2) for x in (log_probs, advantage, weight)),
        )


class PolicyGradientSession(StepsSession):
    """One robot's adaptation by a policy gradient, whose result is as before until it is done.

    Args:
        operator: the recipe.
        law: of the policy that adapts.
        theta: parameters before adaptation, (P,).
    """

    def __init__(self, operator: PolicyGradient, law: FunctionalActor, theta: np.ndarray) -> None:
        self._recipe, self._law = operator, law
        super().__init__(operator, theta)

    def _digest(self) -> None:
        if self.episodes_left == 0:
            self._adapt()

    def _adapt(self) -> None:
        longest = max(len(one.reward) for one in self._steps)

        def padded(name: str) -> Tensor:
            parts = [getattr(one, name) for one in self._steps]
            filled = [np.pad(x, [(0, longest - len(x))] + [(0, 0)] * (x.ndim - 1)) for x in parts]
            return torch.from_numpy(np.stack(filled).astype(np.float32))

        seen, action, reward = (padded(name) for name in COLUMNS)  # (K, T, ...)
        lengths = torch.tensor([len(one.reward) for one in self._steps])
        alive = torch.arange(longest) < lengths[:, None]
        theta = torch.from_numpy(self._theta)
        with torch.no_grad():
            drawn = log_prob(self._law(theta, seen), action)
        one = self._recipe.experience([seen], action, drawn, reward, alive)
        self._result = self._recipe.step(self._law, theta, one).detach().numpy()
