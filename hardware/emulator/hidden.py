"""The hidden effects of an emulated robot: those of a file, as values of its own models.

    hidden = read_hidden("effects.yaml", robot)
    hidden.coulomb          # N·m, one for each servo

The file is a list of `{effect, where, side, value, extra}`; `where: null` means the whole robot, or
every servo. Other keys (`ci`, `unit`) are read over. The laws themselves are the emulator's own:
friction, play and springs in `mechanics.py`, the servo's in `firmware.py`, masses and contacts in
`model.py`, the bus's in `bus.py`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from hardware.config import Robot
from hardware.errors import RobotError, did_you_mean, format_names

KEYS = ("effect", "where", "side", "value", "ci", "unit", "extra")
# of dry friction: rad by which a joint yields before it breaks away (0: by the emulator's own), and
# the damping ratio there
BRISTLES = {"bristle": 0.0, "ratio": 0.5}
# effect -> its further scalars with their defaults
SERVO_EFFECTS: dict[str, dict[str, float]] = {
    "coulomb_friction": BRISTLES,
    "viscous_friction": {},
    "stribeck_friction": {"speed": 0.5, "shape": 2.0, **BRISTLES},
    "load_dependent_friction": {"external": 0.0, **BRISTLES},
    "backlash": {},
    "joint_compliance": {"damping": 0.0},
    "cogging": {"count": 12.0, "phase": 0.0},
    "armature": {},
    "encoder_offset": {},
    "velocity_filter": {},
    "sensor_noise": {},
    "quantization": {},
    "position_gain": {},
    "derivative_gain": {},
    "motor_strength": {},
    "torque_limit": {},
    "thermal_derating": {"decay": 0.0},
    "dead_zone": {},
    "profile_velocity": {},
    "profile_acceleration": {},
}
NEUTRAL = {
    "position_gain": 1.0,
    "derivative_gain": 1.0,
    "motor_strength": 1.0,
    "torque_limit": math.inf,
    "profile_velocity": math.inf,
    "profile_acceleration": math.inf,
}
ROBOT_EFFECTS = (
    "supply_voltage",
    "supply_sag",
    "command_delay",
    "observation_delay",
    "packet_loss",
)
BODY_EFFECTS = ("link_mass", "center_of_mass", "payload")
IMU_EFFECTS: dict[str, tuple[float, ...]] = {  # and their neutral values
    "imu_mounting": (0.0, 0.0, 0.0),
    "imu_delay": (0.0,),
    "gyro_bias": (0.0, 0.0, 0.0),
    "gyro_scale": (1.0,),
}
CONTACT_EFFECTS = ("ground_friction", "contact_stiffness")
NEGATIVE = ("encoder_offset", "link_mass", "center_of_mass", "phase", "gravity_tilt")
NEGATIVE += ("imu_mounting", "gyro_bias")
EFFECTS = (*SERVO_EFFECTS, *ROBOT_EFFECTS, *BODY_EFFECTS, *CONTACT_EFFECTS, "gravity_tilt")
EFFECTS += tuple(IMU_EFFECTS)


@dataclass
class HiddenEffects:
    """The hidden effects of a robot of n servos, neutral where nothing is hidden.

    Args:
        servo: effect or `effect.extra` to values, (n,), in the units of the effect.
        link_side: whether the encoder is after the play or spring of each servo, (n,) bool.
        robot: command_delay [s], observation_delay [s], supply_voltage, supply_sag [V/A],
            packet_loss.
        body: (effect, body, value) of each body effect.
        contact: (effect, geom or None, value) of each contact effect.
        tilt: the tilt of the base about its x, then its new y axis [rad].
        imu: imu_mounting (a rotation vector [rad]), imu_delay [s], gyro_bias [rad/s], gyro_scale.
    """

    servo: dict[str, np.ndarray]
    link_side: np.ndarray
    robot: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(ROBOT_EFFECTS, 0.0) | {"supply_voltage": 1.0}
    )
    body: list[tuple[str, str, float]] = field(default_factory=list)
    contact: list[tuple[str, str | None, float]] = field(default_factory=list)
    tilt: tuple[float, float] = (0.0, 0.0)
    imu: dict[str, tuple[float, ...]] = field(default_factory=lambda: dict(IMU_EFFECTS))

    def __getitem__(self, name: str) -> np.ndarray:
        return self.servo[name]


def nothing_hidden(count: int) -> HiddenEffects:
    """Return the neutral effects of a number of servos."""
    servo = {}
    for name, extras in SERVO_EFFECTS.items():
        servo[name] = np.full(count, NEUTRAL.get(name, 0.0))
        for extra, value in extras.items():
            servo[f"{name}.{extra}"] = np.full(count, value)
    return HiddenEffects(servo, np.zeros(count, bool))


def read_hidden(path: str | Path | None, robot: Robot) -> HiddenEffects:
    """Read a file of effects for this robot; None hides nothing.

    Raises:
        RobotError: the file is missing or no list of effects, or an entry is wrong; the message
            says which.
    """
    if path is None:
        return nothing_hidden(len(robot.servos))
    path = Path(path)
    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RobotError(f"{path}: the effects cannot be read: {error.strerror}") from None
    except yaml.YAMLError as error:
        raise RobotError(f"{path}: the effects cannot be read as YAML: {error}") from None
    return make_hidden(entries or [], robot, str(path))


def make_hidden(entries: Any, robot: Robot, place: str = "effects") -> HiddenEffects:
    """Build hidden effects from the entries of a file.

    Raises:
        RobotError: an entry names an unknown effect, place or key, or has a value it cannot have.
    """
    if not isinstance(entries, list):
        has = (
            f"a mapping of {format_names(entries)}" if isinstance(entries, dict) else repr(entries)
        )
        raise RobotError(
            f"{place}: a file of effects is a list, but this is {has}; begin each entry with a "
            "dash, as in '- {effect: payload, where: arm, value: 0.1}'; its keys are "
            f"{format_names(KEYS)}"
        )
    hidden = nothing_hidden(len(robot.servos))
    names = _places(robot)
    for number, entry in enumerate(entries, 1):
        _add(hidden, entry, robot, names, f"{place}, entry {number}")
    return hidden


def _places(robot: Robot) -> dict[str, list[str]]:
    """Return the names of the model's bodies and geoms, and the joint of each servo."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    joint = {
        model.actuator(i).name: model.joint(model.actuator_trnid[i, 0]).name
        for i in range(model.nu)
    }
    return {
        "joint": [joint.get(name, name) for name in robot.names],
        "body": [model.body(i).name for i in range(1, model.nbody)],
        "geom": [model.geom(i).name for i in range(model.ngeom)],
    }


