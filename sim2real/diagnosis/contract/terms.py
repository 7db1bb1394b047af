"""What an observation is made of: the terms of an `OBS.yaml`, each with its keys and its size.

A term is rebuilt from channels of the log. One whose channels are not logged (`other`, or `command`
without `channels`) keeps its place in the vector, and is not checked.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from envs.errors import did_you_mean
from sim2real.runs.errors import Sim2RealError

Frame = Literal["body", "world"]
QuaternionOrder = Literal["wxyz", "xyzw"]
AXES, QUATERNION, PAIR = 3, 4, 2  # numbers of a vector, a quaternion, and of two angles


class ContractError(Sim2RealError):
    """A description, a log and a policy that cannot be checked against each other."""


class Kind(NamedTuple):
    """A kind of term."""

    size: int | None  # numbers; None for one a joint, 0 for what the term itself says
    keys: tuple[str, ...]  # that it may have, in addition to `term` and `scale`
    about: str


KINDS = {
    "joint_position": Kind(None, ("joints", "relative"), "angle [rad], less the default pose"),
    "joint_velocity": Kind(None, ("joints",), "speed [rad/s]"),
    "last_action": Kind(None, (), "the action one step before"),
    "gyro": Kind(AXES, ("site", "frame"), "angular velocity [rad/s]"),
    "gravity": Kind(AXES, ("site",), "direction of gravity in the body's frame, down is -z"),
    "accelerometer": Kind(AXES, ("site", "frame"), "acceleration [m/s²], +g when at rest"),
    "quaternion": Kind(QUATERNION, ("site", "order"), "orientation of the body"),
    "roll_pitch": Kind(PAIR, ("site",), "roll and pitch [rad]"),
    "phase": Kind(PAIR, ("frequency",), "sine and cosine of a clock"),
    "command": Kind(0, ("channels", "size"), "what the policy was asked to do"),
    "linear_velocity": Kind(0, ("channels", "size"), "velocity of the base [m/s]"),
    "channel": Kind(0, ("channels",), "any columns of the log"),
    "other": Kind(0, ("size",), "numbers that the log does not hold"),
}
UNLOGGED = ("command", "linear_velocity", "other")  # may be without channels


@dataclass(frozen=True)
class Term:
    """One term of an observation.

    Attributes:
        kind: its name, a key of `KINDS`.
        size: k, how many numbers it has.
        scale: what its numbers were multiplied by, (k,).
        joints: of a joint's term, their names in order.
        relative: whether a joint's position is taken from the default pose.
        site: of the IMU; None for the only one in the log.
        frame: the axes of a gyro or an accelerometer.
        order: of a quaternion's numbers.
        frequency: of a phase [1/s].
        channels: of a term that is rebuilt from columns, their names; () for one that is not.
    """

    kind: str
    size: int
    scale: np.ndarray
    joints: tuple[str, ...] = ()
    relative: bool = False
    site: str | None = None
    frame: Frame = "body"
    order: QuaternionOrder = "wxyz"
    frequency: float = 0.0
    channels: tuple[str, ...] = ()

    @property
    def rebuilt(self) -> bool:
        """Whether the log can hold what the term is made of."""
        return self.kind not in UNLOGGED or bool(self.channels)

    @property
    def elements(self) -> list[str]:
        """A name for each of its numbers."""
        parts: tuple[str, ...] = self.joints or self.channels
        if self.kind in ("gyro", "gravity", "accelerometer"):
            parts = ("x", "y", "z")
        elif self.kind == "quaternion":
            parts = tuple(self.order)
        elif self.kind == "roll_pitch":
            parts = ("roll", "pitch")
        elif self.kind == "phase":
            parts = ("sine", "cosine")
        return list(parts) or [str(i) for i in range(self.size)]


def make_term(
    place: str, given: Any, joints: tuple[str, ...], actions: int, most: tuple[float, float]
) -> Term:
    """Make a term of what a file says.

    Args:
        place: the file and where in it, for errors.
        given: the term's mapping.
        joints: all joints, in the policy's order.
        actions: numbers of an action.
        most: the largest scale and size that are taken for meant.

    Raises:
        ContractError: with the place, what is wrong, and what is allowed.
    """
    if not isinstance(given, Mapping) or "term" not in given:
        raise ContractError(
            f"{place}: {given!r} is not a term; write for example {{term: gyro, scale: 0.25}}"
        )
    kind = given["term"]
    if kind not in KINDS:
        raise ContractError(
            f"{place}: unknown term {kind!r}{did_you_mean(str(kind), KINDS)}; choose one of: "
            f"{', '.join(KINDS)}"
        )
    place = f"{place} ({kind})"
    check_keys(place, given, ("term", "scale", *KINDS[kind].keys))
    chosen = _joints(place, given.get("joints"), joints)
    size = _size(place, kind, given, len(chosen), actions, most[1])
    return Term(
        kind,
        size,
        numbers(f"{place}: scale", given.get("scale", 1.0), size, most[0]),
        chosen if kind in ("joint_position", "joint_velocity") else (),
        _truth(f"{place}: relative", given.get("relative", True)) and kind == "joint_position",
        _site(place, given.get("site")),
        choice(f"{place}: frame", given.get("frame", "body"), get_args(Frame)),
        choice(f"{place}: order", given.get("order", "wxyz"), get_args(QuaternionOrder)),
        positive(f"{place}: frequency", given["frequency"]) if "frequency" in given else 0.0,
        _channels(place, kind, given),
    )


def check_keys(place: str, given: Mapping[str, Any], allowed: tuple[str, ...]) -> None:
    """Raise ContractError for a key that is not allowed."""
    for key in given:
        if key not in allowed:
            raise ContractError(
                f"{place}: unknown key {key!r}{did_you_mean(str(key), allowed)}; choose one of: "
                f"{', '.join(allowed)}"
            )


def is_number(value: Any) -> bool:
    """Return whether a value of a file is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def whole(place: str, value: Any, most: float, hint: str = "") -> int:
    """Return a whole number from 1 to `most`; raises ContractError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= most:
        raise ContractError(f"{place} {value!r} must be a whole number from 1 to {most:g}{hint}")
    return value


def different(place: str, given: Any) -> tuple[str, ...]:
    """Return a list of different names; raises ContractError for anything else."""
    if not isinstance(given, list) or not given or len(set(map(str, given))) != len(given):
        raise ContractError(f"{place} {given!r} must be a list of different names, or null")
    return tuple(map(str, given))


def positive(place: str, value: Any) -> float:
    """Return a number above 0; raises ContractError for anything else."""
    if not is_number(value) or not 0 < value < np.inf:
        raise ContractError(f"{place}: {value!r} is not allowed; give a number above 0")
    return float(value)


def numbers(place: str, given: Any, size: int, most: float) -> np.ndarray:
    """Return one number for all, or one each, as an array (size,).

    Raises:
        ContractError: another count, or a number that is 0, not finite or above `most`.
    """
    values = given if isinstance(given, list) else [given] * size
    if len(values) != size:
        raise ContractError(f"{place}: {len(values)} numbers for {size}; give one, or {size}")
    for value in values:
        if not is_number(value) or not 0 < abs(value) <= most:
            raise ContractError(
                f"{place}: {value!r} is not allowed; give numbers other than 0, up to {most:g}"
            )
    return np.array(values, float)


def _joints(place: str, given: Any, joints: tuple[str, ...]) -> tuple[str, ...]:
    if given is None:
        return joints
    chosen = different(f"{place}: joints", given)
    for name in chosen:
        choice(f"{place}: joint", name, joints)
    return chosen


def _size(
    place: str, kind: str, given: Mapping[str, Any], joints: int, actions: int, most: float
) -> int:
    fixed = KINDS[kind].size
    if kind == "last_action":
        return actions
    if kind == "phase" and "frequency" not in given:
        raise ContractError(f"{place}: the key frequency [1/s] is missing")
    if fixed is None:
        return joints
    if fixed:
        return fixed
    listed = given.get("channels")
    if listed is not None:
        count = len(listed) if isinstance(listed, list) else 0
        if given.get("size", count) != count:
            raise ContractError(f"{place}: size {given['size']} for {count} channels; leave it out")
        return count
    hint = ", or name its columns of the log as channels"
    return whole(f"{place}: size", given.get("size"), most, hint)


def _channels(place: str, kind: str, given: Mapping[str, Any]) -> tuple[str, ...]:
    listed = given.get("channels")
    if listed is None and (kind in UNLOGGED or KINDS[kind].size != 0):
        return ()
    if not isinstance(listed, list) or not listed or not all(isinstance(c, str) for c in listed):
        raise ContractError(f"{place}: channels {listed!r} must be a list of the log's columns")
    return tuple(listed)


def _site(place: str, given: Any) -> str | None:
    if given is not None and not isinstance(given, str):
        raise ContractError(f"{place}: site {given!r} must be the name of an IMU's site, or null")
    return given


def _truth(place: str, given: Any) -> bool:
    if not isinstance(given, bool):
        raise ContractError(f"{place}: {given!r} is not allowed; give true or false")
    return given


def choice(place: str, given: Any, allowed: tuple[str, ...]) -> Any:
    """Return one of the allowed words; raises ContractError for any other."""
    if given not in allowed:
        hint = did_you_mean(str(given), allowed)
        raise ContractError(
            f"{place}: {given!r} is unknown{hint}; choose one of: {', '.join(allowed)}"
        )
    return given
