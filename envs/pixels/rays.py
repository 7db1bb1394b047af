"""Images by rays: no graphics library, no screen, no texture units.

Rays are cast only where the robot can appear, by `mujoco.batch` on all its threads. Planes (the
floor) are intersected in closed form and get their texture, or chequers where they have none, so
that motion shows. Shading is Lambert's, by the camera's headlight and the model's directional
lights; there are no shadows and no reflections.
"""

from __future__ import annotations

import mujoco
import numpy as np

from envs.pixels.base import Renderer
from envs.pixels.camera import PinholeCamera, spheres
from envs.pixels.texture import Texture
from envs.simulation import Simulation

PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
UNPAINTED = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # a geom of this colour shows its material's
OVERHEAD = np.array([0.25, 0.33, 0.42], np.float32)  # the sky's colour
HORIZON = np.array([0.60, 0.67, 0.74], np.float32)
GRAZING = 1e-6  # least slope at which a ray meets a plane
GROUPS = 3  # geom groups 0 to 2 are drawn, as MuJoCo's mjv_defaultOption does


class RayRenderer(Renderer):
    """Draws by casting rays; see the module's text and `Renderer`."""

    def __init__(self, simulation: Simulation, size: int, camera: str | None = None) -> None:
        super().__init__(simulation, size, camera)
        model = self.model
        self._lens = PinholeCamera(float(model.cam_fovy[self.camera]), size)
        self._eyes, self._frames = self.watch("cam_xpos", "cam_xmat")  # (N, ncam, 3), (.., 9)
        self._places, self._turns = self.watch("geom_xpos", "geom_xmat")
        self._lights = self.watch("light_xdir")[0] if model.nlight else None  # (N, nlight, 3)
        shown = model.geom_group < GROUPS
        self._groups = (np.arange(mujoco.mjNGROUP) < GROUPS).astype(np.uint8)
        self._planes = np.flatnonzero((model.geom_type == PLANE) & shown)
        self._solids = np.flatnonzero((model.geom_type != PLANE) & shown)
        self._static = bool((model.body_weldid[model.geom_bodyid[self._solids]] == 0).any())
        self._owners, self._shifts, self._radii = spheres(model, self._solids)
        self._textures = [Texture(model, int(plane)) for plane in self._planes]

    def render(self, ids: np.ndarray | None) -> np.ndarray:
        """Draw the rows ids; see `Renderer.render`."""
        rows = np.arange(self.plant.num_rows) if ids is None else np.asarray(ids)
        view = _View(
            rows,
            self._eyes[rows, self.camera],
            self._frames[rows, self.camera].reshape(-1, 3, 3),
            self._lens,
        )
        light = self._light(rows)
        colours = self._colours(rows)
        image = view.sky()
        depth = np.full(image.shape[:2], np.inf, np.float32)  # (n, P) m along the ray
        for plane, texture in zip(self._planes, self._textures, strict=True):
            self._draw_plane(image, depth, view, int(plane), texture, colours, light)
        if self._solids.size:
            self._draw_solids(image, depth, view, colours, light)
        return image.reshape(-1, self.size, self.size, 3)

    def _colours(self, rows: np.ndarray) -> np.ndarray:
        """Return the colour of each geom in each row, (n, ngeom, 3) float32."""
        own = self.plant.field_values("geom_rgba", rows)
        material = self.model.geom_matid
        theirs = self.model.mat_rgba[np.maximum(material, 0)] if self.model.nmat else own
        unpainted = (own == UNPAINTED).all(-1) & (material >= 0)
        return np.where(unpainted[..., None], theirs, own)[..., :3].astype(np.float32)

    def _light(self, rows: np.ndarray) -> _Light:
        head, vision = self.model.vis.headlight, self.plant.field_values
        on = bool(head.active)
        ambient = np.tile(np.asarray(head.ambient if on else np.zeros(3)), (len(rows), 1))
        diffuse, toward = [], []
        if self._lights is not None:
            ambient = ambient + vision("light_ambient", rows).sum(1)
            for i in np.flatnonzero(self.model.light_active):
                diffuse.append(vision("light_diffuse", rows)[:, i].astype(np.float32))
                toward.append(-self._lights[rows, i].astype(np.float32))
        return _Light(
            ambient.astype(np.float32),
            np.asarray(head.diffuse if on else np.zeros(3), np.float32),
            diffuse,
            toward,
        )

    def _draw_plane(
        self,
        image: np.ndarray,
        depth: np.ndarray,
        view: _View,
        plane: int,
        texture: Texture,
        colours: np.ndarray,
        light: _Light,
    ) -> None:
        """Draw an infinite plane from the side that its normal points to."""
        turn = self._turns[view.rows, plane].reshape(-1, 3, 3).astype(np.float32)
        eye = view.eye - self._places[view.rows, plane].astype(np.float32)
        eye = np.einsum("nij,ni->nj", turn, eye)[:, None]  # (n, 1, 3) in the plane's frame
        one = view.shared and bool((turn == turn[0]).all())
        rays = np.einsum("npi,nij->npj", view.rays, turn[:1] if one else turn)  # (1 or n, P, 3)
        meets = (rays[..., 2] < -GRAZING) & (eye[..., 2] > 0)  # (n, P)
        columns = np.flatnonzero(meets.any(0))
        if not columns.size:
            return
        part = slice(columns[0], columns[-1] + 1)
        rays, meets = rays[:, part], meets[:, part]
        steep = 1.0 / np.maximum(-rays[..., 2], GRAZING)
        far = eye[..., 2] * steep
        x = eye[..., 0] + eye[..., 2] * (rays[..., 0] * steep)
        y = eye[..., 1] + eye[..., 2] * (rays[..., 1] * steep)
        seen = texture.colour(x, y, far * steep * (2 * view.lens.half / self.size))
        seen *= light.on_plane(turn[:, :, 2], -rays[..., 2]) * colours[:, None, plane] * 255.0
        np.minimum(seen, 255.0, out=seen)
        meets &= far < depth[:, part]
        if meets.all():
            depth[:, part], image[:, part] = far, seen.astype(np.uint8)
        else:
            np.copyto(depth[:, part], far, where=meets)
            np.copyto(image[:, part], seen.astype(np.uint8), where=meets[..., None])

    def _draw_solids(
        self, image: np.ndarray, depth: np.ndarray, view: _View, colours: np.ndarray, light: _Light
    ) -> None:
        """Cast rays in the window of each image where geoms other than planes may appear."""
        turn = self._turns[view.rows][:, self._solids]  # (n, G, 9)
        at = self._places[view.rows][:, self._solids][:, self._owners]
        at = at + self._shifts[:, None] * turn[:, self._owners][..., [2, 5, 8]]
        at = np.einsum("nki,nij->nkj", at - view.eye[:, None], view.frame)  # the camera's frame
        top, left, height, width = view.lens.window(at, self._radii)
        down, across = np.arange(height)[:, None], np.arange(width)[None, :]
        pixel = (top[:, None, None] + down) * self.size + left[:, None, None] + across
        pixel = pixel.reshape(len(top), -1)  # (n, h·w)
        own = np.arange(len(view.rays))[:, None]
        rays = view.rays[own if not view.shared else 0, pixel]
        far, geom, normal = self.plant.batch.ray(
            view.eye[:, None].astype(np.float64),
            rays.astype(np.float64),
            geomgroup=self._groups,
            flg_static=self._static,
            ids=view.rows,
            normal=True,
        )
        row, k = np.nonzero((geom >= 0) & (far >= 0))
        hit, ray = geom[row, k], rays[row, k]
        at_pixel = pixel[row, k]
        keep = (self.model.geom_type[hit] != PLANE) & (far[row, k] < depth[row, at_pixel])
        row, k, hit, ray, at_pixel = row[keep], k[keep], hit[keep], ray[keep], at_pixel[keep]
        facing = normal[row, k].astype(np.float32)
        cosine = -np.einsum("ki,ki->k", facing, ray)
        shade = light.at(facing, np.abs(cosine), row)
        lit = np.minimum(colours[row, hit] * shade * 255.0, 255.0)
        image[row, at_pixel] = lit.astype(np.uint8)


