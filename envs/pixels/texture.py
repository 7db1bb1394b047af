"""The pattern of a plane, so that a camera that moves along with the robot sees it move."""

import mujoco
import numpy as np

CHEQUERS = np.array([[0.35, 0.65], [0.65, 0.35]], np.float32)  # where a plane has no texture
PERIOD = 1.0  # m, of those chequers
COLOUR = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)


class Texture:
    """A repeating image on a plane.

    Args:
        model: the robot's model.
        plane: id of a plane geom.
    """

    def __init__(self, model: mujoco.MjModel, plane: int) -> None:
        picture, repeat = _image(model, int(model.geom_matid[plane]))
        size = model.geom_size[plane, :2].copy()
        size[size <= 0] = PERIOD  # an infinite plane: one repeat a metre
        painted = model.geom_matid[plane] >= 0
        self._per_metre = (repeat / (2 * size) if painted else np.full(2, 1 / PERIOD)).astype(
            np.float32
        )
        self._shape = picture.shape[:2]
        self._mean = picture.mean((0, 1))
        self._contrast = (picture - self._mean).reshape(-1, 3)  # (h·w, 3)

    def colour(self, x: np.ndarray, y: np.ndarray, footprint: np.ndarray) -> np.ndarray:
        """Return the pattern at points of the plane, (n, P, 3) float32.

        Args:
            x: in the plane's own frame [m], (n, P).
            y: likewise.
            footprint: what a pixel covers there [m], (n, P); a pattern finer than that fades to its
                mean instead of flickering.
        """
        height, width = self._shape
        column, row = x * self._per_metre[0] + 0.5, y * self._per_metre[1] + 0.5
        for part, size in ((column, width), (row, height)):
            part -= np.floor(part)
            part *= size
        texel = np.minimum(row.astype(np.int32), height - 1)
        texel *= width
        texel += np.minimum(column.astype(np.int32), width - 1)
        seen = np.take(self._contrast, texel, axis=0)
        footprint *= -4.0 * self._per_metre.max()
        footprint += 2.0
        seen *= np.clip(footprint, 0.0, 1.0, out=footprint)[..., None]
        seen += self._mean
        return seen


def _image(model: mujoco.MjModel, material: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the picture of a material as floats in [0, 1], and how often it repeats on a geom."""
    if material >= 0:
        texture = int(model.mat_texid[material, COLOUR])
        if texture >= 0 and model.tex_type[texture] == int(mujoco.mjtTexture.mjTEXTURE_2D):
            height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
            channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
            data = model.tex_data[start : start + height * width * channels]
            picture = data.reshape(height, width, channels)[..., :3].astype(np.float32) / 255
            return picture, model.mat_texrepeat[material].copy()
    return np.repeat(CHEQUERS[..., None], 3, axis=-1), np.ones(2)
