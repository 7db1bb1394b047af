"""A second device without a GPU: its tensors are the processor's, and nothing may mix the two.

    with Apart():
        learner(device="far").iterate()   # raises where a tensor was made on the wrong device

What CUDA refuses is refused: an operation on tensors of both devices, but for numbers (tensors of
no dimension) and for indices, which CUDA takes from the processor too; and numpy() of a far one.
It registers a backend with PyTorch, for good: use it in a process of its own.
"""

from __future__ import annotations

from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map
from torch.utils.backend_registration import (
    _DummyBackendModule,
    _setup_privateuseone_for_python_backend,
)


class _Backend(_DummyBackendModule):
    def synchronize(self, *_: object) -> None:
        """Wait for nothing."""

    def get_amp_supported_dtype(self) -> list[torch.dtype]:
        """Return the types of autocast."""
        return [torch.bfloat16]


NAME = "far"
_setup_privateuseone_for_python_backend(NAME, _Backend())

MOVES = ("aten::_to_copy", "aten::copy_")
INDEXED = ("aten::index", "aten::index_put", "aten::index_put_", "aten::_index_put_impl_")


class Far(torch.Tensor):
    """A tensor of the second device; `held` is what it is on the processor."""

    held: torch.Tensor

    @staticmethod
    def __new__(cls, held: torch.Tensor) -> Far:
        """Return a tensor of the same shape, type and layout on the second device."""
        made = torch.Tensor._make_wrapper_subclass(  # type: ignore[attr-defined]
            cls, held.size(), strides=held.stride(), dtype=held.dtype, device=torch.device(NAME, 0)
        )
        made.held = held.detach()
        return made

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Do an operation."""
        return _do(func, args, kwargs or {})


class Apart(TorchDispatchMode):
    """While it lasts, tensors can be made on the second device."""

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Do an operation."""
        return _do(func, args, kwargs or {})


def _do(func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    name = func._schema.name
    tensors = [x for x in tree_flatten((args, kwargs))[0] if isinstance(x, torch.Tensor)]
    far = {id(x.held): x for x in tensors if isinstance(x, Far)}
    indices = {id(x) for x in args[1]} if name in INDEXED else set()
    near = [x for x in tensors if not isinstance(x, Far) and x.dim() and id(x) not in indices]
    if far and near and name not in MOVES:
        raise RuntimeError(f"{name}: tensors on both devices")
    device = kwargs.get("device")
    goes = bool(far) if device is None else torch.device(device).type == NAME
    if device is not None:
        kwargs = {**kwargs, "device": torch.device("cpu")}
    result = func(*tree_map(_held, args), **tree_map(_held, kwargs))
    if not func._schema.returns:
        return None
    if name == "aten::copy_":
        return args[0]
    return tree_map(lambda x: _far(x, far), result) if goes else result


def _held(x: Any) -> Any:
    return x.held if isinstance(x, Far) else x


def _far(x: Any, known: dict[int, Far]) -> Any:
    """Return a result on the second device: the argument itself where it was changed in place."""
    return (known[id(x)] if id(x) in known else Far(x)) if isinstance(x, torch.Tensor) else x
