"""PPO's updates of many members at once, each with its own parameters, steps and Adam.

    learners = BlockedPPO(ClippedSettings(epochs=4, ...), law, value, thetas)     # (n, P)
    action = learners.act(observation, noise)           # (n, A), drawn
    learners.learn(steps, orders)                       # a round of S steps each
    learners.thetas                                     # (n, P)

A member's vector holds the actor's parameters, the logarithm of its deviation among them, and
behind them the critic's. One member's update is that of `torchrl.objectives.ClipPPOLoss` with
`torchrl.objectives.value.GAE` and `torch.optim.Adam` (Schulman et al. 2017, equation 7; 2016,
equation 16), which a test holds it against; `torch.func.vmap` makes it that of all members.
"""

from copy import deepcopy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch.func import grad, vmap
from torchrl.objectives.value.functional import generalized_advantage_estimate

from sim2real.learning.modules.functional_actor import FunctionalActor, Normal, log_prob
from sim2real.learning.modules.value import FunctionalCritic
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
BLOCK = 32  # members that are called at once, always as many: see `population.actors.BLOCK`
TINY = torch.finfo(torch.float32).resolution  # least deviation that advantages are divided by


class RolloutBatch(NamedTuple):
    """S steps of each of n members, one after the other; episodes that end begin again."""

    observation: Tensor  # (n, S, O) float32, as the policy saw it
    action: Tensor  # (n, S, A) float32, as drawn
    reward: Tensor  # (n, S) float32, in the critic's unit
    after: Tensor  # (n, S, O) float32, what the step led to, also where the episode ended there
    done: Tensor  # (n, S) bool: the episode ended
    terminated: Tensor  # (n, S) bool: the task ended it, so that nothing follows


class Samples(NamedTuple):
    """B steps of a member as its loss needs them."""

    observation: Tensor  # (B, O)
    action: Tensor  # (B, A)
    log_prob: Tensor  # (B,), when they were drawn
    advantage: Tensor  # (B,)
    target: Tensor  # (B,), of the value


@dataclass(frozen=True, kw_only=True)
class ClippedSettings:
    """The settings of a member's update in a round.

    Raises:
        Sim2RealError: for values out of range.
    """

    epochs: int  # passes over the steps
    minibatch_size: int  # steps of a gradient step; the last of a pass has what is left
    learning_rate: float  # of Adam
    eps: float  # what Adam adds to the root of the second moment
    clip_epsilon: float  # how far the ratio of probabilities may leave 1
    critic_coeff: float  # weight of the critic's squared error
    gamma: float  # discount of a step
    lmbda: float  # 0 trusts the critic, 1 the returns
    max_grad_norm: float  # norm that a member's gradient is cut to

    def __post_init__(self) -> None:
        for name in ("epochs", "minibatch_size"):
            if getattr(self, name) < 1:
                raise Sim2RealError(f"adapt.{name}={getattr(self, name)} must be at least 1")
        for name in ("learning_rate", "eps", "clip_epsilon", "critic_coeff", "max_grad_norm"):
            if not getattr(self, name) > 0:
                raise Sim2RealError(f"adapt.{name}={getattr(self, name)} must be above 0")
        for name in ("gamma", "lmbda"):
            if not 0 <= getattr(self, name) <= 1:
                raise Sim2RealError(f"adapt.{name}={getattr(self, name)} must be between 0 and 1")


