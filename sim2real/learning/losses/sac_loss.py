"""The losses of SAC and their gradients, written out (Haarnoja et al. 2018, arXiv:1812.05905).

    gradient = SACGradient(policy, SACLossSettings(gamma=0.99, target_entropy=-3.0))
    alpha_gradient = gradient(transitions, noise, next_noise, alpha)

With a from the actor, y = r + gamma (1 - terminated) (min Q'(s', a') - alpha log p(a'|s')):

    critics: sum over both of mean((Q(s, b) - y)^2), b the action that was taken
    actor:   mean(alpha log p(a|s) - min Q(s, a))
    alpha:   -log(alpha) mean(log p(a|s) + target entropy)

All are taken at the same parameters, as TorchRL's `SACLoss` does, whose gradients these equal; so
states and next states go through the actor in one product, and taken and drawn actions through the
critics. What the actor's loss would do to the critics' parameters is never computed.
"""

from __future__ import annotations

from typing import NamedTuple

import torch

from sim2real.learning.modules.soft_actor_critic import Draw, SoftActorCritic, draw

Tensor = torch.Tensor


class Transitions(NamedTuple):
    """B transitions, float32."""

    observation: Tensor  # (B, O)
    action: Tensor  # (B, A), in (-1, 1)
    reward: Tensor  # (B,)
    next_observation: Tensor  # (B, O)
    terminated: Tensor  # (B,): 1 where the task ended the episode


class SACGradient:
    """Writes the gradients of the losses into `actor_theta.grad` and `critic_theta.grad`.

    Args:
        policy: the networks.
        gamma: discount of a step.
        target_entropy: what the temperature alpha steers the actor's entropy to [nat].
    """

    def __init__(self, policy: SoftActorCritic, gamma: float, target_entropy: float) -> None:
        self._policy, self._gamma, self._target_entropy = policy, gamma, target_entropy
        actor, critic = policy.actor_theta, policy.critic_theta
        actor.grad, critic.grad = torch.zeros_like(actor), torch.zeros_like(critic)
        self._actor = policy.actor_body.weights(actor.detach())
        self._actor_out = policy.actor_body.weights(actor.grad)
        self._critic = policy.critic_body.weights(critic.detach())
        self._critic_out = policy.critic_body.weights(critic.grad)
        self._target = policy.critic_body.weights(policy.target)

    @torch.no_grad()
    def __call__(
        self, batch: Transitions, noise: Tensor, next_noise: Tensor, alpha: Tensor
    ) -> Tensor:
        """Write the gradients at the present parameters.

        Args:
            batch: transitions.
            noise: from N(0, 1), for the actions drawn in the states, (B, A).
            next_noise: the same for the next states, (B, A).
            alpha: temperature, a number.

        Returns:
            The gradient of alpha's loss by log(alpha), a number.
        """
        body, count = self._policy.critic_body, len(batch.reward)
        states = torch.cat([batch.observation, batch.next_observation])  # (2 B, O)
        layers = self._policy.actor_body.forward(self._actor, states)
        drawn = draw(layers[-1][0], torch.cat([noise, next_noise]))
        target = self._targets(batch, drawn.action[count:], drawn.log_prob[count:], alpha)
        taken = torch.cat([batch.observation, batch.action], dim=1)
        chosen = torch.cat([batch.observation, drawn.action[:count]], dim=1)
        outputs = body.forward(self._critic, torch.cat([taken, chosen]))  # (2, 2 B, ...)
        first = [x[:, :count] for x in outputs]
        error = (first[-1] - target[:, None]).mul_(2 / count)  # (2, B, 1)
        body.backward(self._critic, first, error, self._critic_out)
        uphill = self._uphill([x[:, count:] for x in outputs])  # (B, A)
        own = Draw(*(x[:count] for x in drawn))
        onward = _through_draw(own, uphill.neg_(), alpha / count)
        acting = [x[:, :count] for x in layers]
        self._policy.actor_body.backward(self._actor, acting, onward[None], self._actor_out)
        return -(own.log_prob.mean() + self._target_entropy)

    def _targets(
        self, batch: Transitions, action: Tensor, log_prob: Tensor, alpha: Tensor
    ) -> Tensor:
        """Return what the critics should say of the taken actions, (B,)."""
        after = torch.cat([batch.next_observation, action], dim=1)
        values = self._policy.critic_body.forward(self._target, after)[-1]  # (2, B, 1)
        worth = values.amin(0)[:, 0] - alpha * log_prob
        return batch.reward + self._gamma * (1 - batch.terminated) * worth

    def _uphill(self, outputs: list[Tensor]) -> Tensor:
        """Return the gradient by the actions (B, A) of the mean of the smaller value."""
        values = outputs[-1][..., 0]  # (2, B)
        smaller = (values == values.amin(0)).to(values.dtype) / values.shape[1]
        body = self._policy.critic_body
        gradient = body.backward(self._critic, outputs, smaller[..., None], None, to_input=True)
        return gradient.sum(0)[:, self._policy.observation_size :]


def _through_draw(drawn: Draw, gradient: Tensor, weight: Tensor) -> Tensor:
    """Carry a gradient of actions, and `weight` times that of log_prob, to the actor's (B, 2 A)."""
    action = drawn.action
    raw = gradient * (1 - action.square()) + 2 * weight * action
    log_std = (raw * drawn.spread - weight).masked_fill_(drawn.held, 0)
    return torch.cat([raw, log_std], dim=1)
