"""The fast loss of PPO against TorchRL's: values and gradients, and what it refuses."""

from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from tensordict import TensorDict
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.modules import MLP, IndependentNormal, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss

from sim2real.learning.losses.fast_clip_ppo import FastClipPPOLoss
from sim2real.runs.errors import Sim2RealError

SIZES = st.lists(st.integers(1, 9), max_size=3)
OPTIONS = st.fixed_dictionaries(
    {
        "clip_epsilon": st.one_of(st.floats(0.01, 0.5), st.just((0.1, 0.3))),
        "entropy_coeff": st.floats(0, 0.1),
        "critic_coeff": st.floats(0.1, 2),
        "loss_critic_type": st.sampled_from(["l2", "l1", "smooth_l1"]),
        "normalize_advantage": st.booleans(),
        "clip_value": st.sampled_from([None, 0.05, 0.5]),
        "entropy_bonus": st.booleans(),
        "log_explained_variance": st.booleans(),
        "functional": st.booleans(),
    }
)


def networks(
    actor: list[int], critic: list[int], activation: type[nn.Module] = nn.Tanh, **scale: Any
) -> tuple[ProbabilisticActor, ValueOperator]:
    """Return an actor of 5 observations and 2 actions and a critic, in float64."""
    common: dict[str, Any] = {"in_features": 5, "activation_class": activation}
    mean = MLP(out_features=2, num_cells=actor, **common)
    value = MLP(out_features=1, num_cells=critic, **common)
    body = nn.Sequential(mean, AddStateIndependentNormalScale(2, **scale))
    gaussian = ProbabilisticActor(
        TensorDictModule(body, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        return_log_prob=True,
    )
    return gaussian.double(), ValueOperator(value, in_keys=["observation"]).double()


def samples(actor: ProbabilisticActor, shape: tuple[int, ...]) -> TensorDict:
    """Return samples whose ratios lie on both sides of both limits."""
    data = TensorDict({"observation": torch.randn(*shape, 5).double()}, shape)
    with torch.no_grad():
        drawn = actor(data)
    old = drawn["action_log_prob"] + 0.4 * torch.randn(shape).double()
    more = {name: torch.randn(*shape, 1).double() for name in ("advantage", "value_target")}
    kept = drawn.select("observation", "action").update(more)
    kept["state_value"] = kept["value_target"] + torch.randn(*shape, 1).double()
    return kept.set("action_log_prob", old)


def compared(loss: ClipPPOLoss, data: TensorDict, weights: list[float]) -> dict[str, Any]:
    """Return all that a loss says of samples, and the gradient of the weighted sum."""
    out = loss(data)
    parts = [k for k in sorted(out.keys()) if k.startswith("loss_")]
    total: Any = sum(w * out[k] for w, k in zip(weights, parts, strict=False))
    loss.zero_grad()
    total.backward()
    slopes = {name: p.grad for name, p in loss.named_parameters()}
    return {**{k: v.detach() for k, v in out.items()}, **slopes}


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    hidden=st.tuples(SIZES, SIZES, st.booleans()),
    shape=st.sampled_from([(1,), (7,), (64,), (3, 4)]),
    activation=st.sampled_from([nn.Tanh, nn.ReLU]),
    options=OPTIONS,
    scale=st.fixed_dictionaries({"init_value": st.floats(-1, 1), "scale_lb": st.just(0.5)}),
    weights=st.lists(st.floats(-2, 2), min_size=3, max_size=3),
)
def test_it_is_clip_ppo_loss(seed: int, hidden, shape, activation, options, scale, weights) -> None:
    """Losses, what is logged, and gradients agree to 1e-9 in float64, whatever the settings."""
    torch.manual_seed(seed)
    actor, critic = networks(
        hidden[0], hidden[0] if hidden[2] else hidden[1], activation=activation, **scale
    )
    data = samples(actor, shape)
    ours, theirs = (
        compared(kind(actor, critic, **options), data, weights)
        for kind in (FastClipPPOLoss, ClipPPOLoss)
    )
    assert ours.keys() == theirs.keys()
    for name, value in theirs.items():
        torch.testing.assert_close(ours[name], value, atol=1e-9, rtol=1e-9, msg=name)


