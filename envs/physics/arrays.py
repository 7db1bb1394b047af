"""The arrays of a physics engine: NumPy's, or torch's on a device.

    arrays.xp.sin(arrays.own(angles))       # `xp` is the Array API's namespace
    arrays.own(angles)[arrays.rows(ids)]    # ids (n,) of the host

What steps with the simulations (a task, a measurement) is written in that API once, for both.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any  # np.ndarray or torch.Tensor


@dataclass(frozen=True)
class Arrays:
    """The array library and the device of arrays."""

    xp: Any = np  # the namespace: `numpy`, or `array_api_compat.torch`
    dtype: Any = np.float64  # of real numbers
    device: Any = None  # of a torch namespace

    @property
    def on_host(self) -> bool:
        """Whether they are NumPy's."""
        return self.xp is np

    def own(self, x: Any) -> Array:
        """Return a copy of a host's array as one of these; what is one already stays as it is."""
        if self.on_host or not isinstance(x, np.ndarray):
            return x
        if x.dtype.kind == "f":
            x = x.astype(np.float32)
        elif x.dtype == np.uint64:  # the same bits: torch computes with signed integers
            x = x.view(np.int64)
        return self.xp.asarray(np.ascontiguousarray(x), device=self.device, copy=True)

    def host(self, x: Array) -> np.ndarray:
        """Return one of these arrays on the host."""
        return x if self.on_host else x.cpu().numpy()

    def rows(self, ids: np.ndarray | None) -> Any:
        """Return the index of the rows ids (n,) of the host; None: all."""
        return slice(None) if ids is None else self.own(ids)

    def index(self, index: Any) -> Any:
        """Return an index of the host, or a tuple of parts of one, as these arrays take it."""
        if self.on_host or not isinstance(index, tuple):
            return self.own(index)
        return tuple(self.own(part) for part in index)

    def zeros(self, shape: Any, dtype: Any = None) -> Array:
        """Return zeros; reals unless `dtype` is of a NumPy kind such as bool or np.int64."""
        return self.own(np.zeros(shape, np.float64 if dtype is None else dtype))


NUMPY = Arrays()
