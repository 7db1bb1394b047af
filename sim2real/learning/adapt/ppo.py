"""Adaptation by PPO: a few rounds of clipped updates of actor and critic (Schulman et al. 2017).

    operator = PPOAdaptation(rounds=6, steps=512, epochs=4, minibatch_size=64, ...)
    policy = trained.actor(theta), trained.critic
    session = operator.bind_policy(*policy).start(theta, rng)
    while (candidate := session.ask()) is not None:
        session.tell(value, steps)                  # of an episode whose actions were drawn
    adapted = session.result                        # the actor's parameters

On a robot a round is an episode, and the policy learns after each. In a population, where
evolution strategies train the parameters that this leads far from, a round is a number of steps,
and all members learn side by side (`adapt.clipped`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import torch

from sim2real.learning.adapt.base import Adaptation, BatchedSession, EpisodeTrajectory
from sim2real.learning.adapt.batched_ppo import (
    BatchedPPO,
    BlockedPPO,
    ClippedSettings,
    RolloutBatch,
)
from sim2real.learning.adapt.steps import StepsSession
from sim2real.learning.modules.functional_actor import FunctionalActor
from sim2real.learning.modules.value import Critic, FunctionalCritic
from sim2real.runs.errors import Sim2RealError


@dataclass(frozen=True, kw_only=True)
class PPOAdaptation(ClippedSettings, Adaptation):
    """R rounds of PPO with a separate Adam, which restarts in each adaptation.

    Raises:
        Sim2RealError: for values out of range.
    """

    explores: ClassVar[bool] = True
    needs_critic: ClassVar[bool] = True
    rounds: int  # R; on a robot as many episodes
    steps: int  # S, control steps of a round in a population, where episodes that end begin again
    law: FunctionalActor | None = None  # of the policy that adapts; see `bind_policy`
    value: FunctionalCritic | None = None  # of its critic
    critic: torch.Tensor | None = None  # the critic's parameters, (C,)
    unit: float = 1.0  # what rewards are divided by before they are valued

    def __post_init__(self) -> None:
        ClippedSettings.__post_init__(self)
        for name in ("rounds", "steps"):
            if getattr(self, name) < 1:
                raise Sim2RealError(f"adapt.{name}={getattr(self, name)} must be at least 1")

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        return f"PPO, {self.rounds} rounds (on a robot an episode each) with drawn actions"

    @property
    def stages(self) -> tuple[int, ...]:
        """A round each."""
        return (1,) * self.rounds

    @property
    def queries(self) -> int:
        """None: the actions vary, not the parameters."""
        return 0

    def check(self, policy: Any) -> None:
        """Raise Sim2RealError for a policy without a separate critic."""
        if policy is not None:
            FunctionalCritic(getattr(policy, "critic", None))

    def bind_policy(self, actor: Any, critic: Critic | None = None) -> PPOAdaptation:
        """Return this operator for a policy.

        Raises:
            Sim2RealError: an actor without a normal distribution, or no critic with separate
            networks.
        """
        value = FunctionalCritic(None if critic is None else critic.module)
        unit = 1.0 if critic is None else critic.unit
        return replace(
            self, law=FunctionalActor(actor), value=value, critic=value.vector(), unit=unit
        )

    def known(self) -> tuple[FunctionalActor, FunctionalCritic, torch.Tensor]:
        """Return law, value and the critic's parameters.

        Raises Sim2RealError before `bind_policy`.
        """
        if self.law is None or self.value is None or self.critic is None:
            raise Sim2RealError(
                "adapt=ppo: set the policy that adapts with bind_policy(actor, critic)"
            )
        return self.law, self.value, self.critic

    def start(self, theta: np.ndarray, rng: np.random.Generator) -> PPOSession:
        """Start one adaptation of an actor's parameters (P,); see `Adaptation`."""
        return PPOSession(self, theta, int(rng.integers(2**31)))

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> LearnerCohort:
        """Start members whose parameters (n, P + C) are the actor's and the critic's."""
        return LearnerCohort(self, thetas, noise)

    def orders(self, rng: np.random.Generator, steps: int) -> np.ndarray:
        """Draw in which order each pass takes a round's steps, (epochs, steps) int64."""
        return np.stack([rng.permutation(steps) for _ in range(self.epochs)])


class PPOSession(StepsSession):
    """One robot's adaptation by PPO, which learns after each episode; see `Session`.

    Args:
        operator: the recipe, of a policy (`PPOAdaptation.bind_policy`).
        theta: the actor's parameters before adaptation, (P,).
        seed: of the order in which steps are taken.
    """

    def __init__(self, operator: PPOAdaptation, theta: np.ndarray, seed: int) -> None:
        self._recipe, self._seed = operator, seed
        super().__init__(operator, theta)

    def _restart(self, theta: np.ndarray) -> None:
        super()._restart(theta)
        law, value, critic = self._recipe.known()
        both = torch.cat([torch.from_numpy(self._theta), critic])
        self._learner = BatchedPPO(self._recipe, law, value, both[None])

    def _digest(self) -> None:
        steps, rng = self._steps[-1], np.random.default_rng([self._seed, len(self._steps)])
        orders = torch.from_numpy(self._recipe.orders(rng, len(steps.reward)))
        self._learner.learn(_round(steps, self._recipe.unit), orders[None])
        self._result = self._learner.thetas[0, : len(self._theta)].numpy().copy()

    def state_dict(self) -> dict[str, Any]:
        """Return the start, the episodes so far and the seed, as tensors."""
        return {**super().state_dict(), "seed": torch.tensor(self._seed)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to where `state_dict` was taken, by learning from the same episodes again."""
        self._seed = int(state["seed"])
        super().load_state_dict(state)


def _round(steps: EpisodeTrajectory, unit: float) -> RolloutBatch:
    """Return a whole episode as the round of one member."""
    seen = np.asarray(steps.observation, np.float32)  # (T, O)
    last = seen[-1] if steps.end is None else steps.end
    done = np.zeros(len(seen), bool)
    done[-1] = True
    reward = np.asarray(steps.reward / unit, np.float32)
    after = np.concatenate([seen[1:], np.asarray(last, np.float32)[None]])
    ended = done & (steps.end is None)
    columns = (seen, np.asarray(steps.action, np.float32), reward, after, done, ended)
    return RolloutBatch(*(torch.from_numpy(x)[None] for x in columns))


class LearnerCohort(BatchedSession):
    """Members that learn from steps; a population runs them by `population.learners`.

    Args:
        operator: the recipe, of a policy.
        thetas: parameters of actor and critic, (n, P + C).
        noise: none.
    """

    def __init__(self, operator: PPOAdaptation, thetas: np.ndarray, noise: np.ndarray) -> None:
        super().__init__(operator.stages, thetas, noise)
        law, value, _ = operator.known()
        self.operator, self._networks = operator, (law, value)
        size = sum(p.numel() for one in self._networks for p in one.parameters)
        if self.results.shape[1] != size:
            raise Sim2RealError(
                f"adapt=ppo: members have {self.results.shape[1]} parameters, actor and critic "
                f"together {size}; to search the critic as well, set algorithm.critic=true"
            )

    def learners(self, members: np.ndarray) -> BlockedPPO:
        """Return the blocked PPO of some members, (k,)."""
        return BlockedPPO(self.operator, *self._networks, self.results[members])

    def candidates(self, members: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Return the parameters as they are; see the base class."""
        return self.results[members]

    def _advance(self, members: np.ndarray, stage: int) -> None:
        raise Sim2RealError("adapt=ppo: members learn from steps, but received only returns")
