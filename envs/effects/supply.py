"""Effects of the power supply and of heat on what the motors can do.

A voltage-driven servo (a Dynamixel in position mode: error -> PWM) turns voltage into torque, so
that its whole law scales with the supply, and its limit too; the actuator's damping, the back-EMF,
does not. A current-driven motor keeps its law and loses only limit. Servos are taken as
voltage-driven, motors as current-driven, unless `drive` says so.
"""

import itertools
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from envs.effects.base import BOTH, PLAIN, RULES, Effect, Extra, Sizes
from envs.effects.bound import BoundEffect, SubstepRule
from envs.effects.field import BoundFieldGroup
from envs.effects.places import block, joint_driven
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale
from envs.effects.servo import ActuatorEffect, is_linear, is_servo
from envs.effects.strength import LawScale
from envs.errors import EffectError, refuse_unknown
from envs.params import How, Parameter
from envs.physics.arrays import Array

Drive = Literal["voltage", "current"]
UNSURE = 0.05  # relative standard deviation of a heat that was not simulated from its beginning


class SupplyVoltage(Effect):
    """Supply voltage, as a factor on stall torque and no-load speed.

    Args:
        how: `scale`.
        drive: `voltage`: the law scales too; `current`: only its limit; None: voltage for servos,
            current for motors.
    """

    name = "supply_voltage"
    engines = BOTH
    place = "robot"
    unit = ""
    hows: ClassVar[tuple[How, ...]] = ("scale",)
    composes = True
    typical = (0.7, 1.3)
    no_mjcf = None
    comparable = True
    factors = (0.5, 0.75, 0.94, 0.98, 1.02, 1.06, 1.3, 1.8)  # a few per cent shift a whole motion
    sizes = Sizes("factor", "one", 0.02, 0.6)
    symptom = "top speed and largest torque change together; slow, light motions hardly change"
    source = "|tau| <= (kt/R)(V duty_max - kt w)"
    experiment = "full-speed moves at two supply voltages; log the voltage"
    group = PLAIN

    def __init__(
        self,
        where: str | None = None,
        how: How | None = None,
        drive: Drive | None = None,
        **arguments: Any,
    ) -> None:
        super().__init__(where, how, **arguments)
        if drive is not None:
            refuse_unknown("supply_voltage: drive", drive, ("voltage", "current"))
        self.drive = drive

    def options(self) -> dict[str, Any]:
        """Return how the servos are driven, where it was said."""
        return {} if self.drive is None else {"drive": self.drive}

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the factor."""
        voltage, current = self._split(model)
        if not voltage.size and not model.actuator_forcelimited[current].any():
            raise EffectError(
                "supply_voltage needs a servo, or a motor with a forcerange; this robot has neither"
            )
        return (self.parameter(low=0.0),)

    def _split(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the ids of the voltage-driven and of the current-driven actuators."""
        linear = [i for i in range(model.nactuator) if is_linear(model, i)]
        voltage = [
            i
            for i in linear
            if self.drive == "voltage" or (self.drive is None and is_servo(model, i))
        ]
        current = [i for i in linear if i not in voltage]
        return np.array(voltage, dtype=int), np.array(current, dtype=int)

    def bind(self, plant: PlantView) -> BoundEffect:
        """Scale the limits, and the laws of the voltage-driven ones."""
        (parameter,) = self.parameters(plant.model)
        voltage, current = self._split(plant.model)
        parts: list[Any] = [LawScale(plant, voltage, parameter, law=True, damping=False)]
        parts.append(LawScale(plant, current, parameter, law=False, damping=False))
        return BoundFieldGroup(parts)


