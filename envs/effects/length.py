"""The length of a link: its mass, shapes and children stretched along it.

make("link_length", where="pole")      # a factor; 2 is twice as long, as heavy as before
"""

from collections.abc import Sequence
from typing import ClassVar

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect
from envs.effects.bound import BoundEffect
from envs.effects.inertia import far_end, quaternions, rotations
from envs.effects.places import find
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.errors import EffectError
from envs.params import How

ALONG = 0.999  # cosine: an axis of a shape this near to the link's lies along it
ROUND = (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))
FLAT = (int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID))
SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)


class _Stretch(BoundEffect):
    """Maps every point x of a body to a + (1 + (f - 1) d dᵀ) (x - a)."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        model = plant.model
        self._body = body = find(model, "body", effect.where)
        self._anchor, self._direction = line(model, body)
        self._children = np.flatnonzero(model.body_parentid == body)
        self._children = self._children[self._children != body]
        self._geoms = np.flatnonzero(model.geom_bodyid == body)
        self._sites = np.flatnonzero(model.site_bodyid == body)
        self._sizes = sizes(model, self._geoms, self._direction)
        names = ("body_mass", "body_ipos", "body_iquat", "body_inertia", "body_pos")
        self._mass, self._ipos, self._iquat, self._inertia, self._pos = map(plant.field, names)
        names = ("geom_pos", "geom_size", "geom_rbound", "geom_aabb", "site_pos")
        self._geom, self._size, self._bound, self._box, self._site = map(plant.field, names)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        changed = values[:, 0] != 1.0
        if changed.any():
            self._stretch(ids[changed], values[changed, 0])

    def _stretch(self, ids: np.ndarray, factor: np.ndarray) -> None:
        for field, places in (
            (self._pos, self._children),
            (self._geom, self._geoms),
            (self._site, self._sites),
        ):
            if len(places):
                at = (ids[:, None], places)
                field[at] = self._moved(field[at], factor)
        if len(self._geoms):
            larger = np.maximum(factor, 1.0)[:, None]
            self._bound[ids[:, None], self._geoms] *= larger
            self._box[ids[:, None], self._geoms] *= larger[..., None]
        for geom, column in self._sizes:
            self._size[ids, geom, column] *= factor
        self._turn_inertia(ids, factor)
        center = (ids[:, None], np.array([self._body]))
        self._ipos[center] = self._moved(self._ipos[center], factor)

    def _moved(self, points: np.ndarray, factor: np.ndarray) -> np.ndarray:
        """Return points (n, k, 3) after stretching by factors (n,)."""
        along = (points - self._anchor) @ self._direction  # (n, k)
        return points + ((factor - 1.0)[:, None] * along)[..., None] * self._direction

    def _turn_inertia(self, ids: np.ndarray, factor: np.ndarray) -> None:
        """Stretch the second moments of the mass, from which its inertia follows."""
        at = (ids, self._body)
        axes = rotations(self._iquat[at])  # (n, 3, 3)
        tensor = axes @ (self._inertia[at][:, :, None] * axes.transpose(0, 2, 1))
        half = np.trace(tensor, axis1=1, axis2=2)[:, None, None] / 2
        outer = np.outer(self._direction, self._direction)
        stretch = np.eye(3) + (factor - 1.0)[:, None, None] * outer
        moments = stretch @ (half * np.eye(3) - tensor) @ stretch  # (n, 3, 3)
        tensor = np.trace(moments, axis1=1, axis2=2)[:, None, None] * np.eye(3) - moments
        self._inertia[at], vectors = np.linalg.eigh(tensor)
        vectors[np.linalg.det(vectors) < 0, :, 2] *= -1  # right-handed
        self._iquat[at] = quaternions(vectors)


def line(model: mujoco.MjModel, body: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a body's anchor, its first joint or origin, and the direction to its far end."""
    first = model.body_jntadr[body]
    anchor = model.jnt_pos[first].copy() if first >= 0 else np.zeros(3)
    way = far_end(model, body) - anchor
    length = np.linalg.norm(way)
    if length == 0.0:
        raise EffectError(f"body {model.body(body).name!r} ends at its joint, so it has no length")
    return anchor, way / length


def sizes(
    model: mujoco.MjModel, geoms: Sequence[int] | np.ndarray, direction: np.ndarray
) -> list[tuple[int, int]]:
    """Return which entries of which shapes' sizes grow with the link.

    Raises:
        EffectError: a shape that collides and would become one that the engine does not have.
    """
    found = []
    for geom in map(int, geoms):
        axes = rotations(model.geom_quat[[geom]])[0].T  # rows: the shape's own axes
        along = np.abs(axes @ direction) > ALONG
        kind = int(model.geom_type[geom])
        if kind in ROUND and along[2]:
            found.append((geom, 1))
        elif kind in FLAT and along.any():
            found.append((geom, int(along.argmax())))
        elif kind != SPHERE and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            name = model.geom(geom).name or f"{geom}"
            body = model.body(int(model.geom_bodyid[geom])).name
            raise EffectError(
                f"link_length.{body}: geom {name} collides and does not lie along the link; only a "
                "sphere, or a capsule, cylinder, box or ellipsoid along it, can be stretched"
            )
    return found


class LinkLength(Effect):
    """Length of a link from its joint to its far end, as a factor; its mass is unchanged.

    Centre of mass, inertia, shapes and child joints follow as if the link were stretched. Diagnoses
    do not try it.
    """

    name = "link_length"
    moves_mass = True
    engines = BOTH
    place = "body"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale",)
    constants = True
    composes = True
    typical = (0.8, 1.25)
    no_mjcf = "it stretches a whole body; change the body's own element"
    symptom = "slower swings and heavier loads, as with a longer lever"
    source = "affine map of the mass: second moments S -> A S A, inertia tr(S) 1 - S"
    experiment = "free swings of the link, whose period shows its length"
    group = PLAIN
    limits = (1e-3, np.inf)
    law = _Stretch

    @classmethod
    def places(cls, scale: RobotScale) -> list[str | None]:
        """Return nowhere."""
        return []

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError for a body that has no length."""
        body = find(model, "body", self.where)
        _, direction = line(model, body)
        sizes(model, np.flatnonzero(model.geom_bodyid == body), direction)
