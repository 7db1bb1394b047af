"""A network in NumPy: its outputs and gradients against torch's own."""

from itertools import pairwise
from typing import Any

import pytest
import torch
from torch import nn

from sim2real.learning.modules.arrays import ArrayMLP


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("sizes", [(4, 6, 5, 3), (4, 2)])
def test_outputs_and_gradients_are_those_of_torchs_layers(activation: Any, sizes) -> None:
    """It equals a chain of linear layers, by parameters and by input."""
    torch.manual_seed(0)
    network, linears = ArrayMLP(activation), [nn.Linear(*pair) for pair in pairwise(sizes)]
    x, upstream = torch.randn(7, sizes[0], requires_grad=True), torch.randn(7, sizes[-1])
    leaves = [p for layer in linears for p in (layer.weight, layer.bias)]
    layers = network.layers([p.detach().numpy() for p in leaves])
    outputs = network.forward(layers, x.detach().numpy())
    slopes = [torch.empty_like(p) for p in leaves]
    out = network.layers([slope.numpy() for slope in slopes])
    by_input = network.backward(layers, outputs, upstream.numpy(), out, to_input=True)
    assert network.backward(layers, outputs, upstream.numpy(), None) is None
    y = x
    for number, layer in enumerate(linears):
        y = layer(y if number == 0 else getattr(torch, activation)(y))
    y.backward(upstream)
    torch.testing.assert_close(torch.from_numpy(outputs[-1]), y.detach())
    torch.testing.assert_close(torch.from_numpy(by_input), x.grad)
    for slope, leaf in zip(slopes, leaves, strict=True):
        torch.testing.assert_close(slope, leaf.grad)
