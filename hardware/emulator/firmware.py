"""The servos' firmware: once a millisecond, from encoder count to winding voltage.

    firmware.tick()                       # all n servos and one step of the physics
    firmware.count, firmware.velocity     # what a client can read

One tick: encoder (offset, noise, resolution), present velocity, goal profile, control law of the
operating mode (`control.py`), voltage = PWM / 885 * supply; current = (V - K w) / R from the motor
equation. Every 10 ms: supply, temperature, and what makes a servo switch itself off.

Position [counts] = direction * encoder + whole turns + homing offset. Whole turns are forgotten at
boot, and in position mode with the mode and with the torque: then 0 to 4095, the offset aside.

Sources: the makers' manuals; 1 kHz, the velocity's filter, and the overload's 2 s are assumptions,
as no maker publishes them. A PWM slope of 255 is taken as none.
"""

import math
from collections import deque

import numpy as np

from hardware.config import Robot
from hardware.emulator.control import POSITION_MODES, SINGLE_TURN, Control
from hardware.emulator.hidden import HiddenEffects
from hardware.emulator.mechanics import TICK, Mechanics
from hardware.emulator.memory import ControlTable
from hardware.emulator.profile import STEP, Profile, limits, shape
from hardware.readings import VOLTAGE_ERROR
from hardware.tables import FASTEST_SLOPE

VELOCITY_FILTER = 0.005  # s
AMBIENT = 25.0  # degrees Celsius
OVERLOAD_TIME = 2.0  # s
HEAT_ERROR, OVERLOAD_ERROR = 0x04, 0x20
SLOW_TICKS = 10
MOST_HOMING = 1024  # counts, a larger homing offset is ignored in position mode


