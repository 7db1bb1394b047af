"""Attributes that give one type and take another: an array, of whatever makes one."""

from typing import Any, Generic, SupportsFloat, SupportsIndex, SupportsInt, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Int = SupportsInt | SupportsIndex
Float = SupportsFloat | SupportsIndex
Floats = NDArray[np.float64]

_Get = TypeVar("_Get", covariant=True)
_Set = TypeVar("_Set", contravariant=True)

class _Field(Generic[_Get, _Set]):
    def __get__(self, instance: Any, owner: Any = ...) -> _Get: ...
    def __set__(self, instance: Any, value: _Set) -> None: ...

_Int = _Field[int, Int]
_Float = _Field[float, Float]
_Floats = _Field[Floats, ArrayLike]
_Singles = _Field[NDArray[np.float32], ArrayLike]
_Ints = _Field[NDArray[np.int32], ArrayLike]
_Bools = _Field[NDArray[np.bool], ArrayLike]
