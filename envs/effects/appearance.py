"""Effects on what a camera sees, and on nothing that moves.

They belong to the same parameter space as the physical ones: an episode draws its colours, its
light and where the camera stands as it draws masses and frictions.
"""

from typing import ClassVar, Literal

import mujoco
import numpy as np

from envs.effects.base import BOTH, Effect
from envs.effects.bound import BoundEffect
from envs.effects.inertia import rotations
from envs.effects.places import find
from envs.effects.plant_view import PlantView
from envs.errors import EffectError

BOARD = "a photograph of a calibration board by the robot's camera, against a rendered image"
UNPAINTED = np.array([0.5, 0.5, 0.5, 1.0])  # a geom of this colour shows its material's


class Appearance(Effect):
    """An effect that a camera sees, while the physics stays as it is to the last bit."""

    visible_in_replay = False
    no_mjcf = "it changes images, not how the robot moves"
    symptom = "none in a log; only images change"
    source = "appearance randomization, Tobin et al. 2017"
    experiment = "photographs of the robot at several times of the day"
    part: ClassVar[Literal["light", "camera"]]  # what the model must have

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError for a model without such a part."""
        if not {"light": model.nlight, "camera": model.ncam}[self.part]:
            raise EffectError(f"the model has no {self.part}; add one to its MJCF")


class Colour(Appearance):
    """Colour offset of a body's geoms, as a fraction of full brightness; `world` is the floor."""

    name = "colour"
    engines = BOTH
    place = "body"
    unit = "1"
    composes = True
    typical = (-0.3, 0.3)
    experiment = "a photograph of the body in the light in which the policy will run"
    limits, components = (-1.0, 1.0), ("red", "green", "blue")

    def check(self, model: mujoco.MjModel) -> None:
        """Raise EffectError for a body without geoms."""
        self._geoms(model)

    def _geoms(self, model: mujoco.MjModel) -> np.ndarray:
        body = find(model, "body", self.where)
        geoms = np.flatnonzero(model.geom_bodyid == body)
        if not geoms.size:
            raise EffectError(f"body {self.where!r} has no geom whose colour could change")
        return geoms

    def bind(self, plant: PlantView) -> BoundEffect:
        """Write the colours of each row."""
        return _Paint(plant, self._geoms(plant.model))


class _Paint(BoundEffect):
    def __init__(self, plant: PlantView, geoms: np.ndarray) -> None:
        self._rgba, self._geoms = plant.field("geom_rgba"), geoms  # (N, ngeom, 4), (G,)
        model = plant.model
        self._shown = model.geom_rgba[geoms].copy()  # (G, 4)
        for k, geom in enumerate(geoms):
            material = model.geom_matid[geom]
            if material >= 0 and (self._shown[k] == UNPAINTED).all():
                self._shown[k] = model.mat_rgba[material]

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        painted = values.any(axis=1)
        ids, values = ids[painted], values[painted]
        if len(ids):
            at = (ids[:, None], self._geoms)
            own = self._rgba[at]
            base = np.where((own == UNPAINTED).all(-1, keepdims=True), self._shown, own)
            base[..., :3] = np.clip(base[..., :3] + values[:, None, :], 0.0, 1.0)
            self._rgba[at] = base


class _Dimmer(BoundEffect):
    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._fields = [plant.field(name) for name in ("light_diffuse", "light_ambient")]

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        for field in self._fields:
            field[ids] *= values[:, :1, None]


class LightLevel(Appearance):
    """Brightness of all lights of the model, as a factor, except the headlight."""

    name = "light_level"
    engines = BOTH
    place = "robot"
    hows = ("scale",)
    unit = "factor"
    composes = True
    typical = (0.5, 1.5)
    limits = (0.0, 10.0)
    part = "light"
    law = _Dimmer


class _Beam(BoundEffect):
    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._direction = plant.field("light_dir")  # (N, nlight, 3)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        turned = values.any(axis=1)
        ids, values = ids[turned], values[turned]
        if len(ids):
            turns = _about(1, values[:, 1]) @ _about(0, values[:, 0])
            self._direction[ids] = self._direction[ids] @ turns.transpose(0, 2, 1)


class LightDirection(Appearance):
    """Rotation of the lights about the world's x axis, then its y axis."""

    name = "light_direction"
    engines = BOTH
    place = "robot"
    unit = "rad"
    constants = True
    typical = (-0.5, 0.5)
    limits = (-np.pi, np.pi)
    components = ("x", "y")
    part = "light"
    law = _Beam


class _Stand(BoundEffect):
    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._position = plant.field("cam_pos")  # (N, ncam, 3)
        self._axes = rotations(plant.model.cam_quat)  # (ncam, 3, 3), columns: right, up, back

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self._position[ids] += np.einsum("cij,nj->nci", self._axes, values)


class CameraShift(Appearance):
    """Offset of the cameras along their own axes: to the right, up and back."""

    name = "camera_shift"
    engines = BOTH
    place = "robot"
    unit = "m"
    constants = True
    composes = True
    typical = (-0.2, 0.2)
    components = ("right", "up", "back")
    experiment = BOARD
    part = "camera"
    law = _Stand


class _Aim(BoundEffect):
    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._quat = plant.field("cam_quat")  # (N, ncam, 4)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        for row, (right, up) in zip(ids, values, strict=True):
            if not (right or up):
                continue
            turn = np.zeros(4)  # about the camera's own y, then its new x
            mujoco.mju_euler2Quat(turn, np.array([-right, up, 0.0]), "yxz")
            for camera in range(self._quat.shape[1]):
                own = self._quat[row, camera].copy()
                mujoco.mju_mulQuat(self._quat[row, camera], own, turn)


class CameraTurn(Appearance):
    """Rotation of the cameras' view: to the right, then up."""

    name = "camera_turn"
    engines = BOTH
    place = "robot"
    unit = "rad"
    constants = True
    typical = (-0.1, 0.1)
    limits = (-np.pi, np.pi)
    components = ("right", "up")
    experiment = BOARD
    part = "camera"
    law = _Aim


def _about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Return rotations by angles (n,) about one of the axes, (n, 3, 3)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i], turn[:, i, j] = np.sin(angle), -np.sin(angle)
    return turn