class Firmware:
    """The control loops of a robot's servos over its physics.

    Args:
        robot: the robot.
        memories: the servos' control tables.
        mechanics: the physics.
        hidden: what the robot hides.
        rng: the random generator of the encoders' noise.
    """

    def __init__(
        self,
        robot: Robot,
        memories: list[ControlTable],
        mechanics: Mechanics,
        hidden: HiddenEffects,
        rng: np.random.Generator,
    ) -> None:
        n = len(memories)
        self.robot, self.memories, self.mechanics, self.hidden = robot, memories, mechanics, hidden
        self.ticks = 0
        self._rng = rng
        self._constants(robot)
        self.base = np.zeros(n)  # counts of whole turns that the servo does not know of
        self.slip = np.zeros(n)  # rad that the horn slipped
        self.flip = np.ones(n)
        self.homing = np.zeros(n)
        self.torque_on = np.zeros(n, bool)
        self.control = Control(memories, hidden)
        self.goal = np.zeros(n)  # counts
        self.shape = np.zeros(n, int)  # of the profile to it
        self._slope = np.zeros(n)
        self._safe = np.zeros((3, n))  # V at least, V at most, degrees at most
        self._shutdown = np.zeros(n, int)
        self.pwm, self.current = np.zeros(n), np.zeros(n)
        self.velocity, self._difference = np.zeros(n), np.zeros(n)
        self.temperature = np.full(n, AMBIENT)
        self.heating = np.zeros(n)  # K/s from a fault
        self.supply = self.battery.copy()
        self.dark = False  # no supply at all
        self._strain, self._energy = np.zeros(n), np.zeros(n)
        self._worked = np.zeros(n)  # N²·m²·s since the last look at the heat
        self.errors = np.zeros(n, int)
        self.born = np.zeros(n, int)  # tick at which each started
        self._raw = self._encoder()
        self.count = self._raw.copy()
        self._profile = Profile(self.count)
        self._history: deque[tuple[np.ndarray, ...]] = deque(
            maxlen=1 + round(hidden.robot["observation_delay"] / TICK)
        )
        for i in range(n):
            self.boot(i)

    def _constants(self, robot: Robot) -> None:
        types = [servo.type for servo in robot.servos]
        self._sign = np.array([float(servo.sign) for servo in robot.servos])
        self._zero = np.array([float(servo.zero) for servo in robot.servos])
        self._res = np.array([kind.units.angle for kind in types])
        self._k = np.array([kind.torque_constant for kind in types])
        self._r = np.array([kind.resistance for kind in types])
        self._heat = np.array([kind.heat for kind in types])
        self._tau = np.array([kind.tau_thermal for kind in types])
        self._full = np.array([float(kind.units.full_pwm) for kind in types])
        supplies = [robot.supply_of(servo) for servo in robot.servos]
        factor = self.hidden.robot["supply_voltage"]
        self.full_battery = np.array([supply.voltage for supply in supplies]) * factor
        self.battery = self.full_battery.copy()  # V without load, (n,)
        self.shares = np.array([[one == other for other in supplies] for one in supplies])
        resistance = np.array([supply.resistance for supply in supplies])
        self._sag = resistance + self.hidden.robot["supply_sag"]
        hidden = self.hidden
        self._noisy = bool(hidden["sensor_noise"].any() or hidden["quantization"].any())
        self._alpha = hidden["velocity_filter"]
        self._sags = bool(self._sag.any())
        self._capped = bool(np.isfinite(hidden["torque_limit"]).any())
        self._offset = hidden["encoder_offset"]
        self._heats = bool(hidden["thermal_derating"].any())

    @property
    def time(self) -> float:
        """Seconds since the start, at the last tick."""
        return self.ticks * TICK

    def boot(self, i: int) -> None:
        """Start a servo: torque off, RAM fresh, whole turns forgotten, goal where it is."""
        self.errors[i] = 0
        self._strain[i] = 0
        self.born[i] = self.ticks
        self.torque_on[i] = False
        self.load(i)
        self.forget_turns(i)
        self._restart(i)

    def switch_mode(self, i: int) -> None:
        """Begin another operating mode: gains and limits are fresh, the goal is where it is."""
        self.memories[i].switch_mode()
        self.load(i)
        if self.control.mode[i] == SINGLE_TURN:
            self.forget_turns(i)
        self._stay(i)
        self._restart(i)

    def forget_turns(self, i: int) -> None:
        """Bring the present position into one turn, and let the goal be there."""
        self.base[i] = -4096.0 * math.floor(self.flip[i] * self._raw[i] / 4096)
        self.count[i] = self.flip[i] * self._raw[i] + self.base[i] + self.homing[i]
        self._stay(i)

    def _stay(self, i: int) -> None:
        """Let the goal be where the servo is, at once."""
        self.memories[i]["goal_position"] = int(self.count[i])
        self._profile.jump(i, self.count[i])
        self.load_goals(i)

    def _restart(self, i: int) -> None:
        """Forget what the control law remembers."""
        self.pwm[i] = 0.0
        self.control.restart(i, float(self.velocity[i]))
        self._profile.jump(i, self.count[i])

    def load(self, i: int) -> None:
        """Take a servo's settings from its control table."""
        memory, control = self.memories[i], self.control
        control.load(i, memory)
        single = control.mode[i] == SINGLE_TURN
        flip, offset = -1.0 if memory["drive_mode"] & 1 else 1.0, memory["homing_offset"]
        turned, self.flip[i] = flip != self.flip[i], flip
        self.homing[i] = 0 if single and abs(offset) > MOST_HOMING else offset
        has_slope = "pwm_slope" in memory.kind.registers
        slope = memory["pwm_slope"] if has_slope else FASTEST_SLOPE
        self._slope[i] = slope * memory.kind.slope if slope < FASTEST_SLOPE else np.inf
        self._sloped = bool(np.isfinite(self._slope).any())
        low, high = memory["min_voltage_limit"], memory["max_voltage_limit"]
        self._safe[:, i] = low * 0.1 - 0.05, high * 0.1 + 0.05, memory["temperature_limit"]
        self._shutdown[i] = memory["shutdown"]
        on = bool(memory["torque_enable"]) and not self.errors[i]
        begins = on and not self.torque_on[i]
        if (begins or turned) and single and not 0 <= self._turn(i) < 4096:
            self.forget_turns(i)
        if begins:
            self._restart(i)
        self.torque_on[i] = on

    def _turn(self, i: int) -> float:
        """A servo's position without its homing offset [counts], over several turns."""
        return float(self.flip[i] * self._raw[i] + self.base[i])

    def load_goals(self, i: int, position: bool = True, velocity: bool = True) -> None:
        """Take a servo's goals from its control table.

        Args:
            i: the servo.
            position: whether its goal position is new, and begins with the profile as it is now.
            velocity: whether its goal velocity is.
        """
        memory, hidden = self.memories[i], self.hidden
        self.control.load_goals(i, memory, velocity)
        if not position:
            return
        goal, units = memory["goal_position"], memory.kind.units
        fastest, sharpest = limits(memory, abs(goal - self._profile.position[i]))
        fastest = min(fastest, hidden["profile_velocity"][i] / units.angle)
        sharpest = min(sharpest, hidden["profile_acceleration"][i] / units.angle)
        self._profile.limit(i, fastest, sharpest)
        self.set_goal(i, goal)

    def set_goal(self, i: int, goal: int) -> None:
        """Set a servo's goal position [counts]."""
        self.goal[i], profile = goal, self._profile
        way = abs(goal - profile.position[i])
        self.shape[i] = shape(self.memories[i], way) if profile.shaped else STEP

    def stop(self, i: int) -> None:
        """Stop a servo, as its bus watchdog does: at once, by the means of its operating mode.

        In the position modes it holds where it is, in velocity and PWM mode it brakes, and in
        current mode it drives no current and is free.
        """
        self.control.stop(i, self.memories[i])
        self._stay(i)

    def moving(self, i: int) -> bool:
        """Say whether a servo's goal position is on its way."""
        on_its_way = self._profile.shaped and self._profile.position[i] != self.goal[i]
        return bool(on_its_way and self.control.mode[i] in POSITION_MODES)

    def _encoder(self) -> np.ndarray:
        """The encoders' raw counts, (n,)."""
        angle = self.mechanics.angle + (self._offset + self.slip)
        if self._noisy:
            step = self.hidden["quantization"]
            angle += self.hidden["sensor_noise"] * self._rng.normal(size=len(angle))
            angle = np.where(step > 0, np.rint(angle / np.where(step > 0, step, 1)) * step, angle)
        return np.floor(self._zero + self._sign * angle / self._res + 0.5)

    def tick(self) -> None:
        """One millisecond: measure, control, and move the physics."""
        self.ticks += 1
        raw = self._encoder()
        self._measure(raw)
        position = self._profile.advance(self.goal, TICK)
        self._output(np.trunc(self._pwm(position - self.count)))
        self.mechanics.step()
        if self._heats:  # in every tick: torque has spikes in step with the commands
            self._worked += TICK * self.mechanics.torque**2
        if self.ticks % SLOW_TICKS == 0:
            self._slow()

    def _measure(self, raw: np.ndarray) -> None:
        speed = (raw - self._raw) * (self.flip * self._res / TICK)
        self._raw = raw
        self.count = self.flip * raw + self.base + self.homing
        self._difference += (speed - self._difference) * (TICK / (VELOCITY_FILTER + TICK))
        self.velocity += (self._difference - self.velocity) * (TICK / (self._alpha + TICK))
        self._history.append((self.count, self.velocity.copy(), self.pwm, self.current))

    def _pwm(self, error: np.ndarray) -> np.ndarray:
        """The controllers' output, (n,), for errors of position [counts], (n,)."""
        control, speed = self.control, self._profile.speed
        if control.plain:
            return control.position_law(error, speed)
        volt = self._full / np.maximum(self.supply, 1e-3)
        return control.any_law(error, speed, self.velocity, self._motor_speed(), volt)

    def _motor_speed(self) -> np.ndarray:
        """Speed in the direction in which the servo counts [rad/s], (n,)."""
        return self._sign * self.flip * self.mechanics.speed

    def _output(self, pwm: np.ndarray) -> None:
        """Drive the motors with PWM, (n,), and work out their currents."""
        on = self.torque_on
        if self._sloped:
            slope = self._slope * self._full / np.maximum(self.supply, 1e-3)
            pwm = np.clip(pwm, self.pwm - slope, self.pwm + slope)
        pwm = np.where(on, pwm, 0.0)
        volts = pwm / self._full * self.supply
        if self._capped:
            limit = self.hidden["torque_limit"]
            most = limit * self._r / (self._k * np.maximum(self.mechanics.strength, 1e-6))
            volts = np.clip(volts, -most, most)
        self.current = np.where(on, (volts - self._k * self._motor_speed()) / self._r, 0.0)
        self.pwm = pwm
        self.mechanics.drive(self._sign * self.flip * volts, on)
        if self.dark:
            self.supply[:] = 0.0
        elif self._sags:
            drawn = self.shares @ np.abs(self.current) * self._sag
            self.supply[:] = np.maximum(self.battery - drawn, 0.0)
        else:
            self.supply[:] = self.battery

    def _slow(self) -> None:
        """Supply, temperature, wear, and the reasons to switch off; every 10 ms."""
        dt = SLOW_TICKS * TICK
        warm = self._heat * self._r * self.current**2 - (self.temperature - AMBIENT)
        self.temperature += dt * (warm / self._tau + self.heating)
        if self._heats:
            hidden = self.hidden
            decay = hidden["thermal_derating.decay"] * self._energy
            self._energy += self._worked - dt * decay
            self._worked[:] = 0.0
            factor = np.maximum(1 - hidden["thermal_derating"] * self._energy, 0.0)
            self.mechanics.set_strength(hidden["motor_strength"] * factor)
        stalled = self.torque_on & (np.abs(self.pwm) >= 0.95 * self.control.most_pwm)
        stalled &= np.abs(self.velocity) < 0.1
        self._strain = np.where(stalled, self._strain + dt, np.maximum(self._strain - dt, 0.0))
        self._find_errors()

    def _find_errors(self) -> None:
        if self.dark:
            return
        (low, high, hottest), volts = self._safe, self.supply
        found = VOLTAGE_ERROR * ((volts < low) | (volts > high))
        found |= HEAT_ERROR * (self.temperature > hottest)
        found |= OVERLOAD_ERROR * (self._strain > OVERLOAD_TIME)
        found &= self._shutdown
        for i in np.flatnonzero(found & ~self.errors):
            self.shut_down(int(i), int(found[i]))

    def shut_down(self, i: int, error: int) -> None:
        """Latch hardware errors of a servo and let its torque go; only a reboot clears them."""
        self.errors[i] |= error
        self.memories[i]["hardware_error_status"] = int(self.errors[i])
        self.memories[i]["torque_enable"] = 0
        self.torque_on[i] = False

    def present(self) -> tuple[np.ndarray, ...]:
        """Return count, velocity [rad/s], PWM and current [A] as a client reads them, (n,) each."""
        if not self._history:
            return self.count, self.velocity, self.pwm, self.current
        return self._history[0]

    @property
    def trajectory(self) -> tuple[np.ndarray, np.ndarray]:
        """The profiled goals' positions [counts] and speeds [counts/s], (n,) each."""
        return self._profile.position, self.control.way_speed(self._profile.speed)
