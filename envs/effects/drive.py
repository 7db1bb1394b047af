"""Effects inside a motor's drive: what its voltage, its current loop and its integrator do.

Each acts before every physics substep on the law, or on the range, of the actuators that it knows.
"""

from __future__ import annotations

from typing import Any, ClassVar

import mujoco
import numpy as np

from envs.effects.base import BOTH, RULES, Extra
from envs.effects.bound import SubstepRule
from envs.effects.history import DelayedCommands
from envs.effects.places import block, joint_driven
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.effects.servo import ActuatorEffect, is_joint_servo, is_linear, limited
from envs.params import How
from envs.physics.arrays import Array

NO_KNEE = 1e6  # rad/s: a motor whose torque does not fall with its speed


class _DriveRule(SubstepRule):
    """Acts on k actuators at joints with one value a row."""

    def __init__(self, plant: PlantView, effect: ActuatorEffect) -> None:
        model, index = plant.model, effect.actuators(plant.model)
        self.plant, self.index, self.arrivals = plant, index, DelayedCommands.of(plant)
        self.arrays, self.xp = plant.arrays, plant.arrays.xp
        self.gear = self.arrays.own(model.actuator_gear[index, 0])  # (k,)
        joint = model.actuator_trnid[index, 0]
        self.q, self.v = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        for name in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
            plant.live(name)
        self.group = model.actuator_group[index]
        self.value = np.zeros((plant.num_rows, 1))

    def powered(self, ids: Any, values: Array) -> Array:
        """Return values (n, k), 0 where the actuator is switched off.

        The engine's clamp acts on one that is off, too: a range without 0 would still push.
        """
        mask = self.plant.batch.expanded("opt.disableactuator")  # none of an engine on a device
        if mask is None:
            return values
        return np.where((mask.reshape(-1, 1)[ids] >> self.group & 1) == 0, values, 0.0)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Keep the value of each row."""
        self.value[ids] = values[:, :1]

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep where the actuators and joints are in the rows ids of fields, and the values."""
        own, index = self.arrays.own, self.arrays.index
        self.gain, self.bias = (
            self.plant.now(name) for name in ("actuator_gainprm", "actuator_biasprm")
        )
        self.range = self.plant.now("actuator_forcerange")  # (N, actuators, 2)
        self.at, self.own = index(block(ids, self.index)), own(self.value[ids])
        self.places = index(block(ids, self.q)), index(block(ids, self.v))
        self.low, self.high = (*self.at, 0), (*self.at, 1)  # in the range

    def law(self) -> tuple[Array, Array, Array]:
        """Return the actuators' requested torques in the coming substep, (n, k) each.

        The force, its part from the command and the position, and the gain.
        """
        layout, (q, v) = self.plant.layout, self.places
        held, stiff, drag = (self.bias[(*self.at, column)] for column in range(3))
        gain = self.gain[(*self.at, 0)]
        sent, spring = gain * self.arrivals.at(self.at), stiff * (self.gear * layout.raw_qpos[q])
        damper = drag * (self.gear * layout.raw_qvel[v])
        return sent + (held + spring + damper), sent + held + spring, gain


class _Knee(_DriveRule):
    """See `TorqueSpeedKnee`."""

    order = 42  # of the range that the supply leaves

    def __init__(self, plant: PlantView, effect: TorqueSpeedKnee) -> None:
        super().__init__(plant, effect)
        self.effect, self.no_load = effect, np.ones((plant.num_rows, 1))
        self.turn = self.xp.sign(self.gear)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.no_load[ids, 0] = self.effect.scalar("no_load", values)

    def prepare(self, ids: np.ndarray | slice) -> None:
        super().prepare(ids)
        no_load = self.arrays.own(self.no_load[ids])
        self.free, self.fall = no_load * self.own, (no_load - 1) * self.own

    def before_substep(self, ids: Any) -> None:
        xp, speed = self.xp, self.plant.layout.raw_qvel[self.places[1]] * self.turn  # (n, k)
        left = xp.minimum(xp.maximum((self.free - xp.abs(speed)) / self.fall, 0.0), 1.0)
        self.range[self.high] *= xp.where(speed > 0, left, 1.0)
        self.range[self.low] *= xp.where(speed < 0, left, 1.0)


