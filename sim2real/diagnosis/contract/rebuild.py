"""Each term of an observation rebuilt from a log's channels, as described and as it may be wrong.

    for variant in variants(term, rows, about): variant.values      # (T, k), SI, before any scale

The first variant is the described one. The others are mistakes that no change of order, sign, scale
or offset can express: another frame, quaternions read in another order, angles of the inverse turn.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from envs.tasks.servo.legs import roll_pitch
from sim2real.diagnosis.contract.description import Description
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.terms import AXES, JOINTS, ContractError, Term
from sim2real.diagnosis.data.pairs import TURN

DOWN = np.array([0.0, 0.0, -1.0])
STEP_SLACK = 0.1  # of a step by which a row's time may be early
UNIT_SLACK = 0.1  # of a quaternion's length, beyond which it is none
WXYZ, XYZW = [0, 1, 2, 3], [1, 2, 3, 0]  # places of a quaternion's numbers where w is logged first
LAST_FIRST = [3, 0, 1, 2]  # xyzw read as wxyz
CONJUGATE = np.array([1, -1, -1, -1])
GRAVITY = 9.81  # m/s²
UPRIGHT_MIN = 0.5  # of g along the mean acceleration, below which the unit or handedness is wrong
SHUFFLED = "takes the IMU's quaternion for one of the other order"
INVERSE = "turns the wrong way: by the quaternion's inverse"


class Mistake(NamedTuple):
    """What may be wrong with a whole term."""

    fault: str  # its kind, such as "frame"
    text: str  # what is wrong, after the term's name
    fix: str  # one line
    value: float | None = None  # fitted or counted, such as an age in steps; None for none
    price: float = 1.0  # of the change, in that of one without a fitted value


class Variant(NamedTuple):
    """One way in which a term may have been made."""

    mistake: Mistake | None  # what is wrong then; None for the described way
    values: np.ndarray  # (T, k), before scaling
    offset: np.ndarray  # what is added before scaling, (k,)
    age: int = 0  # steps by which the values are older than the row


def variants(term: Term, rows: Rows, about: Description) -> list[Variant]:
    """Return the ways in which a term may have been made, the described one first.

    Raises:
        ContractError: a column that the log lacks, or quaternions that are none.
    """
    offset, age = np.zeros(term.size), 0
    if term.kind in JOINTS:
        kind = "qpos" if term.kind == "joint_position" else "qvel"
        values = rows.matrix([f"{kind}.{name}" for name in term.elements])
        if term.relative:
            pose = dict(zip(about.joints, about.default_pose, strict=True))
            offset = -np.array([pose[name] for name in term.elements])
    elif term.kind == "last_action":
        values, age = rows.matrix([f"action.{name}" for name in term.elements]), 1
    elif term.kind == "phase":
        steps = np.floor(rows.columns["time"] * about.rate + STEP_SLACK)
        turn = TURN * term.frequency * steps / about.rate
        values = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    elif term.channels:
        values = rows.matrix(term.channels)
    else:
        make = _vectors if term.kind in ("gyro", "accelerometer") else _orientations
        return [Variant(mistake, values, offset) for mistake, values in make(term, rows)]
    return [Variant(None, values, offset, age)]


def gravity(turn: np.ndarray) -> np.ndarray:
    """Return the direction of gravity in the frame of orientations (T, 4), w first, (T, 3)."""
    return Rotation.from_quat(turn, scalar_first=True).inv().apply(DOWN)


Made = Iterator[tuple[Mistake | None, np.ndarray]]


def _orientations(term: Term, rows: Rows) -> Made:
    """Yield what may be wrong with what is seen of an orientation, and what is seen then."""
    turn = _quaternions(rows, _site(term, rows, "quat"))
    if term.kind == "quaternion":
        own, other = (WXYZ, XYZW) if term.elements[0] == "w" else (XYZW, WXYZ)
        fix = f"put its numbers in the order {''.join(term.elements)}"
        yield None, turn[:, own]
        yield Mistake("quaternion_order", "has its numbers in the other order", fix), turn[:, other]
        yield Mistake("frame", INVERSE, "conjugate it"), (turn * CONJUGATE)[:, own]
        return
    see = gravity if term.kind == "gravity" else roll_pitch
    yield None, see(turn)
    for order, places in (("wxyz", LAST_FIRST), ("xyzw", XYZW)):
        fix = f"read the quaternion as {order}, which is what the driver sends"
        yield Mistake("quaternion_order", SHUFFLED, fix), see(turn[:, places])
    yield Mistake("frame", INVERSE, "use the inverse rotation"), see(turn * CONJUGATE)


def _vectors(term: Term, rows: Rows) -> Made:
    """Yield a gyro or an accelerometer in its own frame, in the other, and turned the wrong way."""
    site = _site(term, rows, term.kind)
    body = rows.matrix([f"{term.kind}.{site}.{axis}" for axis in AXES])
    if term.kind == "accelerometer":
        _check_gravity(body, rows, site)
    if term.frame == "body" and f"quat.{site}.w" not in rows.columns:
        yield None, body
        return
    rotation = Rotation.from_quat(_quaternions(rows, site), scalar_first=True)
    seen = {"body": body, "world": rotation.apply(body)}
    fix = f"turn it into the {term.frame}'s frame"
    yield None, seen.pop(term.frame)
    for frame, values in seen.items():
        yield Mistake("frame", f"is in the {frame}'s frame", fix), values
    yield Mistake("frame", INVERSE, fix), rotation.inv().apply(body)


def _site(term: Term, rows: Rows, kind: str) -> str:
    """Return the IMU's site of a term: the one that it names, or the only one in the log."""
    found = sorted({n.split(".")[1] for n in rows.columns if n.startswith(f"{kind}.")})
    if term.site is None and len(found) != 1:
        what = f"the sites {', '.join(found)}" if found else "none"
        raise ContractError(
            f"{rows.place}: {term.kind} needs the columns {kind}.<site>, but the log has {what}; "
            "log them, give the term a site, or describe it as {term: other, size: "
            f"{term.size}}}"
        )
    return term.site or found[0]


def _quaternions(rows: Rows, site: str) -> np.ndarray:
    """Return the logged orientations, w first, (T, 4)."""
    turn = rows.matrix([f"quat.{site}.{part}" for part in "wxyz"])
    length = np.linalg.norm(turn, axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > UNIT_SLACK)
    if bad.size:
        raise ContractError(
            f"{rows.place}, row {bad[0]}, quat.{site}: the length is {length[bad[0]]:.3g}, but "
            "that of an orientation is 1; log unit quaternions, w first"
        )
    return turn


def _check_gravity(body: np.ndarray, rows: Rows, site: str) -> None:
    """Refuse accelerations of a wrong unit, and a base that falls for the whole log."""
    size = float(np.median(np.linalg.norm(body, axis=1)))
    if UPRIGHT_MIN * GRAVITY < size < GRAVITY / UPRIGHT_MIN:
        return
    what = "a robot on the ground measures about 9.81; correct the unit, or log one that stands"
    if UPRIGHT_MIN < size < 1 / UPRIGHT_MIN:
        what = "these are multiples of g; multiply them by 9.81"
    raise ContractError(
        f"{rows.place}: accelerometer.{site} has a median of {size:.3g} m/s²; {what}"
    )
