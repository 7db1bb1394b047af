"""MuJoCo's compiled names carry no types; here are those that this project uses.

`tests/test_typings.py` compares them with the installed library.
"""

from typing import Any

from mujoco._enums import *
from mujoco._functions import *
from mujoco._render import *
from mujoco._specs import *
from mujoco._structs import *

__version__: str
sysid: Any  # packages with sources of their own
viewer: Any
mjMAXVAL: float
mjMINVAL: float
mjNGAIN: int
mjNGROUP: int

class FatalError(RuntimeError): ...