class TorqueSpeedKnee(ActuatorEffect):
    """A torque limit that falls from its full value at the knee to zero at the no-load speed.

    It limits torque in the direction of motion only; 1e6 means no limit.
    """

    name = "torque_speed_knee"
    engines = BOTH
    unit = "rad/s"
    hows: ClassVar[tuple[How, ...]] = ("set",)
    extras = (
        Extra(
            "no_load",
            "",
            2.0,
            1.001,
            1e3,
            "the no-load speed as a multiple of the speed at the knee",
            fit=(1.05, 10.0),
            typical=(1.2, 4.0),
        ),
    )
    typical = (1.0, 20.0)
    display_name = "torque-speed knee"
    no_mjcf = "MJCF has no force range that depends on the speed"
    symptom = "fast motions under load lag; slow motions with the same torque do not"
    source = "|tau| <= tau_max min(1, (w0 - |w|) / (w0 - wk)): a motor's back-EMF at full voltage"
    experiment = "large steps, up and down, at two supply voltages; compare their top speeds"
    group = RULES
    limits, neutral = (1e-3, NO_KNEE), NO_KNEE
    law = _Knee

    @staticmethod
    def can(model: mujoco.MjModel, actuator: int) -> bool:
        """Return whether it drives a joint and has a torque limit that could fall."""
        limit = bool(model.actuator_forcelimited[actuator])
        return limit and joint_driven(model, actuator) and is_linear(model, actuator)

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return knees at parts of the speed that was reached, which is below the no-load speed."""
        reached = scale.reached_at(self.where)
        return np.array(
            [(part * reached, 2.0) for part in (0.35, 0.55, 0.75, 1.0)] + [(0.8 * reached, 1.3)]
        )


class _Lag(_DriveRule):
    """See `ActuatorLag`."""

    order = 46  # after everything that changes the law or its limit

    def __init__(self, plant: PlantView, effect: ActuatorEffect) -> None:
        super().__init__(plant, effect)
        self.force = self.arrays.zeros((plant.num_rows, len(self.index)))
        self.running = self.arrays.zeros((plant.num_rows, 1), bool)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.running[self.arrays.rows(ids)] = False  # the first substep has what the law asks for

    def prepare(self, ids: np.ndarray | slice) -> None:
        super().prepare(ids)
        dt, lag = self.plant.model.opt.timestep, np.maximum(self.value[ids], 1e-12)
        self.kept = self.arrays.own(np.exp(-dt / lag))

    def before_substep(self, ids: Any) -> None:
        xp = self.xp
        wanted = xp.minimum(xp.maximum(self.law()[0], self.range[self.low]), self.range[self.high])
        kept = xp.where(self.running[ids], self.kept, 0.0)
        force = self.powered(ids, wanted + (self.force[ids] - wanted) * kept)
        self.force[ids], self.running[ids] = force, True
        self.range[self.at] = force[..., None]  # both ends: the engine's clamp yields this force


class ActuatorLag(ActuatorEffect):
    """A first-order lag of the motor's torque; the value is its time constant.

    It models a current loop with the winding's inductance, or an elastic drive train. Back-EMF
    is not delayed.
    """

    name = "actuator_lag"
    engines = BOTH
    unit = "s"
    typical = (0.0, 0.03)
    no_mjcf = "MJCF filters an actuator's command, not its torque"
    symptom = "overshoot and ringing despite well-damped gains, because the torque builds up late"
    source = (
        "T dtau/dt = tau_control - tau; MuJoCo XML reference, dyntype filterexact, on the torque"
    )
    experiment = "small fast steps at a high gain; log the current if the servo reports it"
    limits = (0.0, np.inf)
    first_values = (0.003, 0.01, 0.03)
    group = RULES
    law = _Lag

    @staticmethod
    def can(model: mujoco.MjModel, actuator: int) -> bool:
        """Return whether its force is affine in the command, and acts on a joint."""
        return is_linear(model, actuator) and joint_driven(model, actuator)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Switch the force range on, which carries the torque."""
        limited(spec, self.where)


class _Integral(_DriveRule):
    """See `IntegralAction`."""

    order = 35  # after a dead zone, before the supply

    def __init__(self, plant: PlantView, effect: ActuatorEffect) -> None:
        super().__init__(plant, effect)
        self.effect, self.held = effect, np.zeros((plant.num_rows, 1))
        self.sum = self.arrays.zeros((plant.num_rows, len(self.index)))  # of the error [rad s]

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.held[ids, 0] = self.effect.scalar("held", values)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.sum[self.arrays.rows(ids)] = self.arrays.own(self.first(ids))

    def first(self, ids: np.ndarray) -> np.ndarray:
        """Return the sum when an episode starts in rows (n,), (n, 1)."""
        rate = self.value[ids]
        return np.divide(self.held[ids], rate, out=np.zeros(rate.shape), where=rate > 0)

    def before_substep(self, ids: Any) -> None:
        xp, (law, pull, gain), dt = self.xp, self.law(), self.plant.model.opt.timestep
        error, rate, total = pull / xp.where(gain > 0, gain, 1.0), gain * self.own, self.sum[ids]
        force = law + rate * total
        low, high = self.range[self.low], self.range[self.high]
        winds = ((force >= high) & (error > 0)) | ((force <= low) & (error < 0))
        total = self.powered(ids, total + xp.where(winds, 0.0, error * dt))
        self.sum[ids] = total
        self.bias[self.low] += rate * total


class IntegralAction(ActuatorEffect):
    """The integral term of a position servo: force = kp (e + value ∫ e dt) - kv w.

    The integral is frozen while the force is at its limit, and 0 while torque is off. At the start
    of an episode it moves the goal by `held`: a servo that has held a load for a while carries it.
    """

    name = "integral_action"
    extras = (
        Extra(
            "held",
            "rad",
            0.0,
            -np.inf,
            np.inf,
            "value ∫ e dt at the start of an episode",
            fit=(-0.5, 0.5),
        ),
    )
    engines = BOTH
    unit = "1/s"
    typical = (0.0, 10.0)
    no_mjcf = "a position actuator has no integral term"
    symptom = "a hold creeps to its goal within seconds, and a loaded step overshoots"
    source = "u = kp e + ki ∫ e dt; Dynamixel Position I Gain (82); Åström and Hägglund 1995"
    experiment = "loaded holds of several seconds, reached from both sides"
    limits = (0.0, np.inf)
    first_values = (0.1, 0.5, 2.0, 10.0)
    group = RULES
    can = staticmethod(is_joint_servo)
    law = _Integral

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Switch the force range on, which stops the sum."""
        limited(spec, self.where)
