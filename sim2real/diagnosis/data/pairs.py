"""Logs and the models they belong to: what they have in common, and how they are named."""

import math
from collections.abc import Iterator, Sequence

import mujoco

from hardware.log import Log

Pairs = list[tuple[Log, mujoco.MjModel]]
SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
TURN = 2 * math.pi  # rad
TWELVE_BITS = TURN / 4096  # rad: the count of an encoder of usual servos
SHOWN = 3  # logs that a sentence names


def is_scalar(model: mujoco.MjModel, joint: int) -> bool:
    """Return whether a joint, by its number, is a hinge or a slide."""
    return int(model.jnt_type[joint]) in SCALAR


def scalars(log: Log) -> list[str]:
    """Return the logged hinges and slides."""
    return [name for name in log.joints if f"qpos.{name}" in log.columns]


def carriers(model: mujoco.MjModel, body: int) -> list[int]:
    """Return a body and those that carry it, but the world."""
    found = []
    while body > 0:
        found.append(body)
        body = int(model.body_parentid[body])
    return found


def joints_of(pairs: Pairs) -> list[str]:
    """The hinges and slides that are logged, in the first model's order."""
    logged = {name for log, _ in pairs for name in log.joints}
    names = [m.joint(i).name for _, m in pairs for i in range(m.njnt) if is_scalar(m, i)]
    return [name for name in dict.fromkeys(names) if name in logged]


def unit_of(pairs: Pairs, joint: str) -> str:
    """Return rad for a hinge, m for a slide."""
    kinds = {m.joint(i).name: m.jnt_type[i] for _, m in pairs for i in range(m.njnt)}
    return "rad" if kinds[joint] == mujoco.mjtJoint.mjJNT_HINGE else "m"


def actuators_of(pairs: Pairs) -> list[str]:
    """Return the actuators whose commands are logged, in the logs' order."""
    return list(dict.fromkeys(name for log, _ in pairs for name in log.actuators))


def episodes_with(pairs: Pairs, *columns: str) -> list[Log]:
    """Return the episodes of the logs that have all these columns."""
    logs = [log for log, _ in pairs if all(name in log.columns for name in columns)]
    return [part for log in logs for part in log.episodes()]


def driven_by(model: mujoco.MjModel, actuator: str) -> tuple[int, str] | None:
    """Return an actuator's index and the joint that it drives; None where it drives none."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator)
    if index < 0 or model.actuator_trntype[index] != mujoco.mjtTrn.mjTRN_JOINT:
        return None
    return index, model.joint(int(model.actuator_trnid[index, 0])).name


def commands_of(pairs: Pairs, actuator: str) -> Iterator[tuple[Log, mujoco.MjModel, int, str]]:
    """Yield log, model, index and joint where a log commands an actuator that drives a joint."""
    for log, model in pairs:
        driven = driven_by(model, actuator)
        if driven is not None and actuator in log.actuators:
            yield log, model, *driven


def name_of(log: Log, otherwise: str = "the log") -> str:
    """Return the name of a log's file; of one in memory what it is called otherwise."""
    return log.path.name if log.path else otherwise


def which(found: Sequence[tuple], pairs: Pairs) -> str:
    """Say which logs, where it is not all of them."""
    if len(found) == len(pairs):
        return "" if len(pairs) == 1 else " in every log"
    names = ", ".join(name_of(item[0]) for item in found[:SHOWN])
    return f" in {len(found)} of {len(pairs)} logs ({names}{', …' if len(found) > SHOWN else ''})"