def test_trainings_agree() -> None:
    """In float32, ten steps over minibatches end at parameters that agree to 1e-6."""
    ends = []
    for kind in (FastClipPPOLoss, ClipPPOLoss):
        torch.manual_seed(0)
        actor, critic = networks([16, 16], [16, 16])
        data = samples(actor, (320,)).float()
        loss = kind(actor.float(), critic.float(), normalize_advantage=True, clip_value=0.2)
        optimizer = torch.optim.SGD(loss.parameters(), 0.1)
        for part in data.split(32):
            out = loss(part)
            (out["loss_objective"] + out["loss_critic"] + out["loss_entropy"]).backward()
            torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimizer.step()
            optimizer.zero_grad()
        ends.append(torch.cat([p.detach().flatten() for p in loss.parameters()]))
    torch.manual_seed(0)
    fresh = [p for network in networks([16, 16], [16, 16]) for p in network.parameters()]
    start = torch.cat([p.detach().flatten() for p in fresh])
    assert (ends[0] - start).abs().max() > 1e-3
    torch.testing.assert_close(*ends, atol=1e-6, rtol=0)


def test_parameters_may_be_moved() -> None:
    """A network that is cast, or whose numbers somebody replaces, is followed."""
    torch.manual_seed(0)
    actor, critic = networks([8], [8, 4])
    data, loss = samples(actor, (9,)), FastClipPPOLoss(actor, critic)
    theirs = ClipPPOLoss(actor, critic)
    loss(data)
    for part in (actor, critic):
        part.float()
    few = data.float()
    torch.testing.assert_close(loss(few)["loss_critic"], theirs(few)["loss_critic"])
    first: Any = next(critic.parameters())
    first.data = torch.randn_like(first)
    torch.testing.assert_close(loss(few)["loss_critic"], theirs(few)["loss_critic"])


def test_losses_go_back_one_by_one() -> None:
    """The critic's loss alone moves the critic alone; two minibatches' gradients add up."""
    torch.manual_seed(0)
    actor, critic = networks([8], [8])
    loss, first, second = FastClipPPOLoss(actor, critic), *samples(actor, (8,)).split(4)
    early, late = loss(first), loss(second)
    late["loss_critic"].backward()
    alone = [p.grad.clone() for p in critic.parameters()]
    assert all(p.grad is None or not p.grad.any() for p in actor.parameters())
    early["loss_critic"].backward()
    both = [p.grad.clone() for p in critic.parameters()]
    critic.zero_grad()
    loss(first)["loss_critic"].backward()
    for one, other, whole in zip(alone, critic.parameters(), both, strict=True):
        assert other.grad is not None
        torch.testing.assert_close(one + other.grad, whole)


def test_advantages_and_keys_are_those_of_its_parent() -> None:
    """Without an advantage it estimates one; entries may have other names."""
    torch.manual_seed(0)
    actor, critic = networks([8], [8])
    data = samples(actor, (3, 5)).exclude("advantage", "value_target", "state_value")
    end = torch.zeros(3, 5, 1, dtype=torch.bool)
    after = {"observation": torch.randn(3, 5, 5).double(), "reward": torch.randn(3, 5, 1).double()}
    after |= {"done": end, "terminated": end}
    data["next"] = TensorDict(after, [3, 5])
    data.rename_key_("action_log_prob", "old")
    found = []
    for kind in (FastClipPPOLoss, ClipPPOLoss):
        loss = kind(actor, critic)
        loss.set_keys(sample_log_prob="old")
        found.append(loss(data))
        assert {*(loss.in_keys or ())} >= {"observation", "action", "old"}
    for name, value in found[1].items():
        torch.testing.assert_close(found[0][name], value, msg=name)
    assert "advantage" not in data


