"""The fast loss of TRPO against TorchRL's: values and gradients, far from the policy that acted."""

import re

import pytest
import torch
from tensordict import TensorDict
from torch import nn
from torchrl.modules import ValueOperator
from torchrl.objectives import PPOLoss

from sim2real.config.compose import compose
from sim2real.learning.losses.fast_clip_ppo import FastClipPPOLoss
from sim2real.learning.losses.fast_ppo import FastPPOLoss
from sim2real.learning.losses.fast_sac import FastSACLoss
from sim2real.runs.errors import Sim2RealError
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


@pytest.mark.parametrize(
    ("kind", "own", "general"),
    [
        (FastPPOLoss, "fast_surrogate", "surrogate"),
        (FastClipPPOLoss, "fast_clip_ppo", "clip_ppo"),
        (FastSACLoss, "fast_sac", "sac"),
    ],
)
def test_the_way_out_keeps_the_objective(kind: type, own: str, general: str) -> None:
    """For networks that a fast loss refuses, it names the choice that minimizes the same."""
    odd = ValueOperator(nn.Sequential(nn.Linear(5, 8), nn.ELU(), nn.Linear(8, 1)), ["observation"])
    with pytest.raises(Sim2RealError, match=rf"has ELU; use loss={general}, which"):
        kind(networks([8], [8])[0], odd)
    numbers = [compose(["algorithm=ppo", f"loss={loss}"])["loss"] for loss in (own, general)]
    target = [tree.pop("_target_").rpartition(".")[2] for tree in numbers]
    assert numbers[0] == numbers[1] and target[0] == f"Fast{target[1]}"


def test_what_trpo_s_loss_refuses_leads_to_its_own_twin() -> None:
    """Not to PPO's loss, whose ratio is clipped."""
    actor, critic = networks([8], [8])
    with pytest.raises(Sim2RealError, match=re.escape("fast_surrogate supports no loss.reduction")):
        FastPPOLoss(actor, critic, reduction="sum")
    data: TensorDict = samples(actor, (4,))
    data["shifted_valid"] = torch.ones(4, 1, dtype=torch.bool)
    with pytest.raises(Sim2RealError, match="no masked samples; use loss=surrogate"):
        FastPPOLoss(actor, critic)(data)
