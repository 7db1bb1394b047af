"""Other engines that move a tree of rigid bodies: Drake, and DART as a cross-check.

    engine = make_engine("drake", tree, armature={"hinge": 0.002}, step=0.00025)
    engine.place(q, v)
    q, v = engine.step(torque)                      # (n,) each, in the order of tree.names

Both are given the numbers of `tree`, never an MJCF. An armature is the inertia of a rotor that
turns with its joint.
"""

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any, Literal, Protocol

import numpy as np

from sim2real.exam.thirdparty.tree import Link, Tree
from sim2real.runs.errors import Sim2RealError

EngineName = Literal["drake", "dart"]
MODULES: Mapping[str, str] = {"drake": "pydrake", "dart": "dartpy"}


class Engine(Protocol):
    """A simulated tree of rigid bodies."""

    def place(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put it at positions [rad or m] and speeds, (n,) each."""
        ...

    def step(self, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Move on by one step under joint torques [N·m or N], (n,); return q and v, (n,) each."""
        ...


def check_engine(name: str) -> None:
    """Refuse an engine that does not exist or is not installed.

    Raises:
        Sim2RealError: with what to do.
    """
    if name not in MODULES:
        raise Sim2RealError(f"engine={name!r} is unknown; one of {', '.join(MODULES)}")
    if find_spec(MODULES[name]) is None:
        raise Sim2RealError(
            f"engine={name!r} needs {MODULES[name]}: pip install 'sim2real[engines]'"
        )


def make_engine(name: EngineName, tree: Tree, armature: Mapping[str, float], step: float) -> Engine:
    """Return an engine that holds a tree.

    Args:
        name: which engine.
        tree: the bodies.
        armature: rotor's inertia of each joint [kg·m²].
        step: of time [s].

    Raises:
        Sim2RealError: there is no such engine, or it is not installed.
    """
    check_engine(name)
    return {"drake": Drake, "dart": Dart}[name](tree, armature, step)


def _shape(link: Link) -> tuple[Any, ...]:
    """Return an inertia's six numbers [kg·m²]: xx, yy, zz, xy, xz, yz."""
    i = link.inertia
    return (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])


def load_drake() -> Any:
    """Return Drake's modules as Any: its stubs ask for arrays that NumPy's types cannot be."""
    from pydrake import math
    from pydrake.multibody import plant, tree
    from pydrake.systems import analysis

    return SimpleNamespace(**{**vars(math), **vars(tree), **vars(plant), **vars(analysis)})