def test_a_schedule_is_followed() -> None:
    """Coefficients that change during training count from the next minibatch on, as there."""
    torch.manual_seed(0)
    actor, critic = networks([8], [8])
    data = samples(actor, (16,))
    losses = [kind(actor, critic, clip_value=0.3) for kind in (FastClipPPOLoss, ClipPPOLoss)]
    for change in ({"clip_epsilon": 0.05}, {"entropy_coeff": 0.3, "critic_coeff": 0.7}):
        for loss in losses:
            loss(data)
            for name, value in change.items():
                setattr(loss, name, value)
        ours, theirs = (loss(data) for loss in losses)
        for name, value in theirs.items():
            torch.testing.assert_close(ours[name], value, atol=1e-7, rtol=1e-7, msg=name)


def bare(module: nn.Module, distribution: Any = IndependentNormal, **kwargs: Any) -> Any:
    """Return an actor of a network."""
    return ProbabilisticActor(
        TensorDictModule(module, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=distribution,
        distribution_kwargs=kwargs,
        return_log_prob=True,
    )


def test_what_it_cannot_differentiate_is_refused() -> None:
    """Other layers, distributions, scales and options: a sentence that names the way out."""
    scale = AddStateIndependentNormalScale(2)
    mlp = MLP(in_features=5, out_features=2, num_cells=[8], activation_class=nn.Tanh)
    critic = networks([8], [8])[1].float()
    body = nn.Sequential(mlp, scale)
    drop = MLP(in_features=5, out_features=2, num_cells=[8], dropout=0.1)
    soft = AddStateIndependentNormalScale(2, scale_mapping="softplus")
    shared = ValueOperator(nn.Sequential(mlp[0], nn.Tanh(), nn.Linear(8, 1)), ["observation"])
    wrong = {
        "has ELU": (bare(nn.Sequential(nn.Linear(5, 8), nn.ELU(), nn.Linear(8, 2), scale)),),
        "has Dropout": (bare(nn.Sequential(drop, scale)),),
        "GRU": (bare(nn.Sequential(nn.GRU(5, 2), scale)),),
        "TanhNormal": (bare(body, TanhNormal),),
        "not an exponential": (bare(nn.Sequential(mlp, soft)),),
        "'upscale': 2.0": (bare(body, upscale=2.0),),
        "share no parameter": (bare(body), shared),
    }
    for sentence, parts in wrong.items():
        with pytest.raises(Sim2RealError, match=sentence):
            FastClipPPOLoss(parts[0], parts[1] if len(parts) > 1 else critic)
    for options in ({"delay_actor": True}, {"reduction": "sum"}, {"entropy_coeff": {"a": 0.1}}):
        with pytest.raises(Sim2RealError, match=rf"loss\.{next(iter(options))}=.*use loss=clip_"):
            FastClipPPOLoss(bare(body), critic, **options)
    squashed = nn.Sequential(nn.Linear(5, 8), nn.Tanh(), nn.Linear(8, 1), nn.Softplus())
    with pytest.raises(Sim2RealError, match="no critic that does not end in a linear layer"):
        FastClipPPOLoss(bare(body), ValueOperator(squashed, ["observation"]))
    with pytest.raises(Sim2RealError, match="there is no critic"):
        FastClipPPOLoss(bare(body))


def test_masked_samples_are_refused() -> None:
    """A mask that TorchRL's loss would heed is not passed over."""
    actor, critic = networks([8], [8])
    data = samples(actor, (4,))
    data["shifted_valid"] = torch.ones(4, 1, dtype=torch.bool)
    with pytest.raises(Sim2RealError, match="no masked samples"):
        FastClipPPOLoss(actor, critic)(data)


def test_elsewhere_than_on_the_cpu_its_parent_computes() -> None:
    """Where the parameters are on another device, nothing passes through NumPy."""
    torch.manual_seed(0)
    actor, critic = networks([8], [8])
    data, loss = samples(actor, (4,)), FastClipPPOLoss(actor, critic)
    loss._gradient.flat.parameters = [nn.Parameter(torch.empty(1, device="meta"))]
    for name, value in ClipPPOLoss(actor, critic)(data).items():
        assert torch.equal(loss(data)[name], value)