class BatchedPPO:
    """Some members side by side; what they come to depends on how many there are in the last bit.

    Args:
        settings: how they learn.
        law: of the actor; this object's own, since calls swap the parameters of its modules.
        value: of the critic; this object's own.
        thetas: parameters of actor and critic, (n, P).
    """

    def __init__(
        self,
        settings: ClippedSettings,
        law: FunctionalActor,
        value: FunctionalCritic,
        thetas: Tensor,
    ) -> None:
        self._settings, self._law, self._value = settings, law, value
        self.thetas = thetas.clone()  # (n, P)
        self._sizes = [sum(p.numel() for p in one.parameters) for one in (law, value)]
        self._optimizer = torch.optim.Adam(
            [self.thetas], lr=settings.learning_rate, eps=settings.eps, fused=True
        )

    @torch.no_grad()
    def law(self, observation: Tensor) -> Normal:
        """Return means and log-deviations, (n, ..., A) each, of observations (n, ..., O)."""
        return vmap(self._law)(self.thetas[:, : self._sizes[0]], observation)

    def learn(self, steps: RolloutBatch, orders: Tensor) -> None:
        """Improve every member by a round.

        Args:
            steps: (n, S) of them.
            orders: in which order each pass takes them, (n, epochs, S) int64.
        """
        samples, member = self._samples(steps), torch.arange(len(self.thetas))[:, None]
        slope = vmap(grad(self._loss))
        for number in range(self._settings.epochs):
            for chosen in orders[:, number].split(self._settings.minibatch_size, -1):  # (n, B)
                batch = Samples(*(x[member, chosen] for x in samples))
                self._descend(slope(self.thetas, batch))

    @torch.no_grad()
    def _samples(self, steps: RolloutBatch) -> Samples:
        """Return the round with advantages and targets, by the parameters that acted."""
        policies, critics = self.thetas.split(self._sizes, -1)
        drawn = log_prob(vmap(self._law)(policies, steps.observation), steps.action)
        now, later = (vmap(self._value)(critics, x) for x in (steps.observation, steps.after))
        series = (now, later, steps.reward, steps.done, steps.terminated)
        advantage, target = generalized_advantage_estimate(
            self._settings.gamma, self._settings.lmbda, *(x[..., None] for x in series)
        )
        return Samples(steps.observation, steps.action, drawn, advantage[..., 0], target[..., 0])

    def _loss(self, theta: Tensor, batch: Samples) -> Tensor:
        """Return a member's loss for its parameters (P,)."""
        actor, critic = theta.split(self._sizes)
        advantage, reach = batch.advantage, self._settings.clip_epsilon
        if len(advantage) > 1:
            off = advantage - advantage.mean()
            advantage = off / advantage.std().clamp_min(TINY)
        law = self._law(actor, batch.observation)
        ratio = (log_prob(law, batch.action) - batch.log_prob).exp()
        gain = torch.minimum(ratio * advantage, ratio.clamp(1 - reach, 1 + reach) * advantage)
        error = self._value(critic, batch.observation) - batch.target
        return self._settings.critic_coeff * error.square().mean() - gain.mean()

    @torch.no_grad()
    def _descend(self, slopes: Tensor) -> None:
        """Take a step of Adam along gradients (n, P); elementwise, it is one for each member."""
        norms = torch.linalg.vector_norm(slopes, dim=-1, keepdim=True)
        slopes.mul_((self._settings.max_grad_norm / (norms + 1e-6)).clamp(max=1.0))
        self.thetas.grad = slopes
        self._optimizer.step()


class BlockedPPO:
    """Any number of members in blocks of one size; a member's numbers depend on no other's.

    Args:
        settings: how they learn.
        law: of the actor.
        value: of the critic.
        thetas: parameters of actor and critic, (n, P) float32.
    """

    def __init__(
        self,
        settings: ClippedSettings,
        law: FunctionalActor,
        value: FunctionalCritic,
        thetas: np.ndarray,
    ) -> None:
        self._count = len(thetas)
        self._fill = np.minimum(np.arange(-(-self._count // BLOCK) * BLOCK), self._count - 1)
        own = deepcopy((law, value))  # other threads call theirs
        self._blocks = [
            BatchedPPO(settings, *own, block) for block in self._split(torch.from_numpy(thetas))
        ]

    def _split(self, x: Tensor) -> tuple[Tensor, ...]:
        """Return blocks of what members have, (n, ...), the last filled up with its last member."""
        return x[torch.from_numpy(self._fill)].split(BLOCK)

    @property
    def thetas(self) -> np.ndarray:
        """The parameters of now, (n, P) float32."""
        return torch.cat([block.thetas for block in self._blocks])[: self._count].numpy()

    def act(self, observation: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Draw actions (n, A) float32 from observations (n, O) and normal numbers (n, A)."""
        seen = self._split(torch.from_numpy(observation.astype(np.float32)))
        laws = [block.law(x) for block, x in zip(self._blocks, seen, strict=True)]
        loc, log_scale = (torch.cat(one)[: self._count].numpy() for one in zip(*laws, strict=True))
        return loc + np.exp(log_scale) * noise

    def learn(self, steps: RolloutBatch, orders: Tensor) -> None:
        """Improve every member by a round; see `BatchedPPO.learn`."""
        parts = zip(*(self._split(x) for x in steps), strict=True)
        for block, part, order in zip(self._blocks, parts, self._split(orders), strict=True):
            block.learn(RolloutBatch(*part), order)
