"""The fast loss of SAC against TorchRL's: values and gradients, and what it refuses."""

from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from tensordict import TensorDict
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import nn
from torchrl.modules import MLP, IndependentNormal, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate, ValueEstimators

from sim2real.learning.losses.fast_sac import FastSACLoss
from sim2real.learning.modules.heads import NormalHead
from sim2real.runs.errors import Sim2RealError

SIZES = st.lists(st.integers(1, 9), min_size=1, max_size=3)
OPTIONS = st.fixed_dictionaries(
    {
        "loss_function": st.sampled_from(["l2", "l1", "smooth_l1"]),
        "num_qvalue_nets": st.integers(1, 3),
        "alpha_init": st.floats(0.05, 2),
        "fixed_alpha": st.booleans(),
        "min_alpha": st.sampled_from([None, 0.3]),
        "delay_qvalue": st.booleans(),
        "target_entropy": st.floats(-4, 0),
    }
)


def networks(
    actor: list[int],
    critic: list[int],
    activation: type[nn.Module] = nn.ReLU,
    distribution: Any = TanhNormal,
    head: nn.Module | None = None,
    **kwargs: Any,
) -> tuple[ProbabilisticActor, ValueOperator]:
    """Return an actor of 5 observations and 2 actions and a critic, in float64."""
    common: dict[str, Any] = {"activation_class": activation}
    said = MLP(in_features=5, out_features=4, num_cells=actor, **common)
    body = nn.Sequential(said, head or NormalHead(-1.0, 0.3))
    squashed = ProbabilisticActor(
        TensorDictModule(body, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=distribution,
        distribution_kwargs=kwargs,
        return_log_prob=True,
    )
    value = MLP(in_features=7, out_features=1, num_cells=critic, **common)
    return squashed.double(), ValueOperator(value, in_keys=["observation", "action"]).double()


def transitions(*shape: int) -> TensorDict:
    """Return transitions, some of which end the episode."""
    over = torch.rand(*shape, 1) < 0.3
    after = {"observation": torch.randn(*shape, 5).double()}
    after |= {"reward": torch.randn(*shape, 1).double(), "terminated": over, "done": over}
    data = {"observation": torch.randn(*shape, 5).double(), "next": after}
    return TensorDict(data | {"action": torch.rand(*shape, 2).double() * 2 - 1}, shape)


def compared(loss: SACLoss, data: TensorDict, weights: list[float]) -> dict[str, Any]:
    """Return what a loss says of transitions, and the gradient of the weighted sum."""
    torch.manual_seed(1)  # of the actions
    given = data.clone()
    out = loss(given)
    names = ("loss_actor", "loss_qvalue", "loss_alpha")
    total = sum(w * out[k] for w, k in zip(weights, names, strict=True) if out[k].requires_grad)
    loss.zero_grad()
    total.backward()  # type: ignore[union-attr]
    slopes = {name: p.grad for name, p in loss.named_parameters()}
    values = {k: v.detach() for k, v in out.items()}
    return {**values, **slopes, "td_error": given["td_error"]}


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    hidden=st.tuples(SIZES, SIZES),
    shape=st.sampled_from([(1,), (7,), (64,), (3, 4)]),
    activation=st.sampled_from([nn.Tanh, nn.ReLU]),
    safe_tanh=st.booleans(),
    options=OPTIONS,
    gamma=st.floats(0, 1),
    weights=st.lists(st.floats(-2, 2), min_size=3, max_size=3),
)
def test_it_is_sac_loss(
    seed: int,
    hidden: tuple[list[int], list[int]],
    shape: tuple[int, ...],
    activation: type[nn.Module],
    safe_tanh: bool,
    options: dict[str, Any],
    gamma: float,
    weights: list[float],
) -> None:
    """After the same seed, losses, errors and gradients agree, whatever the settings."""
    torch.manual_seed(seed)
    actor, critic = networks(*hidden, activation=activation, safe_tanh=safe_tanh)
    data, found = transitions(*shape), []
    for kind in (FastSACLoss, SACLoss):
        torch.manual_seed(seed)  # of the critics, which start apart
        loss = kind(actor, critic, **options)
        loss.make_value_estimator(gamma=gamma)
        found.append(compared(loss, data, weights))
    ours, theirs = found
    assert ours.keys() == theirs.keys()
    for name, value in theirs.items():
        torch.testing.assert_close(ours[name], value, atol=1e-7, rtol=1e-7, msg=name)