class _Weakening(SubstepRule):
    """Scales the law and the limit of k actuators before each substep."""

    order = 40

    def __init__(self, plant: PlantView, index: np.ndarray) -> None:
        model = plant.model
        self.plant, self.index = plant, index
        for name in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
            plant.live(name)
        self.arrays, self.xp = plant.arrays, plant.arrays.xp
        self.force = plant.physics.bind("actuator_force")  # (N, actuators), of the substep before
        gear = model.actuator_gear[index, 0]
        on_joint = [joint_driven(model, int(i)) for i in index]
        dofs = model.jnt_dofadr[np.where(on_joint, model.actuator_trnid[index, 0], 0)]
        self.dofs, self.turns = dofs, self.arrays.own(np.where(on_joint, gear**2, 0.0))
        self.gear, self.qvel = self.arrays.own(gear), plant.layout.raw_qvel
        plant.live("actuator_damping")
        self.value = np.zeros((plant.num_rows, 1))
        self.running = self.arrays.zeros((plant.num_rows, 1), bool)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[ids] = values[:, :1]

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.running[self.arrays.rows(ids)] = False

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep where the actuators and their joints are in the rows ids of fields."""
        index, now = self.arrays.index, self.plant.now
        self.gain, self.bias = now("actuator_gainprm"), now("actuator_biasprm")
        self.limit, self.damping = now("actuator_forcerange"), now("actuator_damping")
        self.at, self.driven = index(block(ids, self.index)), index(block(ids, self.dofs))
        self.own = self.arrays.own(self.value[ids])

    def torque(self, ids: Any, spared: Array | float = 0.0) -> Array:
        """Return the motors' torques at the joints, (n, k) [N·m]; 0 before the first substep.

        The force of the substep before, less the actuator's own damping, the back-EMF: current goes
        with the torque that is left. Of the damping a part may be spared, (n, 1): no current.
        """
        drag = self.damping[self.at] * self.turns * self.qvel[self.driven] * (1.0 - spared)
        torque, running = self.force[self.at] * self.gear - drag, self.running[ids]
        if not running.all():
            torque = self.xp.where(running, torque, 0.0)
            self.running[ids] = True
        return torque

    def weaken(self, factor: Array) -> None:
        """Scale by factors (n, k)."""
        self.gain[(*self.at, 0)] *= factor
        self.bias[(*self.at, slice(3))] *= factor[..., None]
        self.limit[self.at] *= factor[..., None]


class _Sag(_Weakening):
    """See `SupplySag`."""

    def __init__(
        self, plant: PlantView, index: np.ndarray, voltage: float, torque_constant: float
    ) -> None:
        super().__init__(plant, index)
        self.scale = 1.0 / (voltage * torque_constant)

    def before_substep(self, ids: np.ndarray | slice) -> None:
        load = self.xp.abs(self.torque(ids)).sum(1)[:, None]  # (n, 1) [N·m]
        self.weaken(self.xp.maximum(1.0 - self.own * self.scale * load, 0.0))


class SupplySag(Effect):
    """Supply voltage that drops under load: V = V0 - value * sum of |torque| / kt.

    The torques are taken from the previous substep.
    """

    name = "supply_sag"
    engines = BOTH
    place = "robot"
    unit = "V/A"
    extras = (
        Extra("voltage", "V", None, 1e-3, 1e3, "supply voltage without load"),
        Extra(
            "torque_constant", "N·m/A", None, 1e-6, 1e3, "the motors' torque constant, at the joint"
        ),
    )
    typical = (0.0, 2.0)
    no_mjcf = "MJCF has no supply that several actuators share"
    comparable = True
    sizes = Sizes("add", "winding", 0.01, 2.0)
    symptom = "all joints weaken together while any of them is heavily loaded"
    source = (
        "V = V0 - Rs * sum I; 5.7 to 9.2 V measured at a nominal 7.4 V on an XL330 bench"
        " (Rhoban's BAM logs)"
    )
    experiment = "one joint holds a load while another makes steps; log the voltage"
    group = RULES

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the supply's resistance."""
        if not _linear(model).size:
            raise EffectError(
                "supply_sag needs an actuator with an affine law; this robot has none"
            )
        return (self.parameter(low=0.0),)

    def bind(self, plant: PlantView) -> SubstepRule:
        """Weaken all actuators before each substep."""
        return _Sag(
            plant, _linear(plant.model), self.extra["voltage"], self.extra["torque_constant"]
        )

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return resistances at which all motors together pull the supply down by a part."""
        volts, constant = self.extra["voltage"], self.extra["torque_constant"]
        return np.array([0.1, 0.4, 1.5]) * volts * constant / sum(scale.torque.values())


def _linear(model: mujoco.MjModel) -> np.ndarray:
    return np.array([i for i in range(model.nactuator) if is_linear(model, i)], dtype=int)


class _Derating(_Weakening):
    """See `ThermalDerating`."""

    def __init__(self, plant: PlantView, effect: ActuatorEffect) -> None:
        index = effect.actuators(plant.model)
        super().__init__(plant, index)
        self.effect, self.dt, self.memory = effect, plant.model.opt.timestep, effect.label()
        self.heat = self.arrays.zeros((plant.num_rows, len(index)))  # N²·m²·s
        self.decay, self.braking = np.zeros((plant.num_rows, 1)), np.zeros((plant.num_rows, 1))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        super().write(ids, values)
        self.decay[ids, 0] = self.effect.scalar("decay", values)
        self.braking[ids, 0] = self.effect.scalar("braking", values)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        super().reset(ids, seeds)
        self.heat[self.arrays.rows(ids)] = 0.0

    def misremember(self, ids: np.ndarray) -> None:
        self.heat[self.arrays.rows(ids)] *= 1 + UNSURE

    def prepare(self, ids: np.ndarray | slice) -> None:
        super().prepare(ids)
        self.kept = self.arrays.own(np.exp(-self.decay[ids] * self.dt))
        self.spared, self.spares = self.arrays.own(self.braking[ids]), self.braking[ids].any()

    def before_substep(self, ids: np.ndarray | slice) -> None:
        heat, xp = self.heat[ids], self.xp
        brakes = self._braking(xp.maximum(1.0 - self.own * heat, 0.0))
        self.damping[self.at] *= brakes  # the back-EMF as it was in the substep before
        heat = heat * self.kept + self.torque(ids, self.spared) ** 2 * self.dt
        self.heat[ids] = heat
        weaker = xp.maximum(1.0 - self.own * heat, 0.0)
        self.weaken(weaker)
        self.damping[self.at] *= self._braking(weaker) / xp.maximum(brakes, 1e-9)

    def _braking(self, factor: Array) -> Array:
        """Return the back-EMF's remaining fraction, given that of the torque, (n, k)."""
        return factor + (1.0 - factor) * self.spared if self.spares else factor


