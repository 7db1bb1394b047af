"""A robot with a free base on flat ground, moved by Drake: bodies, feet, contact, integration.

    ground = Ground(floating(model), feet_of(model), armature, step=0.0005, friction=0.8)
    ground.stand(q, height=0.144)
    q, v = ground.step(torque)                      # (n,) each, in the order of tree.names
    place, quaternion, gyro = ground.base()         # m, w x y z, rad/s along its own axes

Feet are spheres against a half-space: point contact with a linear spring, damping that grows with
the depth (Hunt and Crossley, J. Appl. Mech. 42 (2), 1975) and Coulomb friction, in discrete steps.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from sim2real.exam.thirdparty.engines import Drake, load_drake
from sim2real.exam.thirdparty.tree import Link, Tree, read_tree
from sim2real.runs.errors import Sim2RealError

STIFFNESS = 15_000.0  # N/m of a foot: two of a robot of a kilogram give by 0.3 mm
DISSIPATION = 1.0  # s/m of the same


class Foot(NamedTuple):
    """A sphere that touches the ground."""

    body: str
    place: np.ndarray  # in the body's frame [m], (3,)
    radius: float  # m


def floating(spec: mujoco.MjSpec) -> Tree:
    """Return the bodies of a robot with a free base, whose frame is at the origin.

    Raises:
        Sim2RealError: the first body is not free.
    """
    spec = spec.copy()
    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    if len(free) != 1:
        raise Sim2RealError(
            f"{len(free)} free joints; expected one, at the base of a walking robot"
        )
    for key in list(spec.keys):
        spec.delete(key)
    spec.delete(free[0])
    return read_tree(spec.compile())


def feet_of(model: mujoco.MjModel) -> list[Foot]:
    """Return the spheres of a model that collide."""
    spheres = [
        i
        for i in range(model.ngeom)
        if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_SPHERE and model.geom_contype[i]
    ]
    return [
        Foot(
            model.body(int(model.geom_bodyid[i])).name,
            np.array(model.geom_pos[i]),
            float(model.geom_size[i, 0]),
        )
        for i in spheres
    ]


class Ground(Drake):
    """Drake's MultibodyPlant with a free base; see the module."""

    def __init__(
        self,
        tree: Tree,
        feet: Sequence[Foot],
        armature: Mapping[str, float],
        step: float,
        friction: float,
    ) -> None:
        drake = load_drake()
        from pydrake import geometry
        from pydrake.systems.framework import DiagramBuilder

        builder = DiagramBuilder()
        plant, _ = drake.AddMultibodyPlantSceneGraph(builder, step)
        self._build(plant, tree, armature, step)
        self._base = self._bodies[0]
        rubs = geometry.ProximityProperties()
        law = drake.CoulombFriction(friction, friction)
        geometry.AddContactMaterial(DISSIPATION, STIFFNESS, law, rubs)
        world, still = plant.world_body(), drake.RigidTransform()
        plant.RegisterCollisionGeometry(world, still, geometry.HalfSpace(), "ground", rubs)
        for foot in feet:
            place, ball = drake.RigidTransform(foot.place), geometry.Sphere(foot.radius)
            own = plant.GetBodyByName(foot.body)
            plant.RegisterCollisionGeometry(own, place, ball, f"foot of {foot.body}", rubs)
        self._start(tree, builder.Build)

    def _join(self, link: Link, armature: Mapping[str, float]) -> None:
        if link.parent >= 0 or link.joint is not None:  # the base is free
            super()._join(link, armature)

    def stand(self, q: np.ndarray, height: float) -> None:
        """Put it upright at rest, its base at a height [m] and its joints at q (n,) [rad]."""
        drake, plant = load_drake(), self._plant
        state = plant.GetPositions(self._context)
        state[self._order] = q
        plant.SetPositions(self._context, state)
        plant.SetFreeBodyPose(self._context, self._base, drake.RigidTransform([0, 0, height]))
        plant.SetVelocities(self._context, np.zeros(plant.num_velocities()))
        self._simulator.Initialize()

    def base(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the base's place [m], its quaternion w x y z, and its turn along its own axes."""
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._base)
        speed = self._plant.EvalBodySpatialVelocityInWorld(self._context, self._base)
        turn = pose.rotation().matrix().T @ speed.rotational()
        return pose.translation(), pose.rotation().ToQuaternion().wxyz(), turn

    def push(self) -> np.ndarray:
        """Return the force of the ground on all feet [N], (3,)."""
        found = self._plant.get_contact_results_output_port().Eval(self._context)
        every = [found.point_pair_contact_info(i) for i in range(found.num_point_pair_contacts())]
        world = self._plant.world_body().index()
        forces = [
            info.contact_force() * (1 if info.bodyA_index() == world else -1) for info in every
        ]
        return np.sum(forces, axis=0) if forces else np.zeros(3)
