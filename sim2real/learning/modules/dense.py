"""Tensordict modules that are nothing but a multi-layer perceptron, read as their layers.

    actor, critic = read_dense(actor_network), read_dense(critic_network)
    flat, starts = flatten([actor, critic])           # their numbers, in one vector

What calls such a network without TorchRL's and autograd's machinery needs its layers, and gains
most where they lie side by side. A network with anything else in it is refused, never guessed at.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

from tensordict.nn import (
    ProbabilisticTensorDictModule,
    TensorDictModule,
    TensorDictModuleBase,
    TensorDictSequential,
)
from torch import nn
from torchrl.modules import MLP

from sim2real.learning.modules.flat import FlatParameters
from sim2real.learning.modules.mlp_policy import Activation
from sim2real.runs.errors import Sim2RealError

ACTIVATIONS: dict[type[nn.Module], Activation] = {nn.Tanh: "tanh", nn.ReLU: "relu"}


@dataclass(frozen=True, eq=False)
class Dense:
    """A multi-layer perceptron, linear layers with one nonlinearity between them.

    Attributes:
        in_keys: entries that it reads; their last dimensions are joined.
        out_keys: entries that it writes.
        linears: its layers, in order; each has a bias.
        activation: nonlinearity between them.
        head: what follows the last layer: a scale that does not depend on the state, or another
            module without parameters; None for nothing.
    """

    in_keys: tuple[str | tuple[str, ...], ...]
    out_keys: tuple[str | tuple[str, ...], ...]
    linears: tuple[nn.Linear, ...]
    activation: Activation
    head: nn.Module | None

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of the input, of each hidden layer and of the output."""
        return (self.linears[0].in_features, *(layer.out_features for layer in self.linears))

    @property
    def parameters(self) -> list[nn.Parameter]:
        """Weights and biases by layer, then those of the head."""
        own: list[Any] = [p for layer in self.linears for p in (layer.weight, layer.bias)]
        return own + ([] if self.head is None else list(self.head.parameters()))


def read_dense(network: TensorDictModuleBase, instead: str = "another part") -> Dense:
    """Read a tensordict module, without the distribution at its end, as a perceptron.

    Args:
        network: the module.
        instead: what takes any network in place of the caller, such as "loss=sac".

    Raises:
        Sim2RealError: for a network with other parts than linear layers, one nonlinearity and,
            last, a head.
    """
    try:
        return _read(network)
    except _OtherError as other:
        raise Sim2RealError(
            "policy: a fast part takes linear layers with tanh or ReLU between them and nothing "
            f"else, this has {other}; use {instead}, which takes any network"
        ) from None


class _OtherError(Exception):
    """What a perceptron does not have."""


def _read(network: TensorDictModuleBase) -> Dense:
    modules = list(_modules(network))
    layers = [layer for module in modules for layer in _layers(module.module)]
    for before, after in pairwise(modules):
        if list(after.in_keys) != list(before.out_keys)[: len(after.in_keys)]:
            raise _OtherError(
                f"{list(after.in_keys)} read after {list(before.out_keys)} was written"
            )
    head = layers.pop() if layers and type(layers[-1]) not in (nn.Linear, *ACTIVATIONS) else None
    for layer in layers:
        if type(layer) not in (nn.Linear, *ACTIVATIONS):
            raise _OtherError(type(layer).__name__)
    linears, between = layers[::2], layers[1::2]
    kinds = {type(layer) for layer in between} or {nn.Tanh}
    alternate = all(type(layer) is nn.Linear and layer.bias is not None for layer in linears)
    if not alternate or len(linears) != len(between) + 1 or len(kinds) > 1 or nn.Linear in kinds:
        names = ", ".join(type(layer).__name__ for layer in layers)
        raise _OtherError(f"{names} or a layer without a bias")
    keys = tuple(modules[0].in_keys), tuple(modules[-1].out_keys)
    return Dense(*keys, tuple(linears), ACTIVATIONS[kinds.pop()], head)  # type: ignore[arg-type]


def _modules(network: Any) -> Iterator[Any]:
    """Yield the modules that compute something, in order."""
    if isinstance(network, TensorDictSequential):
        for module in network.module:
            yield from _modules(module)
    elif isinstance(network, TensorDictModule):
        yield network
    elif not isinstance(network, ProbabilisticTensorDictModule):
        raise _OtherError(type(network).__name__)


def _layers(module: Any) -> Iterator[Any]:
    """Yield the layers of nested sequences."""
    if type(module) is nn.Sequential or (type(module) is MLP and not module._reshape_out):
        for layer in module:
            yield from _layers(layer)
    elif type(module) is not nn.Identity:
        yield module


def flatten(networks: Sequence[Dense]) -> tuple[FlatParameters, list[int]]:
    """Put the parameters of networks into one vector; return it, and where each network begins.

    Raises:
        Sim2RealError: for networks that share a parameter, or of several dtypes or devices.
    """
    parameters = [p for network in networks for p in network.parameters]
    if len({id(p) for p in parameters}) < len(parameters):
        raise Sim2RealError("policy: a fast part takes networks that share no parameter")
    if len({(p.dtype, p.device) for p in parameters}) > 1:
        raise Sim2RealError("policy: a fast part takes networks of one dtype on one device")
    counts = [sum(p.numel() for p in network.parameters) for network in networks]
    return FlatParameters(parameters), [0, *accumulate(counts)]
