"""Find the graphics library that draws off screen on this machine.

Each is tried in a separate process, since a broken one can take its process with it.
"""

import os
import subprocess
import sys
from functools import cache

from envs.errors import RenderError

LIBRARIES = ("egl", "osmesa")
INSTALL = "install a software renderer, as root: apt-get install libegl1 libgl1-mesa-dri"
OFF = ("disable", "disabled", "off", "false", "0")  # as MuJoCo reads MUJOCO_GL
PATIENCE = 60  # s for a library to make a context


@cache
def library() -> str:
    """Return the GL library that works here, "egl" or "osmesa"; MUJOCO_GL may choose it.

    Raises:
        RenderError: if none does.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower()
    if asked in OFF:
        raise RenderError(f"MUJOCO_GL={asked} turns drawing off; unset it, or set egl or osmesa")
    candidates = (asked,) if asked in LIBRARIES else LIBRARIES
    for name in candidates:
        if _works(name):
            return name
    raise RenderError(f"off screen, {' and '.join(candidates)} do not work here; {INSTALL}")


def _works(name: str) -> bool:
    """Return whether a context of that library can be made, asking another process."""
    code = f"from mujoco.{name} import GLContext as C; c = C(8, 8); c.make_current(); c.free()"
    environment = os.environ | {"MUJOCO_GL": name, "PYOPENGL_PLATFORM": name}
    try:
        command = [sys.executable, "-c", code]
        ended = subprocess.run(command, env=environment, capture_output=True, timeout=PATIENCE)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return ended.returncode == 0
