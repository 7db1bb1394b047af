"""Logs of joints under impedance control ("MIT mode"), in a model's terms.

    spec = with_laws(spec, log)             # its actuators take the gains of each row
    laws_of(log, model)                     # (T, nu, 4): what `envs.replay.impedance` replays

A log has `kp.<actuator>` and, where they are not 0, `kd`, `qvel_des` and `torque_ff` of the same
actuator; its `ctrl` is then the desired position [rad or m of the joint]. The model may call the
actuator a motor or a servo: gains and limits of a servo's own law give way to the rows'.
"""

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.replay import with_impedance
from envs.replay.impedance import impedances
from hardware.errors import LogError
from hardware.formats.names import IMPEDANCE_KINDS
from hardware.log import Log

STIFFNESS, REST = IMPEDANCE_KINDS[0], IMPEDANCE_KINDS[1:]


def impedance_of(log: Log) -> tuple[str, ...]:
    """Return the actuators under impedance control.

    Raises:
        LogError: an actuator that has a damping, a desired speed or a feed-forward, and no gain.
    """
    for column in log.columns:
        kind, _, actuator = column.partition(".")
        if kind in REST and f"{STIFFNESS}.{actuator}" not in log.columns:
            raise LogError(
                f"{log.path or 'the log'}: there is `{column}` and no `{STIFFNESS}.{actuator}`, so "
                f"the law of {actuator} is not known; log its gain [N·m/rad], 0 where it is off"
            )
    return tuple(name for name in log.actuators if f"{STIFFNESS}.{name}" in log.columns)


def with_laws(spec: mujoco.MjSpec, log: Log) -> mujoco.MjSpec:
    """Return the spec whose actuators take the gains of the log's rows; itself where it has none.

    Reference gains are the medians of those that are not 0.

    Raises:
        LogError: gains that are missing or negative, or of an actuator of the model that can have
            none.
    """
    names = impedance_of(log)
    if not names:
        return spec
    gears, gains = {own.name: float(own.gear[0]) for own in spec.actuators}, {}
    for name in names:
        usual = (_usual(log, kind, name) for kind in IMPEDANCE_KINDS[:2])
        gains[name] = tuple(gain / gears.get(name, 1.0) ** 2 for gain in usual)
    try:
        return with_impedance(spec, gains)
    except TaskError as error:
        raise LogError(
            f"{log.path or 'the log'} has gains of {', '.join(names)}: {error}; correct the model, "
            "or remove the columns"
        ) from None


def laws_of(log: Log, model: mujoco.MjModel) -> np.ndarray | None:
    """Return the law of each row in the actuators' own terms, (T, nu, 4); None: no gains."""
    names = impedance_of(log)
    if not names:
        return None
    law = np.zeros((len(log), model.nu, len(IMPEDANCE_KINDS)))
    for index in impedances(model):
        name, gear = model.actuator(index).name, float(model.actuator_gear[index, 0])
        turns = (1 / gear**2, 1 / gear**2, gear, 1 / gear)
        for place, (kind, turn) in enumerate(zip(IMPEDANCE_KINDS, turns, strict=True)):
            law[:, index, place] = turn * _column(log, kind, name)
    return law


def gear_of(model: mujoco.MjModel, actuator: int) -> float:
    """Return what turns a logged command of an actuator into the actuator's own unit."""
    return float(model.actuator_gear[actuator, 0]) if actuator in impedances(model) else 1.0


def _usual(log: Log, kind: str, name: str) -> float:
    """Return the median of a gain where it is not 0, else 0; raise LogError if it is negative."""
    values = _column(log, kind, name)
    if values.min() < 0:
        row = int(values.argmin())
        raise LogError(
            f"{log.path or 'the log'}, row {row}, column '{kind}.{name}': a gain of "
            f"{values[row]:g} is negative; gains are 0 or more"
        )
    return float(np.median(values[values > 0])) if values.any() else 0.0


def _column(log: Log, kind: str, name: str) -> np.ndarray:
    return log.columns.get(f"{kind}.{name}", np.zeros(len(log)))
