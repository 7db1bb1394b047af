"""A multi-layer perceptron in NumPy, on the memory of torch's parameters, with its gradient.

    network = ArrayMLP("tanh")
    layers = network.layers(parameters)               # weights and biases, views of theirs
    outputs = network.forward(layers, x)              # x, and each layer's output
    network.backward(layers, outputs, upstream, slopes)

For networks of reinforcement learning on the CPU NumPy is faster than torch: a call costs a third,
and OpenBLAS multiplies the layers of 64 and of 256 faster than the MKL of torch's wheels.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim2real.learning.modules.mlp_policy import Activation

Array = np.ndarray
ArrayLayers = list[tuple[Array, Array]]  # weights (out, in) and biases (out,), by layer


class ArrayMLP:
    """Linear layers with one nonlinearity between them.

    Args:
        activation: the nonlinearity.
    """

    def __init__(self, activation: Activation) -> None:
        self._tanh = activation == "tanh"

    @staticmethod
    def layers(parameters: Sequence[Array]) -> ArrayLayers:
        """Return weights and biases, given in turns, by layer."""
        return list(zip(parameters[::2], parameters[1::2], strict=True))

    def forward(self, layers: ArrayLayers, x: Array) -> list[Array]:
        """Return the input (B, in) and every layer's output, (B, width) each."""
        outputs = [x]
        for weight, bias in layers:
            if len(outputs) > 1:
                self._activate(outputs[-1])
            x = np.dot(outputs[-1], weight.T)
            x += bias
            outputs.append(x)
        return outputs

    def backward(
        self,
        layers: ArrayLayers,
        outputs: list[Array],
        gradient: Array,
        slopes: ArrayLayers | None,
        to_input: bool = False,
    ) -> Any:
        """Carry a gradient of the last output back.

        Args:
            layers: that `forward` was given.
            outputs: what it returned, or the same samples of each.
            gradient: of some loss by the last output, (B, out).
            slopes: where the gradient by the layers is written; None leaves it out.
            to_input: whether the gradient by the input is wanted.

        Returns:
            The gradient by the input, (B, in), or None.
        """
        for number in range(len(layers) - 1, -1, -1):
            seen = outputs[number]
            if slopes is not None:
                np.dot(gradient.T, seen, out=slopes[number][0])
                np.add.reduce(gradient, 0, out=slopes[number][1])
            if number or to_input:
                gradient = np.dot(gradient, layers[number][0])
            if number:
                gradient *= 1 - seen * seen if self._tanh else seen > 0
        return gradient if to_input else None

    def _activate(self, x: Array) -> None:
        """Put the nonlinearity of numbers in their place."""
        if self._tanh:
            np.tanh(x, out=x)
        else:
            np.maximum(x, 0, out=x)
