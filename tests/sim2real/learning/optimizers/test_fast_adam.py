"""The fast Adam against torch's: the same steps, and states that either goes on with."""

from copy import deepcopy
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from sim2real.learning.modules.flat import FlatParameters, contiguous_vector
from sim2real.learning.optimizers.fast_adam import FastAdam
from sim2real.runs.errors import Sim2RealError


def network(seed: int = 0) -> nn.Sequential:
    """Return a small network in float64."""
    torch.manual_seed(seed)
    return nn.Sequential(nn.Linear(3, 4), nn.Tanh(), nn.Linear(4, 2)).double()


def train(module: nn.Module, optimizer: torch.optim.Optimizer, steps: int, seed: int) -> None:
    """Take steps on random data; the last layer's bias gets no gradient in every third."""
    g = torch.Generator().manual_seed(seed)
    for number in range(steps):
        loss = module(torch.randn(5, 3, generator=g).double()).square().sum()
        optimizer.zero_grad()
        loss.backward()
        if number % 3 == 2:
            module[-1].bias.grad = None  # type: ignore[index, union-attr]
        optimizer.step()


def vector(module: nn.Module) -> torch.Tensor:
    """Return the parameters, (P,)."""
    return torch.cat([p.detach().flatten() for p in module.parameters()])


@settings(max_examples=30, deadline=None)
@given(
    lr=st.floats(1e-5, 0.1),
    betas=st.tuples(st.floats(0, 0.99), st.floats(0.5, 0.9999)),
    eps=st.floats(1e-8, 1e-3),
    steps=st.integers(1, 8),
)
def test_it_is_adam(lr: float, betas: tuple[float, float], eps: float, steps: int) -> None:
    """After some steps the parameters agree to 1e-12, whatever the settings."""
    ours, theirs = network(), network()
    options: dict[str, Any] = {"lr": lr, "betas": betas, "eps": eps}
    train(ours, FastAdam(ours.parameters(), **options), steps, 1)
    train(theirs, torch.optim.Adam(theirs.parameters(), **options), steps, 1)
    torch.testing.assert_close(vector(ours), vector(theirs), atol=1e-12, rtol=1e-10)


@pytest.mark.parametrize("kinds", [(FastAdam, torch.optim.Adam), (torch.optim.Adam, FastAdam)])
def test_a_state_goes_on_in_the_other(kinds: tuple[Any, Any]) -> None:
    """A state of either, loaded into the other, goes on as torch's alone does."""
    mixed, alone = network(), network()
    whole = torch.optim.Adam(alone.parameters(), lr=0.01)
    first, second = (kind(mixed.parameters(), lr=0.01) for kind in kinds)
    train(mixed, first, 4, 1)
    second.load_state_dict(deepcopy(first.state_dict()))
    train(mixed, second, 5, 2)
    train(alone, whole, 4, 1)
    train(alone, whole, 5, 2)
    torch.testing.assert_close(vector(mixed), vector(alone), atol=1e-12, rtol=1e-10)
    assert first.state_dict()["state"].keys() == whole.state_dict()["state"].keys()


def test_a_closure_is_called() -> None:
    """As torch's optimizers, it computes the loss first where it is told how."""
    module = network()
    before, optimizer = vector(module), FastAdam(module.parameters(), lr=0.01)

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        loss = module(torch.ones(1, 3).double()).sum()
        loss.backward()
        return loss

    assert optimizer.step(closure) is not None
    assert not torch.equal(vector(module), before)


def test_parameters_lie_side_by_side() -> None:
    """They share one vector, also for a second user; what moves is gathered again."""
    module = network()
    one, other = (FlatParameters(list(module.parameters())) for _ in range(2))
    assert one.renew() and other.renew()
    assert one.vector.data_ptr() == other.vector.data_ptr()
    one.vector.zero_()
    assert not vector(module).any() and not one.renew()
    module[0].weight.data = torch.ones(4, 3).double()
    assert one.renew() and one.vector.sum() == 12
    parts = list(torch.zeros(6).split(3))
    assert contiguous_vector(parts) is not None
    assert contiguous_vector(parts[::-1]) is None
    assert contiguous_vector([torch.zeros(3), torch.zeros(3)]) is None


def test_a_gradient_is_clipped_as_torch_does() -> None:
    """Whether it lies in one vector or in many tensors."""
    module = network()
    flat = FlatParameters(list(module.parameters()))
    for together in (True, False):
        whole = torch.arange(1.0, 1 + len(vector(module))).double()
        parts = flat.split(whole) if together else [g.clone() for g in flat.split(whole)]
        for p, g in zip(flat.parameters, parts, strict=True):
            p.grad = g
        assert (flat.gradient() is None) != together
        flat.clip_gradient(0.5)
        found = torch.cat([p.grad.flatten() for p in flat.parameters])  # type: ignore[union-attr]
        assert float(found.norm()) == pytest.approx(0.5, abs=1e-6)


def test_what_it_has_not_is_refused() -> None:
    """Options and groups that need torch's own: a sentence that says so."""
    with pytest.raises(Sim2RealError, match=r"no amsgrad=True; use optimizer=adam"):
        FastAdam(network().parameters(), amsgrad=True)
    with pytest.raises(Sim2RealError, match="groups of parameters"):
        FastAdam([{"params": list(network().parameters())}])  # type: ignore[list-item]
    with pytest.raises(Sim2RealError, match="several dtypes"):
        FastAdam([nn.Parameter(torch.zeros(1)), nn.Parameter(torch.zeros(1).double())])
