"""The fast loss of TRPO against TorchRL's: values and gradients, far from the policy that acted."""

import pytest
import torch
from torchrl.objectives import PPOLoss

from sim2real.learning.losses.fast_ppo import FastPPOLoss
from tests.sim2real.learning.losses.test_fast_clip_ppo import networks, samples


@pytest.mark.parametrize("normalize", [True, False])
def test_it_is_torchrls(normalize: bool) -> None:
    """Ratios of 0.1 and of 10 are not cut; objective, critic's loss and gradients are PPOLoss's."""
    torch.manual_seed(0)
    actor, critic = networks([7, 5], [6])
    data = samples(actor, (50,))
    data["action_log_prob"] += 2 * torch.randn(50).double()
    common = {"entropy_bonus": False, "loss_critic_type": "l2", "normalize_advantage": normalize}
    found = []
    for kind in (FastPPOLoss, PPOLoss):
        loss = kind(actor, critic, **common)
        out = loss(data.clone())
        loss.zero_grad()
        (out["loss_objective"] + 0.7 * out["loss_critic"]).backward()
        gradients = [p.grad.clone() for p in loss.parameters() if p.grad is not None]
        found.append((out["loss_objective"], out["loss_critic"], *gradients))
    with torch.no_grad():
        drawn = actor.get_dist(data).log_prob(data["action"]) - data["action_log_prob"]
    assert float(drawn.max()) > 2 and float(drawn.min()) < -2
    assert len(found[0]) == len(found[1]) == 2 + len(list(loss.parameters()))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, atol=1e-9, rtol=1e-6)
