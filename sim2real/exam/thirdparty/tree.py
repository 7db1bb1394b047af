"""The numbers of a robot's rigid bodies, taken from MuJoCo's compiled model.

    tree = read_tree(mujoco.MjModel.from_xml_path("arm3.xml"))
    tree.names, [link.mass for link in tree.links]
    heavier = tree.change("forearm", mass=0.4)

Another engine is built from these masses, inertias and frames and nothing else, so that no second
reader of MJCF can differ. Every moving body turns or slides about one axis; bodies without a joint
are welded to the one that carries them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from sim2real.runs.errors import Sim2RealError

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Link:
    """One body and the joint that moves it against its parent."""

    body: str  # its name
    parent: int  # index of the body that carries it; -1 is the world
    position: np.ndarray  # of its frame in the parent's at zero [m], (3,)
    rotation: np.ndarray  # of its frame in the parent's at zero, (3, 3)
    mass: float  # [kg]
    centre: np.ndarray  # of mass, in its own frame [m], (3,)
    inertia: np.ndarray  # about the centre of mass, along its own frame's axes [kg·m²], (3, 3)
    joint: str | None = None  # the joint's name; None is a weld
    slides: bool = False  # whether the joint slides; else it turns
    # a point of the axis in its own frame [m], (3,)
    anchor: np.ndarray = field(default_factory=lambda: np.zeros(3))
    # its direction in its own frame, (3,)
    axis: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Tree:
    """All bodies, parents first, and gravity [m/s²], (3,)."""

    links: tuple[Link, ...]
    gravity: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """The joints, in the order of the bodies that they move."""
        return tuple(link.joint for link in self.links if link.joint is not None)

    def link(self, body: str) -> Link:
        """Return the body of a name."""
        return next(link for link in self.links if link.body == body)

    def mover(self, joint: str) -> Link:
        """Return the body that a joint moves."""
        return next(link for link in self.links if link.joint == joint)

    def change(self, body: str, **numbers: Any) -> Tree:
        """Return the tree with other numbers of one body."""
        links = (replace(one, **numbers) if one.body == body else one for one in self.links)
        return replace(self, links=tuple(links))

    def load(self, body: str, mass: float, at: np.ndarray) -> Tree:
        """Return the tree with a point mass [kg] added to a body at a place of its frame [m]."""
        link = self.link(body)
        total = link.mass + mass
        centre = (link.mass * link.centre + mass * at) / total
        moved = link.inertia + _steiner(link.mass, link.centre - centre)
        inertia = moved + _steiner(mass, at - centre)
        return self.change(body, mass=total, centre=centre, inertia=inertia)


def read_tree(model: mujoco.MjModel) -> Tree:
    """Return a compiled model's bodies.

    Raises:
        Sim2RealError: a body has a joint that neither turns nor slides, or more than one.
    """
    links = tuple(_link(model, body) for body in range(1, model.nbody))
    return Tree(links, np.array(model.opt.gravity))


def _link(model: mujoco.MjModel, body: int) -> Link:
    name = model.body(body).name
    turn = _matrix(model.body_iquat[body])
    fixed = Link(
        body=name,
        parent=int(model.body_parentid[body]) - 1,
        position=np.array(model.body_pos[body]),
        rotation=_matrix(model.body_quat[body]),
        mass=float(model.body_mass[body]),
        centre=np.array(model.body_ipos[body]),
        inertia=turn @ np.diag(model.body_inertia[body]) @ turn.T,
    )
    count, joint = int(model.body_jntnum[body]), int(model.body_jntadr[body])
    if count == 0:
        return fixed
    if count > 1 or int(model.jnt_type[joint]) not in (HINGE, SLIDE) or model.qpos0[joint] != 0:
        raise Sim2RealError(
            f"body {name!r} has {count} joints, or one that neither turns nor slides, or one whose "
            "zero is elsewhere (ref); another engine is built of bodies with one hinge or slide"
        )
    return replace(
        fixed,
        joint=model.joint(joint).name,
        slides=int(model.jnt_type[joint]) == SLIDE,
        anchor=np.array(model.jnt_pos[joint]),
        axis=np.array(model.jnt_axis[joint]),
    )


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    found = np.zeros(9)
    mujoco.mju_quat2Mat(found, np.asarray(quaternion, float))
    return found.reshape(3, 3)


def _steiner(mass: float, way: np.ndarray) -> np.ndarray:
    """Return the inertia of a point mass about a place that is this way off [kg·m²], (3, 3)."""
    return mass * (way @ way * np.eye(3) - np.outer(way, way))
