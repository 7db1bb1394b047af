"""The kinds of cases, and which robots and effects each of them draws.

wanted = draws("dirty", rng)                    # endless (robot, effects), evenly
robot, effects = next(wanted)

single       one effect; the rest is as the model says
two          two effects at different places
dirty        one dominant effect; every mass, inertia, damping, friction and gain a little off
outside      a law that the vocabulary does not have
off_nominal  nothing hidden, but everything a little off
robot_wide   one value that all joints share
torque       a leg whose commands are torques, with one effect
encoders     play or a spring, with the firmware's encoder on one side and the log's on the other
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np

from sim2real.exam.cases import ALIKE
from sim2real.exam.thirdparty.hidden import TWO_SIDED, WIDE, known
from sim2real.exam.thirdparty.outside import OUTSIDE
from sim2real.exam.thirdparty.robots import ROBOTS, make_rig

Kind = Literal[
    "single", "two", "dirty", "outside", "off_nominal", "robot_wide", "torque", "encoders"
]
ON: Mapping[Kind, tuple[str, ...]] = {
    "single": ("arm3", "pendulum"),
    "two": ("arm3", "pendulum"),
    "dirty": ("arm3", "pendulum"),
    "outside": ("arm3", "pendulum"),
    "off_nominal": ("arm3", "pendulum"),
    "robot_wide": ("arm3",),
    "torque": ("leg2",),
    "encoders": ("arm3", "pendulum"),
}
KINDS: tuple[Kind, ...] = tuple(ON)


def draws(kind: Kind, rng: np.random.Generator) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield robots and effects of a kind for ever, each of them about equally often."""
    names = {robot: _names(kind, robot) for robot in ON[kind]}
    bags: dict[str, list[tuple[str, ...]]] = {robot: [] for robot in names}
    while True:
        for robot in rng.permutation(list(names)).tolist():
            if not bags[robot]:
                bags[robot] = _bag(kind, names[robot], rng)
            yield robot, bags[robot].pop()


def _bag(kind: Kind, names: Sequence[str], rng: np.random.Generator) -> list[tuple[str, ...]]:
    order = [str(name) for name in rng.permutation(list(names))]
    if kind != "two":
        return [(name,) for name in order] or [()]
    pairs = zip(order[::2], order[1::2], strict=False)
    return [pair for pair in pairs if not any(set(pair) <= group for group in ALIKE)]


def _names(kind: Kind, robot: str) -> list[str]:
    can = known(make_rig(ROBOTS[robot]))
    match kind:
        case "outside":
            return list(OUTSIDE)
        case "off_nominal":
            return []
        case "robot_wide":
            return [name for name in WIDE if name in can]
        case "encoders":
            return [name for name in TWO_SIDED if name in can]
    return can
