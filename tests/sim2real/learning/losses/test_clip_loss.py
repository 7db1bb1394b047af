"""The loss of PPO and its written-out gradient, against autograd, differences and TorchRL."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import ProbabilisticTensorDictModule, ProbabilisticTensorDictSequential
from tensordict.nn import TensorDictModule as Mod
from torch import nn
from torch.distributions import Independent, Normal
from torchrl.objectives import ClipPPOLoss

from sim2real.learning.algorithms.ppo import clip_norm
from sim2real.learning.losses.clip_loss import Batch, ClipLoss, PerceptronGradient, log_prob
from sim2real.learning.modules.actor_critic import ActorCritic
from sim2real.runs.errors import Sim2RealError

LOSS = ClipLoss(clip_epsilon=0.2, critic_coeff=0.5, entropy_coeff=0.01, normalize_advantage=True)


def network(hidden: tuple[int, ...] = (16, 8), activation: Any = "tanh") -> ActorCritic:
    """Return an actor and critic of 5 observations and 2 actions."""
    options: Any = {"hidden": hidden, "activation": activation, "log_std": -0.3}
    policy = ActorCritic(5, 2, -np.ones(2), np.ones(2), **options)
    policy.initialize(torch.Generator().manual_seed(0))
    with torch.no_grad():  # biases, and a head that is not all but zero
        policy.theta.add_(0.1 * torch.randn(policy.theta.shape, generator=generator(1)))
    return policy


def generator(seed: int) -> torch.Generator:
    """Return a seeded generator."""
    return torch.Generator().manual_seed(seed)


def samples(policy: ActorCritic, count: int) -> Batch:
    """Return samples whose ratios lie on both sides of both limits."""
    g = generator(2)
    observation, action = torch.randn(count, 5, generator=g), torch.randn(count, 2, generator=g)
    with torch.no_grad():
        mean, log_std, _ = policy(observation)
        old = log_prob(action, mean, log_std) + 0.4 * torch.randn(count, generator=g)
    advantage, target = torch.randn(2, count, generator=g)
    return Batch(observation, action, old, advantage, target)


def written_out(policy: ActorCritic, loss: ClipLoss, batch: Batch) -> torch.Tensor:
    """Return the gradient of `PerceptronGradient`."""
    PerceptronGradient(policy, loss)(batch)
    assert policy.theta.grad is not None
    return policy.theta.grad.clone()


@pytest.mark.parametrize("hidden", [(16,), (16, 8), (8, 8, 4)])
@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("normalize", [True, False])
def test_the_written_out_gradient_is_autograds(
    hidden: tuple[int, ...], activation: str, normalize: bool
) -> None:
    """For one to three layers, both nonlinearities, with and without normalized advantages."""
    policy, loss = network(hidden, activation), ClipLoss(0.2, 0.7, 0.02, normalize)
    batch = samples(policy, 64)
    mine = written_out(policy, loss, batch)
    policy.theta.grad = None
    loss(policy, batch).backward()
    torch.testing.assert_close(mine, policy.theta.grad, atol=1e-6, rtol=1e-5)


def test_the_gradient_is_the_losses_slope() -> None:
    """Central differences in double precision, in random directions."""
    policy = network().double()
    batch = Batch(*(x.double() for x in samples(network(), 32)))
    gradient = written_out(policy, LOSS, batch)
    start = policy.theta.detach().clone()
    for seed in range(5):
        direction = torch.randn(start.shape, generator=generator(seed), dtype=torch.float64)
        ends = []
        for sign in (1e-6, -1e-6):
            with torch.no_grad():
                policy.theta.copy_(start + sign * direction)
                ends.append(float(LOSS(policy, batch)))
        slope = (ends[0] - ends[1]) / 2e-6
        assert slope == pytest.approx(float(gradient @ direction), rel=1e-6)


class Head(nn.Module):
    """One output of an actor and critic, as TorchRL's modules want it."""

    def __init__(self, policy: ActorCritic, critic: bool) -> None:
        super().__init__()
        self.policy, self.critic = policy, critic

    def forward(self, observation: torch.Tensor) -> Any:
        """Return the value (B, 1), or mean and deviation (B, A)."""
        mean, log_std, value = self.policy(observation)
        return value.unsqueeze(-1) if self.critic else (mean, log_std.exp().expand_as(mean))


def diagonal(loc: torch.Tensor, scale: torch.Tensor) -> Independent:
    """Return a diagonal Gaussian."""
    return Independent(Normal(loc, scale), 1)


def clip_ppo_loss(policy: ActorCritic, batch: Batch) -> torch.Tensor:
    """Return TorchRL's loss of the same networks, samples and coefficients."""
    chain: Any = ProbabilisticTensorDictSequential
    actor = chain(
        Mod(Head(policy, critic=False), in_keys=["observation"], out_keys=["loc", "scale"]),
        ProbabilisticTensorDictModule(
            in_keys=["loc", "scale"],
            out_keys=["action"],
            distribution_class=diagonal,  # type: ignore[arg-type]
            return_log_prob=True,
        ),
    )
    critic = Mod(Head(policy, critic=True), in_keys=["observation"], out_keys=["state_value"])
    loss = ClipPPOLoss(
        actor,
        critic,
        clip_epsilon=LOSS.clip_epsilon,
        entropy_coeff=LOSS.entropy_coeff,
        critic_coeff=LOSS.critic_coeff,
        loss_critic_type="l2",
        normalize_advantage=True,
        functional=False,
    )
    loss.set_keys(advantage="advantage", value_target="target", sample_log_prob="log_prob")
    data = {
        "observation": batch.observation,
        "action": batch.action,
        "log_prob": batch.log_prob,
        "advantage": batch.advantage.unsqueeze(-1),
        "target": batch.target.unsqueeze(-1),
    }
    parts = loss(TensorDict(data, [len(batch.target)]))
    return sum(value for name, value in parts.items() if name.startswith("loss_"))  # type: ignore[return-value]


def test_an_update_is_that_of_clip_ppo_loss() -> None:
    """From equal weights and samples, loss, gradient and parameters after a step agree to 1e-6."""
    ours, theirs = network(), network()
    batch = samples(ours, 64)
    loss = clip_ppo_loss(theirs, batch)
    assert LOSS(ours, batch).item() == pytest.approx(loss.item(), abs=1e-6)
    steps = [torch.optim.Adam([p.theta], lr=3e-4, eps=1e-5) for p in (ours, theirs)]
    loss.backward()
    torch.nn.utils.clip_grad_norm_([theirs.theta], 0.5)
    written_out(ours, LOSS, batch)
    clip_norm(ours.theta.grad, 0.5)
    torch.testing.assert_close(ours.theta.grad, theirs.theta.grad, atol=1e-6, rtol=0)
    for step in steps:
        step.step()
    torch.testing.assert_close(ours.theta, theirs.theta, atol=1e-6, rtol=0)


def test_a_limit_of_zero_is_refused() -> None:
    """A clip_epsilon of 0 would never move the policy."""
    with pytest.raises(Sim2RealError, match=r"clip_epsilon=0.* above 0"):
        ClipLoss(0.0, 0.5, 0.0, True)
