"""`OBS.yaml`: what a policy was trained to see and do.

    about = read_description("OBS.yaml", joints=["hip", "knee"])     # or a ready-made one: "quad8"
    about.terms, about.history, about.action.scale, about.size

`base: legged_gym` starts from a ready-made file (`READY`); the keys next to it replace its own.
docs/how-to/check_policy_interface.md explains every key.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import yaml

from envs.errors import did_you_mean
from sim2real.diagnosis.contract.terms import (
    ANGLE,
    FINITE,
    POSITIVE,
    SIZE_MAX,
    ContractError,
    Term,
    check_keys,
    choice,
    different,
    make_term,
    numbers,
    of_type,
    positive,
    whole,
)

FOLDER = Path(__file__).parent / "observations"
READY = tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))
KEYS = ("base", "name", "joints", "actuators", "rate", "default_pose", "observation", "history")
KEYS += ("clip", "normalizer", "action")
HISTORY_MAX = 200  # a longer one is a slip of the keyboard
Layout = Literal["frame", "term"]
Order = Literal["oldest_first", "newest_first"]
Law = Literal["joint_position", "logged_goal"]
Offset = Literal["default_pose", "zero"]


@dataclass(frozen=True)
class History:
    """How earlier observations stand in the vector."""

    length: int = 1  # H, frames; 1 for the newest alone
    layout: Layout = "frame"  # whole observations one after the other, or each term's frames
    order: Order = "oldest_first"  # whether the oldest or the newest frame comes first


@dataclass(frozen=True)
class ActionLaw:
    """What becomes of an action.

    Its law is "joint_position" (ctrl = offset + scale action) or "logged_goal" (ctrl is the logged
    `action.<actuator>`, which the task itself made of the action).
    """

    size: int  # A
    law: Law
    scale: np.ndarray  # [rad] per 1, (A,)
    offset: np.ndarray  # added [rad], (A,): the default pose, or zeros
    clip: float  # largest size of an action; inf for none
    kp: np.ndarray | None  # gains that were trained with [N·m/rad], (A,); None where not said
    kd: np.ndarray | None  # [N·m·s/rad], (A,)


@dataclass(frozen=True)
class Description:
    """What a policy was trained to see and do.

    The normalizer is mean and std of the whole vector, (2, size), taken off *before* it is logged;
    None if there is none or the actor holds it.
    """

    name: str  # of the description, for the report
    joints: tuple[str, ...]  # J names in the policy's order
    actuators: tuple[str, ...]  # their actuators, (J,)
    rate: float  # control steps a second
    default_pose: np.ndarray  # [rad], (J,)
    terms: tuple[Term, ...]  # of one frame, in order
    history: History  # how frames are stacked
    clip: float  # largest size of a scaled number; inf for none
    normalizer: np.ndarray | None
    action: ActionLaw  # what becomes of an action

    @property
    def frame_size(self) -> int:
        """Numbers of one frame."""
        return sum(term.size for term in self.terms)

    @property
    def size(self) -> int:
        """D, numbers of the whole vector."""
        return self.frame_size * self.history.length

    def parts(self, frames: np.ndarray) -> Iterator[tuple[Term, np.ndarray]]:
        """Return each term with its numbers (T, k) of frames (T, F)."""
        cuts = np.cumsum([term.size for term in self.terms])[:-1]
        return zip(self.terms, np.split(frames, cuts, axis=1), strict=True)

    def check_size(self, place: str, who: str, size: int | None) -> None:
        """Raise ContractError where a log or a policy has a vector of another size."""
        if size in (None, self.size):
            return
        text = ", ".join(f"{term.kind} {term.size}" for term in self.terms)
        frames = self.history.length
        terms = text if frames == 1 else f"({text}) in {frames} frames"
        raise ContractError(
            f"{place}: {who} {size} numbers, but {self.name} describes {self.size}: {terms}; "
            "correct the description's terms"
        )


def read_description(
    path: str | Path, joints: Sequence[str], actuators: Sequence[str] | None = None
) -> Description:
    """Read a description, or a ready-made one by its name.

    Args:
        path: a YAML file, or a name in `READY`.
        joints: the log's driven joints, for a file that names none.
        actuators: those of `joints`; None if they have the same names.

    Raises:
        ContractError: with the file, the key, the value, and what is allowed.
    """
    given, place = _load(path)
    check_keys(place, given, KEYS)
    names = different(f"{place}: joints", given.get("joints"), joints)
    of_log = dict(zip(joints, actuators or joints, strict=True))
    own = [of_log.get(name, name) for name in names]
    driving = different(f"{place}: actuators", given.get("actuators"), own)
    if len(driving) != len(names):
        raise ContractError(f"{place}: {len(driving)} actuators for {len(names)} joints")
    pose = _pose(f"{place}, default_pose", given.get("default_pose"), names)
    action = _action(place, given, len(names), pose)
    listed = given.get("observation")
    if not isinstance(listed, list) or not listed:
        raise ContractError(f"{place}: observation must be a list of terms, not {listed!r}")
    terms = tuple(
        make_term(f"{place}, observation {i + 1}", term, names, action.size)
        for i, term in enumerate(listed)
    )
    if pose is None and any(term.relative for term in terms):
        raise ContractError(
            f"{place}: default_pose is missing, but joint_position is relative to it; give the "
            "angle of each joint [rad], or relative: false in the term"
        )
    history = _history(place, given)
    size = history.length * sum(term.size for term in terms)
    return Description(
        str(given.get("name", Path(place).stem)),
        names,
        driving,
        positive(f"{place}: rate", given.get("rate")),
        np.zeros(len(names)) if pose is None else pose,
        terms,
        history,
        _limit(f"{place}: clip", given),
        _normalizer(place, given, size),
        action,
    )


def _load(path: str | Path) -> tuple[dict[str, Any], str]:
    """Return a file's keys over those of its base, and its place for errors."""
    name = str(path)
    file = FOLDER / f"{name}.yaml" if name in READY else Path(path).expanduser()
    try:
        given = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        raise ContractError(
            f"{name}: no such description{did_you_mean(name, READY)}; give a file, or one "
            f"of {', '.join(READY)}"
        ) from None
    except yaml.YAMLError as error:
        words = " ".join(str(error).split())
        raise ContractError(f"{name}: invalid YAML ({words})") from None
    if not isinstance(given, Mapping):
        raise ContractError(f"{name}: expected a mapping (docs/how-to/check_policy_interface.md)")
    if given.get("base") is None:
        return dict(given), name
    base, _ = _load(choice(f"{name}: base", given["base"], READY))
    both = {**base, **given}
    for key in ("action", "history"):  # whose keys are replaced one by one
        if isinstance(given.get(key), Mapping):
            both[key] = {**base.get(key, {}), **given[key]}
    return both, name


