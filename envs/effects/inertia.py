"""Effects on what a body weighs and where, and on which way is down."""

from typing import Any, ClassVar, Literal, get_args

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect, Sizes
from envs.effects.bound import BoundEffect
from envs.effects.field import FieldEffect
from envs.effects.places import find, members
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.errors import EffectError, refuse_unknown
from envs.params import How

LIGHTEST = 1e-3  # kg: below this the engine's constants become ill conditioned
Inertia = Literal["kept", "scaled"]
INERTIA: tuple[Inertia, ...] = get_args(Inertia)


class _Dense(BoundEffect):
    """Scales the inertia of bodies by what another effect does to their mass."""

    def __init__(self, plant: PlantView, bodies: np.ndarray, mass: BoundEffect) -> None:
        self._mass, self._inertia = plant.field("body_mass"), plant.field("body_inertia")
        self._bodies, self._write = bodies, mass.write

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        at = (ids[:, None], self._bodies)
        before = self._mass[at]  # (n, k)
        self._write(ids, values)
        self._inertia[at] *= (self._mass[at] / before)[..., None]


class LinkMass(FieldEffect):
    """Mass of a body, at its centre of mass.

    Its inertia either stays the same (`inertia: kept`, a load near the centre) or scales with the
    mass (`scaled`, a different density).

    Args:
        inertia: `kept` or `scaled`.
    """

    name = "link_mass"
    place = "body"
    unit = "kg"
    hows: ClassVar[tuple[How, ...]] = ("add", "set", "scale")
    field = "body_mass"
    minimum = LIGHTEST
    constants = True
    comparable = True
    sizes = Sizes("mass", "mass", 0.02, 1.2)
    symptom = "static sag and lag under load that grow with gravity's lever arm"
    source = "MuJoCo XML reference, body/inertial/mass"
    experiment = "hold several poses with the link horizontal, then swing it slowly"

    def __init__(
        self,
        where: str | None = None,
        how: How | None = None,
        inertia: Inertia = "kept",
        **arguments: Any,
    ) -> None:
        super().__init__(where, how, **arguments)
        refuse_unknown(f"{self.label()}: inertia", inertia, INERTIA)
        self.inertia: Inertia = inertia

    def options(self) -> dict[str, Any]:
        """Return how the inertia follows the mass, unless it is kept."""
        return {} if self.inertia == "kept" else {"inertia": self.inertia}

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the mass of each row, and its inertia where that follows."""
        mass = super().bind(plant)
        if self.inertia == "kept":
            return mass
        return _Dense(plant, members(plant.model, "body", self.where), mass)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the link's mass and of the robot's."""
        own = float(scale.model.body_mass[scale.body(self.where)])
        parts = np.array([-0.3, -0.04, 0.04, 0.3]) * own  # a few per cent shift a whole motion
        return np.array([*parts, 0.1 * scale.mass, 0.4 * scale.mass])


class LinkInertia(FieldEffect):
    """Inertia of a body about its centre of mass, as a factor; its mass is unchanged."""

    name = "link_inertia"
    place = "body"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale",)
    field = "body_inertia"
    constants = True
    typical = (0.5, 2.0)
    symptom = "acceleration differs from what mass and lever arm predict; static sag does not"
    source = "MuJoCo XML reference, body/inertial/diaginertia; J = f J_cm + m r²"
    experiment = "fast swings of the last link about its own joint, then slow loaded holds"


def far_end(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Return the point of a body where the next one hangs, in its own frame [m], (3,).

    The farthest child's first joint; for a leaf the farthest site, or the farthest point of a geom
    along its long axis.

    Raises:
        EffectError: a body without children, sites and geoms away from its origin.
    """
    points = [
        model.body_pos[c] + _turned(model.body_quat[c], _anchor(model, c))
        for c in _children(model, body)
    ]
    if not points:
        points = [model.site_pos[i] for i in range(model.nsite) if model.site_bodyid[i] == body]
        points += [
            p for i in range(model.ngeom) if model.geom_bodyid[i] == body for p in _tips(model, i)
        ]
    if not points or max(np.linalg.norm(p) for p in points) < 1e-9:
        raise EffectError(
            f"body {model.body(body).name!r} has no child, site or geom at its far end; add a "
            f"site there"
        )
    return np.array(max(points, key=lambda p: float(np.linalg.norm(p))))


def _children(model: mujoco.MjModel, body: int) -> list[int]:
    return [c for c in range(1, model.nbody) if model.body_parentid[c] == body]


def _anchor(model: mujoco.MjModel, body: int) -> np.ndarray:
    return model.jnt_pos[model.body_jntadr[body]] if model.body_jntnum[body] else np.zeros(3)


def _turned(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, np.array(vector, dtype=np.float64), np.array(quat, dtype=np.float64))
    return out


def _tips(model: mujoco.MjModel, geom: int) -> list[np.ndarray]:
    """Return the ends of a geom on its long axis, and its centre, in the body's frame."""
    size, pos = model.geom_size[geom], model.geom_pos[geom]
    kind = int(model.geom_type[geom])
    box = kind in (int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID))
    if box:
        axis, half = int(np.argmax(size)), float(size.max())
    elif kind in (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)):
        axis, half = 2, float(size[1])
    else:  # a sphere or mesh: its centre
        return [pos]
    along = _turned(model.geom_quat[geom], half * np.eye(3)[axis])
    return [pos + along, pos - along]


