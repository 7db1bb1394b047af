"""Values that span what an effect may be on a robot: where screening looks first.

    probes_of(effect, neutral, Robot(data))     # (K, P)

They follow from the robot's own sizes: friction from its motors' torque, speeds from its commands.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cached_property

import mujoco
import numpy as np

from envs.effects import Effect
from envs.effects.inertia import far_end
from envs.effects.structure import link_inertia
from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.thermal import Heat

MOST = 0.9  # of the model's own friction that a probe takes away
FASTEST = 8.0  # rad/s: of a servo whose model does not say


class Robot:
    """Sizes of a robot, from which typical values of effects on it follow.

    Args:
        data: the logs and their models.
        fixed: effects that are in the model already.

    Attributes:
        torque: the largest of each actuator at its joint [N·m], by actuator.
        joint_torque: the same by joint.
    """

    def __init__(self, data: Data, fixed: Sequence[Fixed] = ()) -> None:
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
        self.span, self._fixed = span, tuple(fixed)

    def _torque(self, i: int) -> float:
        model = self.model
        gear = abs(float(model.actuator_gear[i, 0])) or 1.0
        if model.actuator_forcelimited[i]:
            return float(model.actuator_forcerange[i, 1]) * gear
        return max(float(abs(model.actuator_biasprm[i, 1])) * 0.5, 1e-3) * gear

    def heat(self, actuator: str) -> float:
        """What an actuator's squared torque adds up to in the hardest of the logs [N²·m²·s]."""
        place = self.actuators.index(actuator)
        return max(
            float(np.trapezoid(self._squares.squares(number)[:, place], log.time))
            for number, log in enumerate(self.data.logs)
        )

    @cached_property
    def _squares(self) -> Heat:
        return Simulator(self.data, self._fixed).heat

    def own(self, field: np.ndarray, joint: str | None) -> float:
        """Return a joint's entry of one of the model's fields of degrees of freedom."""
        return float(field[self.model.jnt_dofadr[self.model.joint(str(joint)).id]])

    def speeds(self, actuator: str) -> tuple[float, float]:
        """How fast an actuator is told to move in all but 3 % of the time, and at most [rad/s]."""
        found = []
        for log in self.data.logs:
            column = f"ctrl.{actuator}"
            if column in log.columns:
                same = np.diff(log.episode) == 0
                found.append(np.abs(np.diff(log.columns[column]) / np.diff(log.time))[same])
        if not found:
            return FASTEST, FASTEST
        usual, most = np.quantile(np.concatenate(found), (0.97, 1.0))
        return max(float(usual), 0.1), float(most)

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


def probes_of(effect: Effect, neutral: np.ndarray, robot: Robot) -> np.ndarray:
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
    sizes = np.array([0.01, 0.035, 0.12, 0.35]) * _torque(effect, robot)
    return _with_less(sizes, robot.own(robot.model.dof_frictionloss, effect.where))


def _with_less(sizes: np.ndarray, own: float) -> np.ndarray:
    """Return what may be added to a joint's own friction, and most of that taken away."""
    return np.append(sizes, -MOST * own) if own > 0 else sizes


def _stribeck(effect: Effect, robot: Robot) -> np.ndarray:
    sizes = np.array([0.01, 0.035, 0.12, 0.35]) * _torque(effect, robot)
    return np.array(list(itertools.product(sizes, (0.25, 0.8))))


def _load_friction(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array(list(itertools.product((0.03, 0.12, 0.4), (0.0, 1.0))))


def _viscous(effect: Effect, robot: Robot) -> np.ndarray:
    sizes = np.array([0.02, 0.1, 0.4, 1.2]) * _torque(effect, robot) / FASTEST
    return _with_less(sizes, robot.own(robot.model.dof_damping, effect.where))


def _cogging(effect: Effect, robot: Robot) -> np.ndarray:
    """Rough ones: the error itself shows better ones (`ripples`)."""
    phases = np.arange(4) * np.pi / 2
    return np.array([(0.05 * _torque(effect, robot), 12.0, phase) for phase in phases])


def _inertia(effect: Effect, robot: Robot) -> np.ndarray:
    model = robot.model
    joint = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, str(effect.where)))
    own = robot.own(model.dof_armature, effect.where)
    return np.append(np.array([0.1, 0.4, 1.5]) * (link_inertia(model, joint) + own), -0.4 * own)


def _spring(effect: Effect, robot: Robot) -> np.ndarray:
    """Springs that a torque bends little and much, with a third of their critical damping.

    With much less, a loop that is closed behind the spring swings by itself.
    """
    soft = np.array([0.005, 0.02, 0.08, 0.3, 0.8]) / _torque(effect, robot)
    joint = int(mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_JOINT, str(effect.where)))
    return np.column_stack([soft, 0.6 * np.sqrt(link_inertia(robot.model, joint) / soft)])


def _limit(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([0.7, 0.45, 0.25, 0.12, 0.04]) * _torque(effect, robot)  # light joints too


def _sag(effect: Effect, robot: Robot) -> np.ndarray:
    volts, constant = effect.extra["voltage"], effect.extra["torque_constant"]
    total = sum(robot.torque.values())
    return np.array([0.1, 0.4, 1.5]) * volts * constant / total


def _heat(effect: Effect, robot: Robot) -> np.ndarray:
    return np.array([0.15, 0.6, 2.5]) / max(robot.heat(str(effect.where)), 1e-9)


def _speed(effect: Effect, robot: Robot) -> np.ndarray:
    """Limits that slow the usual motion, and one that slows only steps, if there are steps."""
    usual, most = robot.speeds(str(effect.where))
    sizes = np.array([0.8, 0.5, 0.25, 0.12]) * usual
    return np.append(sizes, np.sqrt(usual * most)) if most > 2 * usual else sizes


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
    "stribeck_friction": _stribeck,
    "viscous_friction": _viscous,
    "load_dependent_friction": _load_friction,
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
