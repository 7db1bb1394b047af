"""`OBS.yaml`: what a policy was trained to see and do.

    about = read_description("OBS.yaml", joints=["hip", "knee"])     # or a ready-made one: "quad8"
    about.terms, about.history, about.action.scale, about.size

`base: legged_gym` starts from a ready-made file (`READY`); the keys next to it replace its own.
docs/how-to/check_policy_interface.md explains every key.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from envs.errors import did_you_mean
from sim2real.diagnosis.contract.terms import (
    ContractError,
    Term,
    check_keys,
    choice,
    different,
    is_number,
    make_term,
    numbers,
    positive,
    whole,
)
from sim2real.diagnosis.data.pairs import TURN

FOLDER = Path(__file__).parent / "observations"
READY = tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))
KEYS = ("base", "name", "joints", "actuators", "rate", "default_pose", "observation", "history")
KEYS += ("clip", "normalizer", "action")
ACTION_KEYS = ("size", "law", "scale", "offset", "clip", "kp", "kd")
HISTORY_KEYS = ("length", "layout", "order")
SCALE_MAX, SIZE_MAX, HISTORY_MAX = 1e4, 10_000, 200  # larger ones are slips of the keyboard
Layout = Literal["frame", "term"]
Order = Literal["oldest_first", "newest_first"]
Law = Literal["joint_position", "logged_goal"]


@dataclass(frozen=True)
class History:
    """How earlier observations stand in the vector.

    Attributes:
        length: H, frames; 1 for the newest alone.
        layout: "frame" (whole observations one after the other) or "term" (each term's frames).
        order: whether the oldest or the newest frame comes first.
    """

    length: int = 1
    layout: Layout = "frame"
    order: Order = "oldest_first"


@dataclass(frozen=True)
class ActionLaw:
    """What becomes of an action.

    Attributes:
        size: A.
        law: "joint_position" (ctrl = offset + scale action) or "logged_goal" (ctrl is the logged
            `action.<actuator>`, which the task itself made of the action).
        scale: [rad] per 1, (A,).
        offset: added [rad], (A,): the default pose, or zeros.
        clip: largest size of an action; inf for none.
        kp, kd: gains that were trained with [N·m/rad, N·m·s/rad], (A,); None where not said.
    """

    size: int
    law: Law
    scale: np.ndarray
    offset: np.ndarray
    clip: float
    kp: np.ndarray | None
    kd: np.ndarray | None


@dataclass(frozen=True)
class Description:
    """What a policy was trained to see and do.

    Attributes:
        name: of the description, for the report.
        joints: J names in the policy's order.
        actuators: their actuators, (J,).
        rate: control steps a second.
        default_pose: [rad], (J,).
        terms: of one frame, in order.
        history: how frames are stacked.
        clip: largest size of a scaled number; inf for none.
        normalizer: mean and std of the whole vector, (2, size), taken off *before* it is logged;
            None if there is none or the actor holds it.
        action: what becomes of an action.
    """

    name: str
    joints: tuple[str, ...]
    actuators: tuple[str, ...]
    rate: float
    default_pose: np.ndarray
    terms: tuple[Term, ...]
    history: History
    clip: float
    normalizer: np.ndarray | None
    action: ActionLaw

    @property
    def frame_size(self) -> int:
        """Numbers of one frame."""
        return sum(term.size for term in self.terms)

    @property
    def size(self) -> int:
        """D, numbers of the whole vector."""
        return self.frame_size * self.history.length

    def says_sizes(self) -> str:
        """Return the terms with their sizes, for errors."""
        text = ", ".join(f"{term.kind} {term.size}" for term in self.terms)
        frames = self.history.length
        return text if frames == 1 else f"({text}) in {frames} frames"


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
    names = _names(place, "joints", given.get("joints"), joints)
    of_log = dict(zip(joints, actuators or joints, strict=True))
    driven = [of_log.get(name, name) for name in names]
    driving = _names(place, "actuators", given.get("actuators"), driven)
    if len(driving) != len(names):
        raise ContractError(f"{place}: {len(driving)} actuators for {len(names)} joints")
    action = _section(place, given, "action", ACTION_KEYS)
    count = whole(f"{place}, action: size", action.get("size", len(names)), SIZE_MAX)
    listed = given.get("observation")
    if not isinstance(listed, list) or not listed:
        raise ContractError(f"{place}: observation must be a list of terms, not {listed!r}")
    terms = tuple(
        make_term(f"{place}, observation {i + 1}", term, names, count, (SCALE_MAX, SIZE_MAX))
        for i, term in enumerate(listed)
    )
    pose = _pose(place, given.get("default_pose"), names)
    relative = any(term.relative for term in terms)
    history = _history(place, given)
    made = ActionLaw(*_action(place, action, count, pose))
    if pose is None and relative:
        raise ContractError(
            f"{place}: default_pose is missing, but joint_position is relative to it; give the "
            "angle of each joint [rad], or relative: false in the term"
        )
    size = sum(term.size for term in terms) * history.length
    return Description(
        str(given.get("name", Path(place).stem)),
        names,
        driving,
        positive(f"{place}: rate", given.get("rate")),
        np.zeros(len(names)) if pose is None else pose,
        terms,
        history,
        _limit(f"{place}: clip", given.get("clip")),
        _normalizer(place, given, size),
        made,
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
    base = given.get("base")
    if base is None:
        return dict(given), name
    choice(f"{name}: base", base, READY)
    return _merged(_load(base)[0], given), name


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return keys over those of a base; of `action` and `history` each key by itself."""
    both = {**base, **over}
    for key in ("action", "history"):
        if isinstance(base.get(key), Mapping) and isinstance(over.get(key), Mapping):
            both[key] = {**base[key], **over[key]}
    return both


def _section(
    place: str, given: Mapping[str, Any], name: str, keys: tuple[str, ...]
) -> Mapping[str, Any]:
    section = {} if given.get(name) is None else given[name]
    if not isinstance(section, Mapping):
        raise ContractError(f"{place}: {name} {section!r} must have keys: {', '.join(keys)}")
    check_keys(f"{place}, {name}", section, keys)
    return section


def _names(place: str, key: str, given: Any, default: Sequence[str]) -> tuple[str, ...]:
    if given is None:
        return tuple(default)
    return different(f"{place}: {key}", given)


def _pose(place: str, given: Any, joints: tuple[str, ...]) -> np.ndarray | None:
    if given is None:
        return None
    if isinstance(given, Mapping):
        check_keys(f"{place}, default_pose", given, joints)
        missing = [name for name in joints if name not in given]
        if missing:
            raise ContractError(f"{place}, default_pose: {', '.join(missing)} are missing")
        given = [given[name] for name in joints]
    if not isinstance(given, list) or len(given) != len(joints):
        raise ContractError(
            f"{place}: default_pose {given!r} must be {len(joints)} angles [rad], or joint: angle"
        )
    for name, value in zip(joints, given, strict=True):
        if not is_number(value) or not abs(value) <= TURN:
            raise ContractError(
                f"{place}, default_pose: {name} {value!r} must be an angle [rad] within a turn"
            )
    return np.array(given, float)


def _history(place: str, given: Mapping[str, Any]) -> History:
    section = _section(place, given, "history", HISTORY_KEYS)
    length = whole(f"{place}, history: length", section.get("length", 1), HISTORY_MAX)
    layout = choice(f"{place}, history: layout", section.get("layout", "frame"), ("frame", "term"))
    orders = ("oldest_first", "newest_first")
    order = choice(f"{place}, history: order", section.get("order", orders[0]), orders)
    return History(length, layout, order)


def _action(place: str, given: Mapping[str, Any], size: int, pose: np.ndarray | None) -> tuple:
    place = f"{place}, action"
    law = choice(f"{place}: law", given.get("law", "joint_position"),
                  ("joint_position", "logged_goal"))  # fmt: skip
    offset = choice(f"{place}: offset", given.get("offset", "default_pose"),
                     ("default_pose", "zero"))  # fmt: skip
    scale = numbers(f"{place}: scale", given.get("scale", 1.0), size, SCALE_MAX)
    shift = np.zeros(size)
    if law == "joint_position" and offset == "default_pose":
        if pose is None or len(pose) != size:
            raise ContractError(
                f"{place}: the default pose is added to {size} actions, but default_pose "
                f"{'is missing' if pose is None else f'has {len(pose)} angles'}; give it, or "
                "offset: zero"
            )
        shift = pose
    gains = [
        None if given.get(key) is None else numbers(f"{place}: {key}", given[key], size, SCALE_MAX)
        for key in ("kp", "kd")
    ]
    return size, law, scale, shift, _limit(f"{place}: clip", given.get("clip")), *gains


def _limit(place: str, given: Any) -> float:
    return np.inf if given is None else positive(place, given)


def _normalizer(place: str, given: Mapping[str, Any], size: int) -> np.ndarray | None:
    if given.get("normalizer") is None:
        return None
    section = _section(place, given, "normalizer", ("mean", "std"))
    both = []
    for key in ("mean", "std"):
        values = section.get(key)
        if not isinstance(values, list) or len(values) != size:
            count = len(values) if isinstance(values, list) else values
            raise ContractError(f"{place}, normalizer: {key} needs {size} numbers, not {count!r}")
        real = all(is_number(v) and np.isfinite(v) for v in values)
        if not real or (key == "std" and min(values) <= 0):
            raise ContractError(f"{place}, normalizer: {key} must be finite, and std above 0")
        both.append(np.array(values, float))
    return np.stack(both)