class _Shift(BoundEffect):
    """Moves a centre of mass along a line."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._body = find(plant.model, "body", effect.where)
        end = far_end(plant.model, self._body)
        self._direction, self._ipos = end / np.linalg.norm(end), plant.field("body_ipos")

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self._ipos[ids, self._body] += values[:, :1] * self._direction


class CenterOfMass(Effect):
    """Shift of a body's centre of mass towards its child joint.

    Without a child joint the shift is towards the body's farthest geom or site. The inertia about
    the centre of mass is unchanged.
    """

    name = "center_of_mass"
    moves_mass = True
    engines = BOTH
    place = "body"
    unit = "m"
    constants = True
    composes = True
    typical = (-0.03, 0.03)
    no_mjcf = None
    comparable = True
    sizes = Sizes("signed", "length", 0.03, 1.2)
    symptom = "a pose-dependent sag, as with a wrong mass, but acceleration changes differently"
    source = "rigid-body dynamics"
    experiment = "torque-off swings, whose period separates inertia from gravity's lever arm"
    group = PLAIN
    law = _Shift

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError for a body without a far end."""
        far_end(model, find(model, "body", self.where))

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the link's length, both ways."""
        length = float(np.linalg.norm(far_end(scale.model, scale.body(self.where))))
        return np.array([-0.4, -0.12, -0.03, 0.03, 0.12, 0.4]) * length


class _Point(BoundEffect):
    """Adds a point mass to a body: mass, centre of mass and inertia follow."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._body = find(plant.model, "body", effect.where)
        self._point = far_end(plant.model, self._body)
        names = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
        self._mass, self._ipos, self._iquat, self._inertia = (plant.field(name) for name in names)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        loaded = values[:, 0] > 0
        if loaded.any():
            self._add(ids[loaded], values[loaded, 0])

    def _add(self, ids: np.ndarray, payload: np.ndarray) -> None:
        at = (ids, self._body)
        mass, center = self._mass[at], self._ipos[at]  # (n,), (n, 3)
        total = mass + payload
        new = (mass[:, None] * center + payload[:, None] * self._point) / total[:, None]
        axes = rotations(self._iquat[at])  # (n, 3, 3)
        tensor = axes @ (self._inertia[at][:, :, None] * axes.transpose(0, 2, 1))
        tensor += mass[:, None, None] * steiner(new - center)
        tensor += payload[:, None, None] * steiner(new - self._point)
        self._inertia[at], vectors = np.linalg.eigh(tensor)
        vectors[np.linalg.det(vectors) < 0, :, 2] *= -1  # right-handed
        self._iquat[at] = quaternions(vectors)
        self._mass[at], self._ipos[at] = total, new


def steiner(offset: np.ndarray) -> np.ndarray:
    """Return the inertia of unit masses at offsets (n, 3) [m], (n, 3, 3)."""
    square = (offset**2).sum(1)[:, None, None] * np.eye(3)
    return square - offset[:, :, None] * offset[:, None, :]


def rotations(quats: np.ndarray) -> np.ndarray:
    """Return the rotation matrices of unit quaternions (n, 4), (n, 3, 3)."""
    out = np.zeros((len(quats), 9))
    for matrix, quat in zip(out, np.ascontiguousarray(quats), strict=True):
        mujoco.mju_quat2Mat(matrix, quat)
    return out.reshape(-1, 3, 3)


def quaternions(matrices: np.ndarray) -> np.ndarray:
    """Return the unit quaternions of rotation matrices (n, 3, 3), (n, 4)."""
    out = np.zeros((len(matrices), 4))
    for quat, matrix in zip(out, matrices, strict=True):
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(matrix).reshape(9))
    return out


class Payload(Effect):
    """Point mass at a body's far end: its child joint, or a leaf's farthest geom or site."""

    name = "payload"
    moves_mass = True
    engines = BOTH
    place = "body"
    unit = "kg"
    constants = True
    composes = True
    typical = (0.0, 0.5)
    no_mjcf = None
    comparable = True
    sizes = Sizes("add", "mass", 0.01, 2.5)
    symptom = "more sag and slower swings, most of all at the joints that lift the body"
    source = "a point mass, by the parallel axis theorem"
    experiment = "holds with the arm stretched out, with and without the tool"
    group = PLAIN
    law = _Point
    limits = (0.0, np.inf)

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError for a body without a far end."""
        far_end(model, find(model, "body", self.where))

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return parts of the robot's mass."""
        return np.array([0.01, 0.03, 0.12, 0.4]) * scale.mass


class _Tilt(BoundEffect):
    """See `GravityTilt`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._gravity = plant.field("opt.gravity")  # (N, 3)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        x, y, z = self._gravity[ids].T
        (sa, sb), (ca, cb) = np.sin(values.T), np.cos(values.T)
        y, z = ca * y + sa * z, ca * z - sa * y  # undo the turn about x
        x, z = cb * x - sb * z, cb * z + sb * x  # then that about the new y
        self._gravity[ids] = np.stack([x, y, z], axis=1)


class GravityTilt(Effect):
    """Tilt of the base: a rotation about its x axis, then about its new y axis."""

    name = "gravity_tilt"
    engines = BOTH
    place = "robot"
    unit = "rad"
    composes = True
    typical = (-0.1, 0.1)
    no_mjcf = None
    sizes = Sizes("tilt", "one", 5e-3, 0.5)
    symptom = "constant errors that depend on the pose, as if gravity came from the side"
    source = "rotated gravity; tables are tilted by 1 to 5 degrees"
    experiment = "hold the same poses with the base turned by 180 degrees about the vertical"
    # a small turn about an axis along which gravity stays across the joints shows nothing
    first_values = ((0.06, 0.0), (-0.06, 0.0), (0.0, 0.06), (0.0, -0.06), (0.4, 0.0), (0.0, 0.4))
    group = PLAIN
    limits, components = (-np.pi / 2, np.pi / 2), ("x", "y")
    law = _Tilt
