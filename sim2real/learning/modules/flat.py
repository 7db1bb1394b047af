"""Tensors that lie side by side in memory, as the one vector that they are.

    vector = gather([p.data for p in parameters])     # (P,), and each p.data becomes a view of it
    same = side_by_side([p.data for p in parameters]) # None if one was replaced

A network of reinforcement learning is a dozen small tensors. What an optimizer or a gradient does
to each of them costs more to call than to do, so that one call for all is several times faster.
"""

from collections.abc import Sequence
from typing import Any

import torch
from torch import nn

Tensor = torch.Tensor


def contiguous_vector(tensors: Sequence[Tensor]) -> Tensor | None:
    """Return the vector (P,) that contiguous tensors are, in their order; None if they are not."""
    first = tensors[0]
    size, place = first.element_size(), first.data_ptr()
    start = place
    for tensor in tensors:
        if tensor.data_ptr() != place or tensor.dtype != first.dtype:
            return None
        place += tensor.numel() * size
    return _from(first, (place - start) // size)


def _from(first: Tensor, count: int) -> Tensor | None:
    """Return the vector of `count` numbers that begins with a tensor; None if it ends before."""
    offset = first.storage_offset()
    if (offset + count) * first.element_size() > first.untyped_storage().nbytes():
        return None  # neighbours by chance
    return first.detach().as_strided((count,), (1,), offset)


def split(vector: Tensor, like: Sequence[Tensor]) -> list[Tensor]:
    """Return consecutive views of a vector (P,) in the shapes of other tensors."""
    return list(torch._C._nn.unflatten_dense_tensors(vector, like))  # type: ignore[attr-defined]


class FlatParameters:
    """Parameters in one vector (P,).

    They stay what they are to modules and optimizers; only their numbers lie elsewhere.

    Args:
        parameters: the parameters of one dtype on one device, each once.
    """

    def __init__(self, parameters: Sequence[nn.Parameter]) -> None:
        self.parameters = list(parameters)
        self.vector = torch.empty(0)
        self._places: list[int] = []
        self._apart: list[int] = []  # bytes from the first parameter to each

    def renew(self) -> bool:
        """Gather the parameters again if one was replaced; return whether `vector` is new."""
        if [p.data_ptr() for p in self.parameters] == self._places:
            return False
        found = contiguous_vector(self.parameters)
        if found is None:
            found = torch.cat([p.detach().flatten() for p in self.parameters])
            for p, part in zip(self.parameters, self.split(found), strict=True):
                p.data = part
        self.vector = found
        self._places = [p.data_ptr() for p in self.parameters]
        self._apart = [place - self._places[0] for place in self._places]
        return True

    def split(self, vector: Tensor) -> list[Tensor]:
        """Return views of a vector (P,) in the shapes of the parameters."""
        return split(vector, self.parameters)

    def gradient(self) -> Tensor | None:
        """Return the gradients as the one vector (P,) that they are; None if they are not."""
        gradients: list[Any] = [p.grad for p in self.parameters]
        if any(g is None for g in gradients):
            return None
        self.renew()
        places = [g.data_ptr() for g in gradients]
        if [place - places[0] for place in places] != self._apart:
            return None
        return _from(gradients[0], len(self.vector))

    def clip_gradient(self, limit: float) -> None:
        """Shorten the gradient to a norm, as `torch.nn.utils.clip_grad_norm_` does."""
        gradient = self.gradient()
        if gradient is None:
            nn.utils.clip_grad_norm_(self.parameters, limit)
        else:
            norm = torch.linalg.vector_norm(gradient)
            gradient.mul_(norm.add_(1e-6).reciprocal_().mul_(limit).clamp_(max=1.0))
