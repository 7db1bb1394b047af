"""Pictures of a state."""

from typing import Any

import numpy as np
from mujoco._fields import ArrayLike, Int, NDArray, _Field, _Float, _Int
from mujoco._structs import MjModel

class MjvCamera:
    distance: _Float
    fixedcamid: _Int
    type: _Int

class MjvOption:
    flags: _Field[NDArray[np.uint8], ArrayLike]
    frame: _Int
    label: _Int

class MjvScene:
    def __init__(self, model: MjModel, maxgeom: Int) -> None: ...
    @property
    def camera(self) -> tuple[Any, ...]: ...
    flags: _Field[NDArray[np.uint8], ArrayLike]
    @property
    def geoms(self) -> tuple[Any, ...]: ...
    nflex: _Int
    ngeom: _Int
    nlight: _Int
    scale: _Float
    status: _Int

class MjrRect:
    def __init__(self, left: Int, bottom: Int, width: Int, height: Int) -> None: ...
    height: _Int
    left: _Int
    width: _Int

class MjrContext:
    def __init__(self, model: MjModel, fontscale: Int) -> None: ...
    def free(self) -> None: ...
