"""A robot with a free base on flat ground, moved by Drake: bodies, feet, contact, integration.

    ground = Ground(floating(model), feet_of(model), armature, step=0.0005, friction=0.8)
    ground.stand(q, height=0.144)
    q, v = ground.step(torque)                      # (n,) each, in the order of tree.names
    place, quaternion, gyro = ground.base()         # m, w x y z, rad/s along its own axes

Feet are spheres against a half-space: point contact with a linear spring, damping that grows with
the depth (Hunt and Crossley, J. Appl. Mech. 42 (2), 1975) and Coulomb friction, in discrete steps.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

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

        self._step, self._count = step, 0
        builder = DiagramBuilder()
        plant, _ = drake.AddMultibodyPlantSceneGraph(builder, step)
        self._plant: Any = plant
        bodies: list[Any] = []
        for link in tree.links:
            bodies.append(self._add(link, bodies, armature))
        self._base = bodies[0]
        rubs = geometry.ProximityProperties()
        law = drake.CoulombFriction(friction, friction)
        geometry.AddContactMaterial(DISSIPATION, STIFFNESS, law, rubs)
        world, still = plant.world_body(), drake.RigidTransform()
        plant.RegisterCollisionGeometry(world, still, geometry.HalfSpace(), "ground", rubs)
        for foot in feet:
            place, ball = drake.RigidTransform(foot.place), geometry.Sphere(foot.radius)
            own = plant.GetBodyByName(foot.body)
            plant.RegisterCollisionGeometry(own, place, ball, f"foot of {foot.body}", rubs)
        plant.mutable_gravity_field().set_gravity_vector(tree.gravity)
        plant.Finalize()
        joints = [plant.GetJointByName(name) for name in tree.names]
        self._order = np.array([joint.position_start() for joint in joints], int)
        self._fast = np.array([joint.velocity_start() for joint in joints], int)
        self._simulator = drake.Simulator(builder.Build())
        root = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(root)
        port = plant.get_applied_generalized_force_input_port()
        self._torque = port.FixValue(self._context, np.zeros(plant.num_velocities()))

    def _add(self, link: Link, bodies: list[Any], armature: Mapping[str, float]) -> Any:
        if link.parent >= 0 or link.joint is not None:
            return super()._add(link, bodies, armature)
        drake = load_drake()
        spread = drake.RotationalInertia(*(link.inertia[i] for i in _SIX))
        whole = drake.SpatialInertia.MakeFromCentralInertia(link.mass, link.centre, spread)
        return self._plant.AddRigidBody(link.body, whole)

    def stand(self, q: np.ndarray, height: float) -> None:
        """Put it upright at rest, its base at a height [m] and its joints at q (n,) [rad]."""
        drake, plant = load_drake(), self._plant
        state = plant.GetPositions(self._context)
        state[self._order] = q
        plant.SetPositions(self._context, state)
        plant.SetFreeBodyPose(self._context, self._base, drake.RigidTransform([0, 0, height]))
        plant.SetVelocities(self._context, np.zeros(plant.num_velocities()))
        self._simulator.Initialize()

    def step(self, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # noqa: D102
        ordered = np.zeros(self._plant.num_velocities())
        ordered[self._fast] = torque
        self._torque.GetMutableData().set_value(ordered)
        self._count += 1
        self._simulator.AdvanceTo(self._count * self._step)
        q, v = (get(self._context) for get in (self._plant.GetPositions, self._plant.GetVelocities))
        return q[self._order], v[self._fast]

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


_SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
