"""What could be missing: every effect that this robot can have, at every place.

    for candidate in candidates(data, exclude=("backlash",)):
        candidate.effect.label(), candidate.probes      # (K, P) values to look at first

The vocabulary is that of `envs.effects`; an effect that a user registers is a candidate too. Noise,
quantization, the filter of the speed and lost packets are not: they are read off the log, and
simulating the same noise closes no gap.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from envs.effects import EFFECTS, Effect, make
from envs.effects.base import FieldEffect
from envs.effects.inertia import far_end
from envs.effects.structure import SeriesEffect, link_inertia
from envs.errors import EnvsError, did_you_mean
from sim2real.diagnosis.data import Data
from sim2real.errors import Sim2RealError

MEASURED = ("sensor_noise", "quantization", "velocity_filter", "packet_loss")
LOOKS = ".appearance"  # the module of effects that only a camera sees
PLAIN = (
    "position_gain",
    "derivative_gain",
    "supply_voltage",
    "motor_strength",
    "command_delay",
    "observation_delay",
    "gravity_tilt",
)
PLAIN += ("center_of_mass", "payload", "contact_stiffness", "encoder_offset")  # in one batch
FREE = 1e5  # a limit of this size is none
FASTEST = 8.0  # rad/s: of a servo whose model does not say


@dataclass(frozen=True)
class Candidate:
    """An effect at a place, and where a fit of it starts.

    Args:
        effect: the effect.
        joint: the joint whose motion shows it first; None for the robot.
        probes: values of its parameters that span what may be, (K, P).
        neutral: values at which it is absent, (P,).
        low: smallest values, (P,).
        high: largest values, (P,).
        group: candidates of one group can be simulated in one batch.
        shown: joints whose motion it changes: its own, and for a body all that carry it.
    """

    effect: Effect
    joint: str | None
    probes: np.ndarray
    neutral: np.ndarray
    low: np.ndarray
    high: np.ndarray
    group: str
    shown: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The effect's standard name."""
        return self.effect.name

    @property
    def label(self) -> str:
        """Name, place and side: what tells candidates apart."""
        side = f" ({self.effect.side} side)" if self.effect.side else ""
        logged = " (log only)" if self.effect.extra.get("servo") == 0.0 else ""
        return f"{self.effect.label()}{side}{logged}"

    @property
    def place(self) -> str | None:
        """What a report calls its place: a body effect's is the joint that moves the body."""
        return self.joint if self.effect.place == "body" else self.effect.where

    @property
    def step(self) -> np.ndarray:
        """The size of a typical change of each parameter, (P,)."""
        changes = np.where(self.neutral >= FREE, self.probes, self.probes - self.neutral)
        return 0.3 * np.abs(changes).max(axis=0)

    def towards(self, point: np.ndarray, scale: float) -> np.ndarray:
        """Return the point at which the effect is `scale` times as large as at `point`, (P,).

        Phases and the like stay; a limit that is neutral at a huge value shrinks as it acts more.
        """
        grown = self.neutral + scale * (point - self.neutral)
        grown = np.where(self.neutral >= FREE, point / np.maximum(scale, 1e-3), grown)
        free = len(self.effect.free)
        kept = np.arange(len(point)) >= len(point) - free
        return np.clip(np.where(kept, point, grown), self.low, self.high)


def check_names(exclude: Sequence[str]) -> None:
    """Raise Sim2RealError for the name of an effect that does not exist."""
    for name in exclude:
        if name not in EFFECTS:
            known = ", ".join(sorted(EFFECTS))
            raise Sim2RealError(
                f"exclude: there is no effect {name!r}{did_you_mean(name, EFFECTS)};"
                f" there are: {known}"
            )


def candidates(data: Data, exclude: Sequence[str] = ()) -> list[Candidate]:
    """Return every effect that the models can have, but those excluded.

    Raises:
        Sim2RealError: an unknown name to exclude.
    """
    check_names(exclude)
    robot = Robot(data)
    found = []
    for name in EFFECTS:
        shown = EFFECTS[name].__module__.endswith(LOOKS)
        if name not in MEASURED and name not in exclude and not shown:
            for arguments in _places(name, robot):
                candidate = _make(name, arguments, robot)
                if candidate is not None:
                    found.append(candidate)
    return found


