"""What an observation is made of: the terms of an `OBS.yaml`, each with its keys and its numbers.

A term is rebuilt from channels of the log. One whose channels are not logged (`other`, or `command`
without `channels`) keeps its place in the vector, and is not checked.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from envs.errors import did_you_mean
from sim2real.diagnosis.data.pairs import TURN
from sim2real.runs.errors import Sim2RealError

Frame = Literal["body", "world"]
QuaternionOrder = Literal["wxyz", "xyzw"]
SCALE_MAX, SIZE_MAX = 1e4, 10_000  # larger ones are slips of the keyboard


class ContractError(Sim2RealError):
    """A description, a log and a policy that cannot be checked against each other."""


class Kind(NamedTuple):
    """A kind of term."""

    keys: tuple[str, ...]  # those that it may have, in addition to `term` and `scale`
    elements: tuple[str, ...] = ()  # names of its numbers, unless one of the keys says them


JOINTS = ("joint_position", "joint_velocity")
AXES = ("x", "y", "z")
KINDS = {
    "joint_position": Kind(("joints", "relative")),  # angle [rad], less the default pose
    "joint_velocity": Kind(("joints",)),  # [rad/s]
    "last_action": Kind(()),  # the action one step before
    "gyro": Kind(("site", "frame"), AXES),  # angular velocity [rad/s]
    "gravity": Kind(("site",), AXES),  # its direction in the body's frame, down is -z
    "accelerometer": Kind(("site", "frame"), AXES),  # [m/s²], +g when at rest
    "quaternion": Kind(("site", "order")),  # orientation of the body
    "roll_pitch": Kind(("site",), ("roll", "pitch")),  # [rad]
    "phase": Kind(("frequency",), ("sine", "cosine")),  # of a clock
    "command": Kind(("channels", "size")),  # what the policy was asked to do
    "linear_velocity": Kind(("channels", "size")),  # of the base [m/s]
    "channel": Kind(("channels",)),  # any columns of the log
    "other": Kind(("size",)),  # numbers that the log does not hold
}


@dataclass(frozen=True)
class Term:
    """One term of an observation."""

    kind: str  # its name, a key of `KINDS`
    elements: tuple[str, ...]  # a name for each of its k numbers; of a joint's term, the joints
    scale: np.ndarray  # what its numbers were multiplied by, (k,)
    relative: bool = False  # whether a joint's position is taken from the default pose
    site: str | None = None  # of the IMU; None for the only one in the log
    frame: Frame = "body"  # the axes of a gyro or an accelerometer
    frequency: float = 0.0  # of a phase [1/s]
    channels: tuple[str, ...] = ()  # columns that it is rebuilt from; () for one that is not

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return len(self.elements)

    @property
    def rebuilt(self) -> bool:
        """Whether the log can hold what the term is made of."""
        return "size" not in KINDS[self.kind].keys or bool(self.channels)


def make_term(place: str, given: Any, joints: tuple[str, ...], actions: int) -> Term:
    """Make a term of what a file says.

    Args:
        place: the file and where in it, for errors.
        given: the term's mapping.
        joints: all joints, in the policy's order.
        actions: numbers of an action.

    Raises:
        ContractError: with the place, what is wrong, and what is allowed.
    """
    if not isinstance(given, Mapping) or "term" not in given:
        raise ContractError(
            f"{place}: {given!r} is not a term; write for example {{term: gyro, scale: 0.25}}"
        )
    kind = choice(f"{place}: term", given["term"], tuple(KINDS))
    place = f"{place} ({kind})"
    check_keys(place, given, ("term", "scale", *KINDS[kind].keys))
    elements = _elements(place, kind, given, joints, actions)
    relative = given.get("relative", kind == "joint_position")
    return Term(
        kind,
        elements,
        numbers(f"{place}: scale", given.get("scale", 1.0), len(elements)),
        of_type(f"{place}: relative", relative, bool, "true or false"),
        of_type(f"{place}: site", given.get("site"), str | None, "a name of an IMU's site or null"),
        choice(f"{place}: frame", given.get("frame", "body"), get_args(Frame)),
        positive(f"{place}: frequency [1/s]", given.get("frequency")) if kind == "phase" else 0.0,
        elements if given.get("channels") else (),
    )


def _elements(
    place: str, kind: str, given: Mapping[str, Any], joints: tuple[str, ...], actions: int
) -> tuple[str, ...]:
    """Return a name for each number of a term."""
    if kind in JOINTS:
        chosen = different(f"{place}: joints", given.get("joints"), joints)
        return tuple(choice(f"{place}: joint", name, joints) for name in chosen)
    if kind == "quaternion":
        order = choice(f"{place}: order", given.get("order", "wxyz"), get_args(QuaternionOrder))
        return tuple(order)
    if KINDS[kind].elements:
        return KINDS[kind].elements
    if kind == "last_action":
        return tuple(map(str, range(actions)))
    if "size" not in KINDS[kind].keys or given.get("channels") is not None:
        listed = given.get("channels")
        if not isinstance(listed, list) or not listed or {type(c) for c in listed} != {str}:
            raise ContractError(f"{place}: channels {listed!r} must be a list of the log's columns")
        if given.get("size", len(listed)) != len(listed):
            raise ContractError(
                f"{place}: size {given['size']} for {len(listed)} channels; leave it out"
            )
        return tuple(listed)
    hint = ", or name its columns of the log as channels"
    return tuple(map(str, range(whole(f"{place}: size", given.get("size"), SIZE_MAX, hint))))


def check_keys(place: str, given: Mapping[str, Any], allowed: tuple[str, ...]) -> None:
    """Raise ContractError for a key that is not allowed."""
    for key in given:
        choice(f"{place}: key", key, allowed)


def choice(place: str, given: Any, allowed: tuple[str, ...]) -> Any:
    """Return one of the allowed words; raises ContractError for any other."""
    if given not in allowed:
        hint = did_you_mean(str(given), allowed)
        raise ContractError(
            f"{place} {given!r} is unknown{hint}; choose one of: {', '.join(allowed)}"
        )
    return given


def of_type(place: str, given: Any, allowed: Any, words: str) -> Any:
    """Return a value of an allowed type; raises ContractError for any other."""
    if not isinstance(given, allowed):
        raise ContractError(f"{place} {given!r} must be {words}")
    return given


def whole(place: str, value: Any, most: int, hint: str = "") -> int:
    """Return a whole number from 1 to `most`; raises ContractError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= most:
        raise ContractError(f"{place} {value!r} must be a whole number from 1 to {most}{hint}")
    return value


