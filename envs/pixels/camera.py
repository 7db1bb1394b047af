"""A camera's rays, and the projection of points into its image."""

import mujoco
import numpy as np

CAPSULE = (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))
NEAR = 1e-3  # m: what is closer than this to the camera's plane fills the image


class PinholeCamera:
    """A perspective camera with square pixels, looking along its own -z.

    Args:
        fovy: vertical field of view [degrees].
        size: the side of the square image [px].
    """

    def __init__(self, fovy: float, size: int) -> None:
        self.size = size
        self.half = float(np.tan(np.deg2rad(fovy) / 2))  # of the image, at distance 1
        at = ((np.arange(size) + 0.5) / size * 2 - 1) * self.half
        x, y = np.meshgrid(at, -at)
        rays = np.stack([x, y, -np.ones_like(x)], axis=-1)
        self.rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)  # (S, S, 3), unit

    def window(
        self, centers: np.ndarray, radii: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int, int]:
        """Return the part of each image in which spheres appear.

        Args:
            centers: in the camera's frame [m], (n, K, 3).
            radii: (K,) [m].

        Returns:
            top, left: (n,) first row and column; height, width: of all the windows alike.
        """
        depth = -centers[..., 2] - radii  # (n, K), of the nearest point
        behind = -centers[..., 2] + radii < NEAR
        close = ~behind & (depth < NEAR)
        scale = self.size / 2 / (np.maximum(depth, NEAR) * self.half)
        far = self.size / 2 / (np.maximum(depth + 2 * radii, NEAR) * self.half)
        bounds = []
        for axis, sign in ((1, -1.0), (0, 1.0)):
            low, high = sign * centers[..., axis] - radii, sign * centers[..., axis] + radii
            first = np.minimum(low * scale, low * far) + self.size / 2  # (n, K) px
            last = np.maximum(high * scale, high * far) + self.size / 2
            first = np.where(behind, np.inf, np.where(close, 0, first)).min(axis=1)
            last = np.where(behind, -np.inf, np.where(close, self.size, last)).max(axis=1)
            first = np.clip(np.floor(first) - 1, 0, self.size)
            last = np.clip(np.ceil(last) + 1, 0, self.size)
            extent = int(max(1, (last - first).max(initial=1)))
            bounds.append((np.minimum(first, self.size - extent).astype(int), extent))
        (top, height), (left, width) = bounds
        return top, left, height, width


def spheres(model: mujoco.MjModel, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return spheres whose hull holds the geoms.

    A capsule or cylinder has one at each end, anything else its bounding sphere.

    Returns:
        owner: (K,) index into geoms; shift: (K,) [m] along the geom's own z; radius: (K,) [m].
    """
    owner, shift, radius = [], [], []
    for i, geom in enumerate(geoms):
        size, kind = model.geom_size[geom], int(model.geom_type[geom])
        ends = (size[1], -size[1]) if kind in CAPSULE else (0.0,)
        bound = size[0] if kind == CAPSULE[0] else model.geom_rbound[geom]
        for end in ends:
            owner.append(i)
            shift.append(end)
            radius.append(bound)
    return np.array(owner, int), np.array(shift, float), np.array(radius, float)