class Robot:
    """Sizes of a robot, from which typical values of effects on it follow.

    Attributes:
        torque: the largest of each actuator at its joint [N·m], by actuator.
        joint_torque: the same by joint.
    """

    def __init__(self, data: Data) -> None:
        self.data, self.model = data, data.models[0]
        model = self.model
        self.joints = [joint.name for joint in data.joints]
        self.spread = {joint.name: joint.spread for joint in data.joints}
        self.actuators = [model.actuator(i).name for i in range(model.nactuator)]
        self.driven = {
            self.actuators[i]: model.joint(int(model.actuator_trnid[i, 0])).name
            for i in range(model.nactuator)
            if int(model.actuator_trntype[i]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        }
        self.torque = {name: self._torque(i) for i, name in enumerate(self.actuators)}
        self.joint_torque = {j: self.torque[a] for a, j in self.driven.items()}
        self.mass = float(model.body_mass[1:].sum())
        self.voltage = float(data.logs[0].meta.get("supply_voltage", 0.0) or 0.0)
        span = max(w.recording.time[-1] for w in data.windows)
        self.span = span

    def _torque(self, i: int) -> float:
        model = self.model
        gear = abs(float(model.actuator_gear[i, 0])) or 1.0
        if model.actuator_forcelimited[i]:
            return float(model.actuator_forcerange[i, 1]) * gear
        return max(float(abs(model.actuator_biasprm[i, 1])) * 0.5, 1e-3) * gear

    def fastest(self, actuator: str) -> float:
        """The fastest that an actuator's commands move for a tenth of their time [rad/s]."""
        speeds = []
        for log in self.data.logs:
            column = f"ctrl.{actuator}"
            if column in log.columns:
                same = np.diff(log.episode) == 0
                speeds.append(np.abs(np.diff(log.columns[column]) / np.diff(log.time))[same])
        return float(np.quantile(np.concatenate(speeds), 0.97)) if speeds else FASTEST

    def torque_constant(self) -> tuple[float, float] | None:
        """The supply [V] and the motors' constant [N·m/A], from stall torque and back-EMF."""
        model, volts = self.model, self.voltage or 12.0
        limits = model.actuator_forcerange[:, 1] * model.actuator_forcelimited.astype(bool)
        if not (limits > 0).any() or model.actuator_damping is None:
            return None
        damping = np.atleast_2d(model.actuator_damping.reshape(model.nactuator, -1))[:, 0]
        good = (limits > 0) & (damping > 0)
        if not good.any():
            return volts, 1.0
        return volts, float(np.mean(volts * damping[good] / limits[good]))


def _places(name: str, robot: Robot) -> Iterator[dict[str, Any]]:
    """Yield the arguments of an effect at each place of the robot."""
    effect = EFFECTS[name]
    sides: list[dict[str, Any]] = [{"side": side} for side in effect.sides] or [{}]
    if effect.place == "joint":
        places: list[str | None] = [*robot.joints]
    elif effect.place == "actuator":
        places = [*robot.actuators]
    elif effect.place == "body":
        places = [robot.model.body(i).name for i in range(1, robot.model.nbody)]
        places = [p for p in places if _moving_joint(robot, str(p)) is not None]
    else:
        places = [None]
    more: list[dict[str, Any]] = [{}]
    if name == "encoder_offset":
        more = [{"servo": 1.0}, {"servo": 0.0}]
    elif name == "cogging":
        more = [{"free": ("phase",)}]
    elif name == "supply_sag":
        constant = robot.torque_constant()
        if constant is None:
            return
        more = [{"voltage": constant[0], "torque_constant": constant[1]}]
    elif any(extra.default is None for extra in effect.extras):
        more = []
    for place, side, extra in itertools.product(places, sides, more):
        yield {"where": place, **side, **extra}


def _make(name: str, arguments: dict[str, Any], robot: Robot) -> Candidate | None:
    """Return the candidate, or None where the robot cannot have it."""
    try:
        effect = make(name, **arguments)
        spec = robot.data.specs[0].copy()
        effect.edit(spec)
        parameters = effect.parameters(spec.compile() if _edits(effect) else robot.model)
    except EnvsError:
        return None
    neutral = np.array([p.neutral for p in parameters])
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    probes = _probes(effect, neutral, robot)
    probes = np.clip(probes, low, high)
    probes = probes[(np.abs(probes - neutral) > 1e-12).any(axis=1)]
    if not len(probes):
        return None
    joint = _joint(effect, robot)
    shown = (joint,) if joint else ()
    if effect.place == "body":
        shown = _carriers(robot, str(effect.where))
    return Candidate(effect, joint, probes, neutral, low, high, _group(effect), shown)


def _edits(effect: Effect) -> bool:
    return type(effect).edit is not Effect.edit


def _group(effect: Effect) -> str:
    if effect.extra.get("servo") == 0.0:
        return "log offset"
    if isinstance(effect, FieldEffect) or effect.name in PLAIN:
        return "plain"
    if isinstance(effect, SeriesEffect):
        return f"{effect.label()} {effect.side}"
    return "rules" if type(effect).__module__.startswith("envs.") else effect.name


def _joint(effect: Effect, robot: Robot) -> str | None:
    if effect.where is None:
        return None
    if effect.place == "joint":
        return effect.where
    if effect.place == "actuator":
        return robot.driven.get(effect.where)
    return _moving_joint(robot, effect.where) if effect.place == "body" else None


def _moving_joint(robot: Robot, body: str) -> str | None:
    """Return the compared joint nearest above a body."""
    return next(iter(_carriers(robot, body)), None)


def _carriers(robot: Robot, body: str) -> tuple[str, ...]:
    """Return the compared joints that carry a body, the nearest first."""
    model, found = robot.model, []
    index = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body))
    while index > 0:
        first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
        names = [model.joint(j).name for j in range(first, first + count)]
        found += [n for n in reversed(names) if n in robot.joints]
        index = int(model.body_parentid[index])
    return tuple(found)