class ThermalDerating(ActuatorEffect):
    """Motor torque that falls as the motor heats: it is scaled by 1 - value E.

    dE/dt = torque² - decay E, with E = 0 at reset. The factor applies to the control torque, its
    limit and the back-EMF; with `braking` 1 the back-EMF is unchanged, as under current control.
    """

    name = "thermal_derating"
    engines = BOTH
    unit = "1/(N²·m²·s)"
    extras = (
        Extra("decay", "1/s", 0.0, 0.0, 1e3, "cooling rate", typical=(0.0, 0.05)),
        Extra(
            "braking",
            "",
            0.0,
            0.0,
            1.0,
            "fraction of the damping that the motor's heat does not affect",
            fit=(0.0, 1.0),
        ),
    )
    typical = (0.0, 0.1)
    no_mjcf = "an actuator of this kind does not remember its load"
    sizes = Sizes("add", "heating", 1e-3, 100.0)
    symptom = "errors that grow over minutes of heavy load and disappear after a pause"
    source = (
        "the integral of I²R heats the winding. Its resistance rises, and firmware lowers its"
        " limits. Tests of 2 minutes warmed an XL330 from 27 to 40 °C"
    )
    experiment = (
        "the same loaded motion before and after a minute of heavy load; log the temperature"
    )
    limits = (0.0, np.inf)
    group = RULES
    can = staticmethod(is_linear)
    law = _Derating

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return losses by which the hardest log takes parts of the strength, and of braking."""
        losses = np.array([0.15, 0.6, 2.5]) / max(scale.heat_at(self.where), 1e-9)
        return np.array(list(itertools.product(losses, (0.0, 1.0))))

    def memory(self, model: mujoco.MjModel) -> list[str]:
        """Return how hot its motors are."""
        return [self.label()]

    @classmethod
    def draw_extras(cls, units: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw a motor that cools or one that does not."""
        return {"decay": float(rng.choice([0.0, 0.02]))}