def different(place: str, given: Any, default: Sequence[str]) -> tuple[str, ...]:
    """Return a list of different names, or the default; raises ContractError for anything else."""
    if given is None:
        return tuple(default)
    if not isinstance(given, list) or not given or len(set(map(str, given))) != len(given):
        raise ContractError(f"{place} {given!r} must be a list of different names, or null")
    return tuple(map(str, given))


Allowed = tuple[str, Callable[[float], bool]]  # numbers that a file may hold: words, and a test
FACTOR: Allowed = (
    f"numbers other than 0, up to {SCALE_MAX:g}",
    lambda value: 0 < abs(value) <= SCALE_MAX,
)
ANGLE: Allowed = ("angles [rad] within a turn", lambda value: abs(value) <= TURN)
FINITE: Allowed = ("finite numbers", math.isfinite)
POSITIVE: Allowed = ("finite numbers above 0", lambda value: 0 < value < math.inf)


def numbers(place: str, given: Any, size: int, allowed: Allowed = FACTOR) -> np.ndarray:
    """Return one number for all, or one each, as an array (size,).

    Raises:
        ContractError: another count, or a number that is not allowed.
    """
    values, (words, test) = given if isinstance(given, list) else [given] * size, allowed
    if len(values) != size:
        raise ContractError(f"{place}: {len(values)} numbers for {size}; give one, or {size}")
    for value in values:
        real = isinstance(value, int | float) and not isinstance(value, bool)
        if not real or not test(value):
            raise ContractError(f"{place}: {value!r} is not allowed; give {words}")
    return np.array(values, float)


def positive(place: str, value: Any) -> float:
    """Return a number above 0; raises ContractError for anything else."""
    return float(numbers(place, value, 1, POSITIVE)[0])