class Drake:
    """Drake's MultibodyPlant with discrete steps (https://drake.mit.edu)."""

    def __init__(self, tree: Tree, armature: Mapping[str, float], step: float) -> None:
        plant = load_drake().MultibodyPlant(step)
        self._build(plant, tree, armature, step)
        self._start(tree, lambda: plant)

    def _build(self, plant: Any, tree: Tree, armature: Mapping[str, float], step: float) -> None:
        """Add a tree's bodies and joints to a plant."""
        drake = load_drake()
        self._plant, self._step, self._count = plant, step, 0
        self._bodies: list[Any] = []
        for link in tree.links:
            spread = drake.RotationalInertia(*_shape(link))
            whole = drake.SpatialInertia.MakeFromCentralInertia(link.mass, link.centre, spread)
            self._bodies.append(plant.AddRigidBody(link.body, whole))
            self._join(link, armature)

    def _start(self, tree: Tree, system: Callable[[], Any]) -> None:
        """Finish the plant, and simulate the system that it is then, or is a part of."""
        plant = self._plant
        plant.mutable_gravity_field().set_gravity_vector(tree.gravity)
        plant.Finalize()
        joints = [plant.GetJointByName(name) for name in tree.names]
        self._order = np.array([joint.position_start() for joint in joints], int)
        self._fast = np.array([joint.velocity_start() for joint in joints], int)
        self._simulator = load_drake().Simulator(system())
        root = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(root)
        port = plant.get_applied_generalized_force_input_port()
        self._torque = port.FixValue(self._context, np.zeros(plant.num_velocities()))

    def _join(self, link: Link, armature: Mapping[str, float]) -> None:
        """Join the newest body to the one that carries it."""
        drake, plant, body = load_drake(), self._plant, self._bodies[-1]
        parent = self._bodies[link.parent] if link.parent >= 0 else plant.world_body()
        place = drake.RigidTransform(drake.RotationMatrix(link.rotation), link.position)
        if link.joint is None:
            plant.WeldFrames(parent.body_frame(), body.body_frame(), place)
            return
        kind = drake.PrismaticJoint if link.slides else drake.RevoluteJoint
        anchor = drake.RigidTransform(link.anchor)
        before = drake.FixedOffsetFrame(f"{link.joint}_before", parent.body_frame(), place @ anchor)
        after = drake.FixedOffsetFrame(f"{link.joint}_after", body.body_frame(), anchor)
        frames = (plant.AddFrame(before), plant.AddFrame(after))
        joint = plant.AddJoint(kind(link.joint, *frames, link.axis))
        rotor = plant.AddJointActuator(link.joint, joint)
        rotor.set_default_rotor_inertia(armature[link.joint])
        rotor.set_default_gear_ratio(1.0)

    def place(self, q: np.ndarray, v: np.ndarray) -> None:  # noqa: D102
        state = np.zeros((2, len(self._order)))
        state[:, self._order] = q, v
        self._plant.SetPositionsAndVelocities(self._context, state.ravel())
        self._simulator.Initialize()

    def step(self, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # noqa: D102
        ordered = np.zeros(self._plant.num_velocities())
        ordered[self._fast] = torque
        self._torque.GetMutableData().set_value(ordered)
        self._count += 1
        self._simulator.AdvanceTo(self._count * self._step)
        q, v = (get(self._context) for get in (self._plant.GetPositions, self._plant.GetVelocities))
        return q[self._order], v[self._fast]


class Dart:
    """DART's mass matrix and bias forces (https://dartsim.github.io), with semi-implicit steps."""

    def __init__(self, tree: Tree, armature: Mapping[str, float], step: float) -> None:
        from dartpy.dynamics import Skeleton

        self._step = step
        self._skeleton = Skeleton()
        self._skeleton.setGravity(tree.gravity)
        bodies: list[Any] = []
        for link in tree.links:
            bodies.append(self._add(link, bodies[link.parent] if link.parent >= 0 else None))
        dofs = [self._skeleton.getJoint(name).getIndexInSkeleton(0) for name in tree.names]
        self._order = np.array(dofs, int)
        self._rotors = np.array([armature[name] for name in tree.names])
        self._q, self._v = np.zeros((2, len(dofs)))

    def _add(self, link: Link, parent: Any) -> Any:
        from dartpy import dynamics
        from dartpy.math import Isometry3

        place = Isometry3(link.rotation, link.position)
        kind = "Weld" if link.joint is None else "Prismatic" if link.slides else "Revolute"
        about = getattr(dynamics, f"{kind}JointProperties")()
        about.mName = link.joint or f"{link.body}_weld"
        if link.joint is not None:
            about.mAxis = link.axis
        anchor = Isometry3(np.eye(3), link.anchor)
        about.mT_ParentBodyToJoint = place.multiply(anchor)
        about.mT_ChildBodyToJoint = anchor
        inertia = dynamics.Inertia(link.mass, link.centre, link.inertia)
        body = dynamics.BodyNodeProperties(
            dynamics.BodyNodeAspectProperties(name=link.body, inertia=inertia)
        )
        make = getattr(self._skeleton, f"create{kind}JointAndBodyNodePair")
        return make(parent, about, body)[1]

    def place(self, q: np.ndarray, v: np.ndarray) -> None:  # noqa: D102
        self._q, self._v = np.array(q, float), np.array(v, float)

    def step(self, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # noqa: D102
        order, skeleton = self._order, self._skeleton
        q, v = np.empty((2, len(order)))
        q[order], v[order] = self._q, self._v
        skeleton.setPositions(q)
        skeleton.setVelocities(v)
        mass = skeleton.getMassMatrix()[np.ix_(order, order)] + np.diag(self._rotors)
        bias = skeleton.getCoriolisAndGravityForces()[order]
        self._v = self._v + self._step * np.linalg.solve(mass, torque - bias)
        self._q = self._q + self._step * self._v
        return self._q, self._v