class _View:
    """The cameras of n rows and the rays through their pixels, in the world's frame."""

    def __init__(
        self, rows: np.ndarray, eye: np.ndarray, frame: np.ndarray, lens: PinholeCamera
    ) -> None:
        self.rows, self.lens = rows, lens
        self.eye, self.frame = eye.astype(np.float32), frame.astype(np.float32)
        self.shared = bool((self.frame == self.frame[0]).all())  # all cameras look the same way
        local = lens.rays.reshape(-1, 3).astype(np.float32)
        frames = self.frame[:1] if self.shared else self.frame
        self.rays = np.einsum("pi,nji->npj", local, frames)  # (1 or n, P, 3)

    def sky(self) -> np.ndarray:
        """Return images (n, P, 3) uint8 of nothing but sky, darker overhead."""
        up = np.clip(self.rays[..., 2:], 0.0, 1.0)
        sky = HORIZON + up * (OVERHEAD - HORIZON)
        return np.repeat((255 * sky).astype(np.uint8), len(self.rows) // len(sky), axis=0)


class _Light:
    """Light that falls on surfaces in n rows.

    Args:
        ambient: (n, 3), from everywhere.
        head: (3,), from the camera.
        diffuse: (n, 3) of each directional light.
        toward: (n, 3) unit vectors to each directional light.
    """

    def __init__(
        self,
        ambient: np.ndarray,
        head: np.ndarray,
        diffuse: list[np.ndarray],
        toward: list[np.ndarray],
    ) -> None:
        self._ambient, self._head = ambient, head
        self._diffuse, self._toward = diffuse, toward

    def on_plane(self, normal: np.ndarray, facing: np.ndarray) -> np.ndarray:
        """Return the light on surfaces of one normal a row (n, 3), (n, P, 3).

        Args:
            normal: unit, (n, 3).
            facing: cosine of the angle between it and the ways to the camera, (1 or n, P).
        """
        constant = self._ambient.copy()
        for diffuse, toward in zip(self._diffuse, self._toward, strict=True):
            constant += diffuse * np.maximum((normal * toward).sum(1), 0)[:, None]
        return constant[:, None] + self._head * facing[..., None]

    def at(self, normal: np.ndarray, facing: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Return the light on k points (k, 3) of normals (k, 3)."""
        shade = self._ambient[row] + self._head * facing[:, None]
        for diffuse, toward in zip(self._diffuse, self._toward, strict=True):
            shade += diffuse[row] * np.maximum((normal * toward[row]).sum(1), 0)[:, None]
        return shade
