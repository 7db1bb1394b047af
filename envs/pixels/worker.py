"""A process that draws some of the rows by OpenGL; `envs.pixels.gl` starts it and talks to it.

    python -m envs.pixels.worker LIBRARY FOLDER ROWS SIZE CAMERA [FIELD ...]

It reads row numbers (int64: their count, then each) from its input, draws those rows into the image
file of the folder, and answers with one byte.
"""

import importlib
import logging
import sys
from pathlib import Path

import mujoco
import numpy as np

READY = b"."
STATE = ("qpos", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")  # what a row's data says
LOOKS = ("geom_rgba", "mat_rgba", "light_diffuse", "light_ambient")  # what its model says
COSTLY = (  # drawn only by graphics hardware in useful time
    mujoco.mjtRndFlag.mjRND_SHADOW,
    mujoco.mjtRndFlag.mjRND_REFLECTION,
    mujoco.mjtRndFlag.mjRND_SKYBOX,
    mujoco.mjtRndFlag.mjRND_HAZE,
)
SLICES, STACKS, QUADS = 8, 4, 1  # how finely round things and planes are drawn
MAX_GEOMS = 2000


def map_array(
    folder: Path, name: str, shape: tuple[int, ...], dtype: type | None, new: bool = True
) -> np.ndarray:
    """Return an array that lives in a file of the folder; dtype None stands for float64."""
    mode = "w+" if new else "r+"
    return np.memmap(folder / name, dtype or np.float64, mode, shape=shape)


class Painter:
    """Draws states of one model.

    Args:
        library: "egl" or "osmesa".
        model: its settings of quality are lowered.
        size: the side of the square images [px].
        camera: id of the camera.
    """

    def __init__(self, library: str, model: mujoco.MjModel, size: int, camera: int) -> None:
        logging.getLogger("OpenGL").setLevel(logging.WARNING)
        vision = model.vis
        vision.quality.offsamples = vision.quality.shadowsize = 0
        vision.quality.numslices, vision.quality.numstacks = SLICES, STACKS
        vision.quality.numquads = QUADS
        vision.global_.offwidth = vision.global_.offheight = size
        self._gl = importlib.import_module(f"mujoco.{library}").GLContext(size, size)
        self._gl.make_current()
        self._scene = mujoco.MjvScene(model, maxgeom=MAX_GEOMS)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        for flag in COSTLY:
            self._scene.flags[flag.value] = False
        self._view, self._option = mujoco.MjvCamera(), mujoco.MjvOption()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FIXED.value  # type: ignore[assignment]
        self._view.fixedcamid = camera
        self._frame = mujoco.MjrRect(0, 0, size, size)
        self._model, self._data = model, mujoco.MjData(model)
        self._pixels = np.empty((size, size, 3), np.uint8)

    def draw(self, state: dict[str, np.ndarray], out: np.ndarray) -> None:
        """Draw a row's state into out, (size, size, 3) uint8, row 0 on top."""
        model, data = self._model, self._data
        data.qpos[:] = state["qpos"]
        mujoco.mj_kinematics(model, data)
        for name, values in state.items():  # cameras and lights are where the row has them
            getattr(data, name)[:] = values
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._view, every, self._scene)
        mujoco.mjr_render(self._frame, self._scene, self._context)
        mujoco.mjr_readPixels(self._pixels, None, self._frame, self._context)
        out[:] = self._pixels[::-1]


def serve(library: str, folder: Path, rows: int, size: int, camera: int, looks: list[str]) -> None:
    """Draw what is asked for until the input ends."""
    model = mujoco.MjModel.from_binary_path(str(folder / "model.mjb"))
    painter = Painter(library, model, size, camera)
    image = map_array(folder, "image", (rows, size, size, 3), np.uint8, new=False)
    data = mujoco.MjData(model)
    state, fields = (
        {
            name: map_array(folder, name, (rows, *np.shape(getattr(of, name))), None, new=False)
            for name in names
        }
        for of, names in ((data, [n for n in STATE if np.size(getattr(data, n))]), (model, looks))
    )
    read, answer = sys.stdin.buffer.read, sys.stdout.buffer
    answer.write(READY)
    answer.flush()
    while count := read(8):
        for row in np.frombuffer(read(8 * int(np.frombuffer(count, np.int64)[0])), np.int64):
            for name, values in fields.items():
                getattr(model, name)[:] = values[row]
            painter.draw({name: values[row] for name, values in state.items()}, image[row])
        answer.write(READY)
        answer.flush()


if __name__ == "__main__":
    rows, size, camera = map(int, sys.argv[3:6])
    serve(sys.argv[1], Path(sys.argv[2]), rows, size, camera, sys.argv[6:])
