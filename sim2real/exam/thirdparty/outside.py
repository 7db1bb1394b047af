"""Laws that the vocabulary does not have: a right answer does not call them explained.

    law = OUTSIDE["cable"]
    other = law.put(rig, "elbow", 0.3, rng)

A cable grows taut on one side and pulls back; a push comes and goes with a rhythm of its own; a
worn gear rubs about one angle; grease is thick while it is cold; a detent holds the joint at one
angle; a loose mount lets the whole robot rock.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim2real.exam.thirdparty.friction import Friction
from sim2real.exam.thirdparty.rig import Joint, Pull, Rig
from sim2real.exam.thirdparty.tree import Link, Tree

MOUNT = "mount"  # the joint of a loose mount
ROCKS = 0.05  # damping ratio of a mount, about
FOOT = (0.4, 0.002)  # kg and kg·m² of what is mounted on it
Put = Callable[[Rig, str, float, np.random.Generator], Rig]


@dataclass(frozen=True)
class Outside:
    """One law: what it does, and its smallest and largest size as a share of the motor's torque."""

    put: Put
    low: float = 0.005
    high: float = 1.0
    place: bool = True  # whether it acts at one joint


def _stall(rig: Rig, joint: str) -> float:
    servo = rig.joints[joint].servo
    assert servo is not None
    return servo.limit


def _pulled(rig: Rig, joint: str, pull: Pull) -> Rig:
    return rig.change(joint, pulls=(*rig.joints[joint].pulls, pull))


def _cable(rig: Rig, joint: str, size: float, rng: np.random.Generator) -> Rig:
    side, start = rng.choice([-1.0, 1.0]), rng.uniform(-0.1, 0.2)
    home, torque = rig.home[joint], size * _stall(rig, joint)

    def pull(time: float, angle: float, speed: float) -> float:
        taut = max(side * (angle - home) - start, 0.0)
        return -side * torque * (taut / 0.5) ** 2

    return _pulled(rig, joint, pull)


def _push(rig: Rig, joint: str, size: float, rng: np.random.Generator) -> Rig:
    rhythm, phase = rng.uniform(0.4, 1.5), rng.uniform(-math.pi, math.pi)
    torque = size * _stall(rig, joint)

    def pull(time: float, angle: float, speed: float) -> float:
        return torque * math.sin(2 * math.pi * rhythm * time + phase)

    return _pulled(rig, joint, pull)


def _detent(rig: Rig, joint: str, size: float, rng: np.random.Generator) -> Rig:
    place, width = rig.home[joint] + rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.2)
    torque = size * _stall(rig, joint)

    def pull(time: float, angle: float, speed: float) -> float:
        way = (angle - place) / width
        return -torque * way * math.exp(0.5 - 0.5 * way * way)

    return _pulled(rig, joint, pull)


def _worn(rig: Rig, joint: str, size: float, rng: np.random.Generator) -> Rig:
    place = rig.home[joint] + rng.uniform(-0.3, 0.3)
    worn, width = size * _stall(rig, joint), rng.uniform(0.08, 0.15)
    return rig.friction(joint, worn=worn, worn_at=place, worn_width=width)


def _grease(rig: Rig, joint: str, size: float, rng: np.random.Generator) -> Rig:
    return rig.friction(joint, grease=size * _stall(rig, joint), warm_up=rng.uniform(2.0, 5.0))


def _mount(rig: Rig, joint: str, size: float, rng: np.random.Generator) -> Rig:
    """Let the robot's foot turn about a level axis on a spring, and everything else with it."""
    links = rig.tree.links
    stiffness = _stall(rig, rig.driven[0]) / size / 0.05
    turn = 0.0 if len(rig.driven) == 1 else rng.uniform(-0.6, 0.6)
    axis = np.array([math.sin(turn), math.cos(turn), 0.0])
    mass, inertia = FOOT
    foot = Link(
        body="foot_of_mount",
        parent=-1,
        position=links[0].position - np.array([0, 0, 0.05]),
        rotation=np.eye(3),
        mass=mass,
        centre=np.zeros(3),
        inertia=inertia * np.eye(3),
        joint=MOUNT,
        axis=axis,
    )
    first = replace(links[0], parent=0, position=np.array([0, 0, 0.05]))
    others = tuple(replace(link, parent=link.parent + 1) for link in links[1:])
    whole = sum(link.mass for link in links)
    heavy = inertia + whole * 0.2**2
    damping = 2 * ROCKS * math.sqrt(stiffness * heavy)

    def pull(time: float, angle: float, speed: float) -> float:
        return -stiffness * angle - damping * speed

    loose = Joint(servo=None, friction=Friction(), armature=0.0, inertia=heavy, pulls=(pull,))
    tree = Tree((foot, first, *others), rig.tree.gravity)
    return replace(rig, tree=tree, joints={MOUNT: loose, **rig.joints})


OUTSIDE: Mapping[str, Outside] = {
    "cable": Outside(_cable),
    "push": Outside(_push),
    "detent": Outside(_detent),
    "worn_gear": Outside(_worn),
    "cold_grease": Outside(_grease),
    "loose_mount": Outside(_mount, place=False),
}
