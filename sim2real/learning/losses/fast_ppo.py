"""TorchRL's PPO loss without clipping, faster: what TRPO climbs (Schulman et al. 2015, eq. 14).

loss = FastPPOLoss(actor, critic, loss_critic_type="l2")
losses = loss(minibatch)                          # loss_objective = -mean(r A), loss_critic, ...
"""

import math
from typing import Any

import torch

from sim2real.learning.losses.fast_clip_ppo import FastClipPPOLoss

Tensor = torch.Tensor


class FastPPOLoss(FastClipPPOLoss):
    """`PPOLoss` of an MLP with a state-independent scale, and of an MLP as critic.

    It is `FastClipPPOLoss` with limits that no ratio of probabilities reaches; see there.

    Args:
        actor_network: a `ProbabilisticActor` of `IndependentNormal` over `MLP` and
            `AddStateIndependentNormalScale` (exponential).
        critic_network: a `ValueOperator` over `MLP`.
        options: those of `PPOLoss`.

    Raises:
        Sim2RealError: for networks that it cannot differentiate, and for options that it does not
            have; `PPOLoss` takes those.
    """

    own, general = "loss=fast_surrogate", "loss=surrogate"

    @property
    def _clip_bounds(self) -> tuple[Tensor, Tensor]:
        """Return the logarithms of the least and the largest ratio."""
        epsilon: Any = self.clip_epsilon
        limits = torch.tensor([-math.inf, math.inf], device=epsilon.device)
        return limits[0], limits[1]
