"""Each term of an observation rebuilt from a log's channels, as described and as it may be wrong.

    for variant in variants(term, rows, about): variant.values      # (T, k), SI, before any scale

The first variant is the described one. The others are mistakes that no change of order, sign, scale
or offset can express: another frame, quaternions read in another order, angles of the inverse turn.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from envs.tasks.servo.legs import roll_pitch
from sim2real.diagnosis.contract.description import Description
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.terms import ContractError, Term
from sim2real.diagnosis.data.pairs import TURN

DOWN = np.array([0.0, 0.0, -1.0])
STEP_SLACK = 0.1  # of a step by which a row's time may be early
UNIT_SLACK = 0.1  # of a quaternion's length, beyond which it is none
LAST_FIRST, FIRST_LAST = [3, 0, 1, 2], [1, 2, 3, 0]  # wxyz to xyzw read as wxyz, and back
GRAVITY = 9.81  # m/s²
UPRIGHT_MIN = 0.5  # of g along the mean acceleration, below which the unit or handedness is wrong


class Variant(NamedTuple):
    """One way in which a term may have been made.

    Attributes:
        fault: what it would be called; "" for the described way.
        text: what is wrong then.
        fix: one line.
        values: (T, k), before scaling.
        offset: what is added before scaling, (k,).
        age: steps by which the values are older than the row.
    """

    fault: str
    text: str
    fix: str
    values: np.ndarray
    offset: np.ndarray
    age: int = 0


def variants(term: Term, rows: Rows, about: Description) -> list[Variant]:
    """Return the ways in which a term may have been made, the described one first.

    Raises:
        ContractError: a column that the log lacks, or quaternions that are none.
    """
    none = np.zeros(term.size)
    if term.kind in ("joint_position", "joint_velocity"):
        kind = "qpos" if term.kind == "joint_position" else "qvel"
        pose = dict(zip(about.joints, about.default_pose, strict=True))
        shift = -np.array([pose[name] for name in term.joints]) if term.relative else none
        return [_as_described(rows.matrix([f"{kind}.{name}" for name in term.joints]), shift)]
    if term.kind == "last_action":
        action = [f"action.{i}" for i in range(term.size)]
        return [_as_described(rows.matrix(action), none, 1)]
    if term.kind == "phase":
        steps = np.floor(rows.columns["time"] * about.rate + STEP_SLACK)
        turn = TURN * term.frequency * steps / about.rate
        return [_as_described(np.stack([np.sin(turn), np.cos(turn)], axis=1), none)]
    if term.channels:
        return [_as_described(rows.matrix(term.channels), none)]
    return [Variant(*made, none) for made in _of_imu(term, rows)]


def site_of(term: Term, rows: Rows, kind: str) -> str:
    """Return the IMU's site of a term.

    Raises:
        ContractError: none or several are logged and the term names none.
    """
    if term.site is not None:
        return term.site
    found = sorted({n.split(".")[1] for n in rows.columns if n.startswith(f"{kind}.")})
    if len(found) != 1:
        what = f"the sites {', '.join(found)}" if found else "none"
        raise ContractError(
            f"{rows.place}: {term.kind} needs the columns {kind}.<site>, but the log has {what}; "
            "log them, give the term a site, or describe it as {term: other, size: "
            f"{term.size}}}"
        )
    return found[0]


def orientation(term: Term, rows: Rows) -> np.ndarray:
    """Return the logged quaternions, w first, (T, 4).

    Raises:
        ContractError: they are not logged, or no unit quaternions.
    """
    site = site_of(term, rows, "quat")
    turn = rows.matrix([f"quat.{site}.{part}" for part in "wxyz"])
    length = np.linalg.norm(turn, axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > UNIT_SLACK)
    if bad.size:
        raise ContractError(
            f"{rows.place}, row {bad[0]}, quat.{site}: the length is {length[bad[0]]:.3g}, but "
            "that of an orientation is 1; log unit quaternions, w first"
        )
    return turn


def _as_described(values: np.ndarray, offset: np.ndarray, age: int = 0) -> Variant:
    return Variant("", "", "", values, offset, age)


Made = tuple[str, str, str, np.ndarray]
SHUFFLED = "takes the IMU's quaternion for one of the other order"
INVERSE = "turns the wrong way: by the quaternion's inverse"


def _of_imu(term: Term, rows: Rows) -> list[Made]:
    """Fault, text, fix and values of each way to make a term from an IMU."""
    order_fix = "read the quaternion as {}, which is what the driver sends"
    if term.kind in ("gyro", "accelerometer"):
        return _vector(term, rows)
    turn = orientation(term, rows)
    made = {"": turn, "xyzw": turn[:, LAST_FIRST], "wxyz": turn[:, FIRST_LAST]}
    if term.kind == "quaternion":
        described = turn if term.order == "wxyz" else turn[:, FIRST_LAST]
        other = turn[:, FIRST_LAST] if term.order == "wxyz" else turn
        inverse = described * (np.array([1, -1, -1, -1]) if term.order == "wxyz" else INVERTED)
        return [
            ("", "", "", described),
            ("quaternion_order", "has its numbers in the other order", _order(term), other),
            ("frame", INVERSE, "conjugate it", inverse),
        ]
    see = _gravity if term.kind == "gravity" else roll_pitch
    found: list[Made] = [("", "", "", see(turn))]
    found += [
        ("quaternion_order", SHUFFLED, order_fix.format("wxyz"), see(made["xyzw"])),
        ("quaternion_order", SHUFFLED, order_fix.format("xyzw"), see(made["wxyz"])),
        ("frame", INVERSE, "use the inverse rotation", see(turn * np.array([1, -1, -1, -1]))),
    ]
    return found


INVERTED = np.array([-1, -1, -1, 1])


def _order(term: Term) -> str:
    return f"put its numbers in the order {term.order}"


def _vector(term: Term, rows: Rows) -> list[Made]:
    """A gyro or an accelerometer, in the body's frame, the world's, and turned the wrong way."""
    site = site_of(term, rows, term.kind)
    body = rows.matrix([f"{term.kind}.{site}.{axis}" for axis in "xyz"])
    if term.kind == "accelerometer":
        _check_gravity(body, rows, site)
    if not rows.has([f"quat.{site}.{part}" for part in "wxyz"]):
        if term.frame == "world":
            raise ContractError(
                f"{rows.place}: {term.kind} in the world's frame needs quat.{site}; log it"
            )
        return [("", "", "", body)]
    rotation = _rotation(orientation(term, rows))
    world, twice = rotation.apply(body), rotation.inv().apply(body)
    mine, other = (body, world) if term.frame == "body" else (world, body)
    names = ("world", "body") if term.frame == "body" else ("body", "world")
    fix = f"turn it into the {names[1]}'s frame"
    return [
        ("", "", "", mine),
        ("frame", f"is in the {names[0]}'s frame", fix, other),
        ("frame", INVERSE, fix, twice),
    ]


def _check_gravity(body: np.ndarray, rows: Rows, site: str) -> None:
    """Refuse accelerations of a wrong unit, and a base that falls for the whole log."""
    size = float(np.median(np.linalg.norm(body, axis=1)))
    if UPRIGHT_MIN * GRAVITY < size < GRAVITY / UPRIGHT_MIN:
        return
    in_g = UPRIGHT_MIN < size < 1 / UPRIGHT_MIN
    what = (
        "these are multiples of g; multiply them by 9.81"
        if in_g
        else ("a robot on the ground measures about 9.81; correct the unit, or log one that stands")
    )
    raise ContractError(
        f"{rows.place}: accelerometer.{site} has a median of {size:.3g} m/s²; {what}"
    )


def _rotation(turn: np.ndarray) -> Rotation:
    return Rotation.from_quat(turn, scalar_first=True)


def _gravity(turn: np.ndarray) -> np.ndarray:
    return _rotation(turn).inv().apply(DOWN)
