"""Networks side by side in one vector: their outputs and gradients against torch's own."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import nn

from sim2real.learning.modules.perceptrons import Perceptrons
from sim2real.runs.errors import Sim2RealError


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("last", ["linear", "activated"])
def test_outputs_and_gradients_are_those_of_torchs_layers(activation: Any, last: Any) -> None:
    """Each of three networks equals a chain of linear layers, by parameters and by input."""
    stack, g = Perceptrons(3, (4, 6, 5), activation, last), torch.Generator().manual_seed(0)
    theta = torch.randn(stack.num_parameters, generator=g)
    x = torch.randn(7, 4, generator=g, requires_grad=True)
    upstream, weights = torch.randn(3, 7, 5, generator=g), stack.weights(theta)
    layers = stack.forward(weights, x.detach())
    gradient = torch.zeros_like(theta)
    own = stack.backward(weights, layers, upstream, stack.weights(gradient), to_input=True)
    leaves = [tuple(t.clone().requires_grad_() for t in layer) for layer in weights]
    for network in range(3):
        out = x
        for number, (weight, bias) in enumerate(leaves):
            out = nn.functional.linear(out, weight[network].T, bias[network, 0])
            if number == 0 or last == "activated":
                out = torch.tanh(out) if activation == "tanh" else torch.relu(out)
        torch.testing.assert_close(layers[-1][network], out)
        (by_input,) = torch.autograd.grad(out, x, upstream[network], retain_graph=True)
        torch.testing.assert_close(own[network], by_input)
        out.backward(upstream[network])
    for (weight, bias), found in zip(leaves, stack.weights(gradient), strict=True):
        torch.testing.assert_close(found[0], weight.grad)
        torch.testing.assert_close(found[1], bias.grad)


def test_what_makes_no_network_is_refused() -> None:
    """Widths of 0 and unknown nonlinearities."""
    with pytest.raises(Sim2RealError, match=r"layers of \(4, 0, 2\)"):
        Perceptrons(1, (4, 0, 2), "tanh", "linear")
    with pytest.raises(Sim2RealError, match="activation='sine' is not one of tanh, relu"):
        Perceptrons(1, (4, 2), "sine", "linear")  # type: ignore[arg-type]
