"""A camera that draws simulations off screen, and films made of its pictures.

    with Camera(model, 320, 240, name=None) as camera:
        frames = np.stack([camera.draw(model, data) for data in states])
    write_mp4(Path("film.mp4"), frames, fps=25)

Drawing needs a system library, EGL or OSMesa. Without any, `RenderError` says what to install.
"""

from __future__ import annotations

import importlib
import logging
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torchrl  # noqa: F401 - must be imported before any GL context exists, else the process dies

from envs.errors import RenderError
from envs.pixels.library import INSTALL, library
from hardware.files import atomic_write


def _context(width: int, height: int) -> Any:
    """Make a GL context and the current one."""
    logging.getLogger("OpenGL").setLevel(logging.WARNING)  # it warns of missing accelerators
    try:
        context = importlib.import_module(f"mujoco.{library()}").GLContext(width, height)
        context.make_current()
    except (ImportError, AttributeError, RuntimeError) as error:  # as PyOpenGL and drivers fail
        raise RenderError(
            f"{library()} cannot create a context in this process ({error}); {INSTALL}"
        ) from error
    return context


class Camera:
    """Draws simulations of one model into images.

    Args:
        model: a model of the robot; its off-screen buffer may be smaller than the image.
        width: the width of the image [px].
        height: the height of the image [px].
        name: a camera of the model, or None for a free one.

    Raises:
        RenderError: when nothing can be drawn on this machine.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, name: str | None) -> None:
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._gl = _context(width, height)
        self._scene = mujoco.MjvScene(model, maxgeom=2000)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        for costly in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[costly.value] = False  # 3 times as fast where the CPU draws
        self._size = mujoco.MjrRect(0, 0, width, height)
        self._view = mujoco.MjvCamera()
        if name is None:
            mujoco.mjv_defaultFreeCamera(model, self._view)
        else:
            self._view.type = mujoco.mjtCamera.mjCAMERA_FIXED.value  # type: ignore[assignment]
            self._view.fixedcamid = model.camera(name).id
        self._option = mujoco.MjvOption()

    def draw(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Return a picture, (height, width, 3) uint8."""
        self._gl.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._view, everything, self._scene)
        mujoco.mjr_render(self._size, self._scene, self._context)
        pixels = np.empty((self._size.height, self._size.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._size, self._context)
        return pixels[::-1]

    def close(self) -> None:
        """Free what the graphics library holds."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def __enter__(self) -> Camera:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close it."""
        self.close()


def write_mp4(path: Path, frames: np.ndarray, fps: int) -> None:
    """Write pictures (n, height, width, 3) uint8 of even size as H.264, atomically.

    Raises:
        RenderError: without an encoder, or when it fails.
    """
    try:
        from imageio_ffmpeg import write_frames
    except ImportError:
        raise RenderError("no video encoder: pip install imageio-ffmpeg") from None
    with atomic_write(path) as temporary:
        size = frames.shape[2:0:-1]
        writer = write_frames(
            str(temporary), size, fps=fps, macro_block_size=2, ffmpeg_log_level="error"
        )
        try:
            writer.send(None)
            for frame in frames:
                writer.send(np.ascontiguousarray(frame))
        except OSError as error:
            raise RenderError(f"the encoder failed on {path}: {error}") from error
        finally:
            writer.close()
        if not (temporary.is_file() and temporary.stat().st_size):
            raise RenderError(f"the encoder wrote nothing to {path}; is the disk full?")