def _probes(effect: Effect, neutral: np.ndarray, robot: Robot) -> np.ndarray:
    """Return values that span what the effect may be on this robot, (K, P)."""
    law = _PROBES.get(effect.name)
    if law is not None:
        values = np.asarray(law(effect, robot), dtype=np.float64)
    elif effect.hows[0] == "scale":
        values = np.array([0.5, 0.75, 1.3, 1.8])
    else:
        low, high = effect.typical
        values = low + (high - low) * np.array([0.08, 0.25, 0.7])
        values = np.concatenate([values, -values]) if low < 0 else values
    values = values.reshape(-1, 1) if values.ndim == 1 else values
    if values.shape[1] < len(neutral):
        rest = np.tile(neutral[values.shape[1] :], (len(values), 1))
        values = np.column_stack([values, rest])
    return values


def _torque(effect: Effect, robot: Robot) -> float:
    """The largest torque at the effect's place [N·m]."""
    found = {**robot.torque, **robot.joint_torque}.get(str(effect.where))
    return found or float(np.mean(list(robot.torque.values()) or [1.0]))


def _friction(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([0.01, 0.035, 0.12, 0.35]) * _torque(effect, robot)


def _viscous(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([0.02, 0.1, 0.4, 1.2]) * _torque(effect, robot) / FASTEST


def _cogging(effect: Effect, robot: Robot) -> np.ndarray:
    phases = np.arange(4) * np.pi / 2
    sizes = np.array([0.02, 0.1]) * _torque(effect, robot)
    return np.array([(size, phase) for size in sizes for phase in phases])


def _inertia(effect: Effect, robot: Robot) -> np.ndarray:
    model = robot.model
    joint = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, str(effect.where)))
    own = float(model.dof_armature[model.jnt_dofadr[joint]])
    return np.append(np.array([0.1, 0.4, 1.5]) * (link_inertia(model, joint) + own), -0.4 * own)


def _spring(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([0.005, 0.02, 0.08, 0.3]) / _torque(effect, robot)


def _limit(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([0.7, 0.45, 0.25, 0.12]) * _torque(effect, robot)


def _sag(effect: Effect, robot: Robot) -> np.ndarray:
    volts, constant = effect.extra["voltage"], effect.extra["torque_constant"]
    total = sum(robot.torque.values())
    return np.array([0.1, 0.4, 1.5]) * volts * constant / total


def _heat(effect: Effect, robot: Robot) -> np.ndarray:
    torque, span = (
        _torque(effect, robot),
        sum(float(log.time[-1] - log.time[0]) for log in robot.data.logs),
    )
    return np.array([0.3, 2.0, 12.0]) / (0.01 * torque**2 * span)


def _speed(effect: Effect, robot: Robot) -> np.ndarray:
    fastest = max(robot.fastest(str(effect.where)), 0.1)
    return np.array([0.8, 0.5, 0.25, 0.12]) * fastest


def _acceleration(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([120.0, 50.0, 20.0, 8.0])


def _mass(effect: Effect, robot: Robot) -> np.ndarray:
    own = float(robot.model.body(str(effect.where)).mass[0])
    return np.array([-0.3 * own, 0.3 * own, 0.1 * robot.mass, 0.4 * robot.mass])


def _load(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([0.03, 0.12, 0.4]) * robot.mass


def _center(effect: Effect, robot: Robot) -> np.ndarray:
    body = int(mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_BODY, str(effect.where)))
    length = float(np.linalg.norm(far_end(robot.model, body)))
    return np.array([-0.4, -0.12, 0.12, 0.4]) * length


def _tilt(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([[0.06, 0.0], [-0.06, 0.0], [0.0, 0.06], [0.0, -0.06]])


_PROBES: dict[str, Callable[[Effect, Robot], np.ndarray]] = {
    "coulomb_friction": _friction,
    "stribeck_friction": _friction,
    "viscous_friction": _viscous,
    "load_dependent_friction": lambda e, r: np.array([0.03, 0.12, 0.4]),
    "cogging": _cogging,
    "armature": _inertia,
    "backlash": lambda e, r: np.array([0.004, 0.015, 0.05, 0.15]),
    "joint_compliance": _spring,
    "torque_limit": _limit,
    "dead_zone": lambda e, r: np.array([0.004, 0.012, 0.035]),
    "supply_sag": _sag,
    "thermal_derating": _heat,
    "command_delay": lambda e, r: np.array([0.003, 0.01, 0.03, 0.07]),
    "observation_delay": lambda e, r: np.array([0.003, 0.01, 0.03, 0.07]),
    "profile_velocity": _speed,
    "profile_acceleration": _acceleration,
    "encoder_offset": lambda e, r: np.array([-0.05, -0.012, 0.012, 0.05]),
    "link_mass": _mass,
    "payload": _load,
    "center_of_mass": _center,
    "gravity_tilt": _tilt,
}