def _add(
    hidden: HiddenEffects, entry: Any, robot: Robot, names: Mapping[str, list[str]], place: str
) -> None:
    if not isinstance(entry, Mapping):
        raise RobotError(f"{place}: {entry!r} is not a table with {format_names(KEYS)}")
    for key in entry:
        if key not in KEYS:
            raise RobotError(f"{place}: unknown key {key!r}{did_you_mean(str(key), KEYS)}")
    effect, where, side = entry.get("effect"), entry.get("where"), entry.get("side")
    place = f"{place} ({effect})"
    if effect == "goal":
        raise RobotError(f"{place}: a goal belongs to a task, not to a robot; remove the entry")
    if effect not in EFFECTS:
        hint = did_you_mean(str(effect), EFFECTS)
        raise RobotError(f"{place}: unknown effect{hint}; available: {format_names(EFFECTS)}")
    extra = dict(entry.get("extra") or {})
    if effect == "gravity_tilt":
        x, y = _numbers(entry.get("value"), 2, place, "two angles [rad]")
        hidden.tilt = x, y
        return
    if effect in IMU_EFFECTS:
        _add_imu(hidden, effect, where, entry.get("value"), place)
        return
    value = _number(entry.get("value"), place, effect in NEGATIVE)
    if effect in SERVO_EFFECTS:
        chosen = _servos(where, robot, names["joint"], place)
        _add_servo(hidden, effect, chosen, side, value, extra, place)
    elif effect in ROBOT_EFFECTS:
        if where is not None:
            raise RobotError(f"{place}: it acts on the whole robot; leave out where: {where!r}")
        hidden.robot[effect] = value
    elif effect in BODY_EFFECTS:
        hidden.body.append((str(effect), _one_of(where, names["body"], "body", place), value))
    else:
        geom = None if where is None else _one_of(where, names["geom"], "geom", place)
        hidden.contact.append((str(effect), geom, value))


def _add_servo(
    hidden: HiddenEffects,
    effect: str,
    chosen: list[int],
    side: str | None,
    value: float,
    extra: dict[str, Any],
    place: str,
) -> None:
    if side not in (None, "motor", "link"):
        raise RobotError(f"{place}: side {side!r}; expected 'motor' or 'link'")
    extras = SERVO_EFFECTS[effect]
    for name, number in extra.items():
        if name not in extras:
            hint = did_you_mean(name, extras)
            raise RobotError(
                f"{place}: unknown extra {name!r}{hint}; it has {format_names(extras)}"
            )
        hidden.servo[f"{effect}.{name}"][chosen] = _number(number, place, name in NEGATIVE)
    hidden.servo[effect][chosen] = value
    if effect in ("backlash", "joint_compliance"):
        hidden.link_side[chosen] = side == "link"


def _servos(where: str | None, robot: Robot, joints: list[str], place: str) -> list[int]:
    """Return the servos that `where` names, by actuator or joint; all for None."""
    if where is None:
        return list(range(len(robot.servos)))
    for names in (robot.names, joints):
        if where in names:
            return [names.index(where)]
    hint = did_you_mean(str(where), robot.names)
    raise RobotError(
        f"{place}: no servo or joint {where!r}{hint}; available: {format_names(robot.names)}"
    )


def _one_of(where: str | None, names: list[str], what: str, place: str) -> str:
    if where not in names:
        hint = did_you_mean(str(where), names)
        raise RobotError(f"{place}: no {what} {where!r}{hint}; available: {format_names(names)}")
    return str(where)


def _number(value: Any, place: str, negative: bool) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not good or (value < 0 and not negative):
        wanted = "a finite number" if negative else "a finite number of at least 0"
        raise RobotError(f"{place}: the value {value!r} is not {wanted}")
    return float(value)


def _add_imu(hidden: HiddenEffects, effect: str, where: str | None, value: Any, place: str) -> None:
    if where is not None:
        raise RobotError(f"{place}: it acts on the robot's IMU; leave out where: {where!r}")
    count = len(IMU_EFFECTS[effect])
    if count > 1:
        hidden.imu[effect] = _numbers(value, count, place, f"{count} numbers")
    else:
        hidden.imu[effect] = (_number(value, place, False),)


def _numbers(value: Any, count: int, place: str, what: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        raise RobotError(f"{place}: the value {value!r} is not a list of {what}")
    return tuple(_number(part, place, True) for part in value)