def _section(place: str, given: Mapping[str, Any], *keys: str) -> tuple[str, Mapping[str, Any]]:
    """Return the place of a section, the first of `keys`, and its values, of the other `keys`."""
    name, *allowed = keys
    section = {} if given.get(name) is None else given[name]
    of_type(f"{place}: {name}", section, Mapping, f"keys with values: {', '.join(allowed)}")
    place = f"{place}, {name}"
    check_keys(place, section, tuple(allowed))
    return place, section


def _pose(place: str, given: Any, joints: tuple[str, ...]) -> np.ndarray | None:
    if given is None:
        return None
    if isinstance(given, Mapping):
        check_keys(place, given, joints)
        missing = [name for name in joints if name not in given]
        if missing:
            raise ContractError(f"{place}: {', '.join(missing)} are missing")
        given = [given[name] for name in joints]
    return numbers(place, given, len(joints), ANGLE)


def _history(place: str, given: Mapping[str, Any]) -> History:
    place, own = _section(place, given, "history", "length", "layout", "order")
    return History(
        whole(f"{place}: length", own.get("length", 1), HISTORY_MAX),
        choice(f"{place}: layout", own.get("layout", "frame"), get_args(Layout)),
        choice(f"{place}: order", own.get("order", "oldest_first"), get_args(Order)),
    )


def _action(
    place: str, given: Mapping[str, Any], joints: int, pose: np.ndarray | None
) -> ActionLaw:
    keys = ("size", "law", "scale", "offset", "clip", "kp", "kd")
    place, own = _section(place, given, "action", *keys)
    size = whole(f"{place}: size", own.get("size", joints), SIZE_MAX)
    law = choice(f"{place}: law", own.get("law", "joint_position"), get_args(Law))
    offset = choice(f"{place}: offset", own.get("offset", "default_pose"), get_args(Offset))
    shift = np.zeros(size)
    if law == "joint_position" and offset == "default_pose":
        if pose is None or len(pose) != size:
            raise ContractError(
                f"{place}: the default pose is added to {size} actions, but default_pose "
                f"{'is missing' if pose is None else f'has {len(pose)} angles'}; give it, or "
                "offset: zero"
            )
        shift = pose
    kp, kd = (
        None if own.get(key) is None else numbers(f"{place}: {key}", own[key], size)
        for key in ("kp", "kd")
    )
    scale = numbers(f"{place}: scale", own.get("scale", 1.0), size)
    return ActionLaw(size, law, scale, shift, _limit(f"{place}: clip", own), kp, kd)


def _limit(place: str, given: Mapping[str, Any]) -> float:
    return np.inf if given.get("clip") is None else positive(place, given["clip"])


def _normalizer(place: str, given: Mapping[str, Any], size: int) -> np.ndarray | None:
    if given.get("normalizer") is None:
        return None
    place, own = _section(place, given, "normalizer", "mean", "std")
    mean = numbers(f"{place}: mean", own.get("mean"), size, FINITE)
    return np.stack([mean, numbers(f"{place}: std", own.get("std"), size, POSITIVE)])
