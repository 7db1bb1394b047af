"""PPO's updates of a population's members: all side by side, and one after the other by TorchRL.

Both learn from rounds of the experiment `es_ppo_lite`, 512 steps in minibatches of 64 for four
passes, with its networks; the steps are random numbers, which cost what those of a Hopper cost. An
update is a gradient step of a member.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import nn
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from benchmarks.rows.base import Row
from sim2real.config.compose import compose, instantiate
from sim2real.learning.adapt import PPOAdaptation
from sim2real.learning.adapt.batched_ppo import BlockedPPO, RolloutBatch
from sim2real.learning.modules.actor_critic import Policy
from sim2real.learning.modules.value import Critic

EXPERIMENT = "es_ppo_lite"


def parts() -> tuple[PPOAdaptation, Any]:
    """Return the experiment's adaptation and a new policy of it."""
    torch.manual_seed(0)
    _, given = instantiate(compose([f"+experiment={EXPERIMENT}", "logger=csv"]), Path())
    made = given["parts"]
    policy = made.policy(made.environment.make(1, threads=1))
    assert isinstance(made.adapt, PPOAdaptation) and isinstance(policy, Policy)
    return made.adapt, policy


def steps_of(members: int, steps: int) -> RolloutBatch:
    """Return a round of random steps of a Hopper's sizes; one in fifty ends an episode."""
    rng, shape = torch.Generator().manual_seed(0), (members, steps)
    seen, after = (torch.randn(*shape, 11, generator=rng) for _ in range(2))
    action, reward = torch.randn(*shape, 3, generator=rng), torch.rand(*shape, generator=rng)
    done = torch.rand(*shape, generator=rng) < 0.02
    return RolloutBatch(seen, action, reward, after, done, done)


class Members(Row):
    """All members at once, as evolution strategies train them."""

    name, of, unit = "ppo_members", "ppo_members_torchrl", "updates"

    def __init__(self, members: int) -> None:
        self._members = members
        self.setup = f"{members} members side by side, 1 thread"

    def build(self) -> None:
        """Make the members and let them learn once."""
        adapt, policy = parts()
        whole = [*policy.actor.parameters(), *policy.critic.parameters()]
        theta = nn.utils.parameters_to_vector(whole).detach().numpy()
        law, value, _ = adapt.bind_policy(policy.actor, Critic(policy.critic)).known()
        self._learners = BlockedPPO(adapt, law, value, np.tile(theta, (self._members, 1)))
        rng = np.random.default_rng(0)
        orders = [adapt.orders(rng, adapt.steps) for _ in range(self._members)]
        self._orders = torch.from_numpy(np.stack(orders))
        self._round = steps_of(self._members, adapt.steps)
        self._updates = adapt.epochs * -(-adapt.steps // adapt.minibatch_size)
        self.work()

    def work(self) -> tuple[float, int]:
        """Learn a round."""
        self._learners.learn(self._round, self._orders)
        return self._members * self._updates, 0


class MembersTorchRL(Row):
    """One member after the other: `GAE`, `ClipPPOLoss` and `torch.optim.Adam`, fused."""

    name, of, unit = "ppo_members_torchrl", None, "updates"

    def __init__(self, members: int) -> None:
        self._members = members
        self.setup = f"{members} members in a loop, TorchRL's GAE and ClipPPOLoss, 1 thread"

    def build(self) -> None:
        """Make a member's parts and let it learn once."""
        self._adapt, policy = parts()
        self._judge = GAE(
            gamma=self._adapt.gamma,
            lmbda=self._adapt.lmbda,
            value_network=policy.critic,
            deactivate_vmap=True,
        )
        self._loss = ClipPPOLoss(
            policy.actor,
            policy.critic,
            clip_epsilon=self._adapt.clip_epsilon,
            critic_coeff=self._adapt.critic_coeff,
            entropy_bonus=False,
            loss_critic_type="l2",
            normalize_advantage=True,
        )
        self._policy = policy
        self._optimizer = torch.optim.Adam(
            policy.parameters(), lr=self._adapt.learning_rate, eps=self._adapt.eps, fused=True
        )
        one = RolloutBatch(*(x[0] for x in steps_of(1, self._adapt.steps)))
        flags = {"done": one.done[:, None], "terminated": one.terminated[:, None]}
        after = {"observation": one.after, "reward": one.reward[:, None], **flags}
        self._data = TensorDict(
            {"observation": one.observation, "action": one.action, "next": after},
            [self._adapt.steps],
        )
        self._rng = np.random.default_rng(0)
        self._learn()

    def work(self) -> tuple[float, int]:
        """Let every member learn a round."""
        return sum(self._learn() for _ in range(self._members)), 0

    def _learn(self) -> int:
        """Learn a round; return the updates."""
        data, updates, everything = self._data.clone(), 0, list(self._policy.parameters())
        with torch.no_grad():
            law = self._policy.actor.get_dist(data)
            data["action_log_prob"] = law.log_prob(data["action"])
            self._judge(data)
        for order in torch.from_numpy(self._adapt.orders(self._rng, self._adapt.steps)):
            for chosen in order.split(self._adapt.minibatch_size):
                found = self._loss(data[chosen])
                (found["loss_objective"] + found["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(everything, self._adapt.max_grad_norm)
                self._optimizer.step()
                self._optimizer.zero_grad()
                updates += 1
        return updates