def test_trainings_agree() -> None:
    """In float32, ten steps with a target that follows end at parameters that agree to 1e-6."""
    ends = []
    for kind in (FastSACLoss, SACLoss):
        torch.manual_seed(0)
        actor, critic = networks([16, 8], [16, 8])
        data = transitions(320).apply(lambda x: x.float() if x.is_floating_point() else x)
        assert data is not None
        loss = kind(actor.float(), critic.float(), loss_function="l2", target_entropy=-2.0)
        loss.make_value_estimator(gamma=0.99)
        start = [p.detach().clone() for p in loss.parameters()]
        optimizer, target = torch.optim.SGD(loss.parameters(), 0.05), SoftUpdate(loss, tau=0.1)
        for part in data.split(32):
            out = loss(part)
            (out["loss_actor"] + out["loss_qvalue"] + out["loss_alpha"]).backward()
            optimizer.step()
            optimizer.zero_grad()
            target.step()
        after = [*loss.parameters(), *loss.target_qvalue_network_params.values(True, True)]
        ends.append(torch.cat([p.detach().flatten() for p in after]))
        moved = [(p - q).abs().max() for p, q in zip(loss.parameters(), start, strict=True)]
        assert min(moved) > 1e-4
    torch.testing.assert_close(*ends, atol=1e-6, rtol=0)


def test_the_actors_loss_moves_the_actor_alone() -> None:
    """Each loss can go back by itself, to its own parameters."""
    torch.manual_seed(0)
    loss = FastSACLoss(*networks([8], [8]), target_entropy=-2.0)
    loss(transitions(4))["loss_actor"].backward()
    assert all(p.grad is not None for p in loss.actor_network_params.parameters())
    assert all(p.grad is None for p in loss.qvalue_network_params.parameters())
    assert loss.log_alpha.grad is None


def test_what_it_cannot_differentiate_is_refused() -> None:
    """Other layers, laws, limits, critics and options: a sentence that names the way out."""
    actor, critic = networks([8], [8])
    swapped = ValueOperator(MLP(in_features=7, out_features=1), ["action", "observation"])
    wrong: dict[str, tuple[Any, Any]] = {
        "has ELU": networks([8], [8], activation=nn.ELU),
        "no actor of IndependentNormal": networks([8], [8], distribution=IndependentNormal),
        "high=2.0; scale actions by ActionScaling": networks([8], [8], high=2.0),
        "actor without a NormalHead": networks([8], [8], head=NormalParamExtractor()),
        r"critic of \['action', 'observation'\]": (actor, swapped),
    }
    for sentence, parts in wrong.items():
        with pytest.raises(Sim2RealError, match=sentence):
            FastSACLoss(*parts)
    with pytest.raises(Sim2RealError, match=r"no reduction='sum'; use loss=sac"):
        FastSACLoss(actor, critic, reduction="sum")
    loss = FastSACLoss(actor, critic, target_entropy=-2.0)
    loss.make_value_estimator(ValueEstimators.TD1, gamma=0.9)
    with pytest.raises(Sim2RealError, match="another value estimator than TD0"):
        loss(transitions(4))
    loss.make_value_estimator(gamma=0.9)
    with pytest.raises(Sim2RealError, match="weights of samples"):
        loss(transitions(4).set("priority_weight", torch.ones(4)))
