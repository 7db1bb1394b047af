"""What runs inside the servos: once a millisecond, from encoder count to winding voltage.

    firmware.tick()                       # all n servos and one step of the physics
    firmware.count, firmware.velocity     # what a client can read

One tick: encoder (offset, noise, resolution), present velocity, goal profile, control law of the
operating mode, PWM limits, voltage = PWM / 885 * supply; current = (V - K w) / R from the motor
equation. Every 10 ms: supply, temperature, and what makes a servo switch itself off.

    position  PWM = P/divisor e + I/65536 sum(e) + D/16 (e - e') + FF1/4 v + FF2/4 a    e in counts
    velocity  PWM = P/128 e + I/65536 sum(e)                       e in steps of 0.229 turns/min
    current   V = R i + K w for the goal current, as its inner loop would settle
    current-based position: the position law's PWM, its current no more than the goal current

Sources: the makers' manuals for gains and units; 1 kHz, the filters of velocity and derivative, and
the overload's 2 s are assumptions, as no maker publishes them. A PWM slope of 255 is taken as none.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from hardware.config import Robot
from hardware.emulator.hidden import Hidden
from hardware.emulator.mechanics import TICK, Mechanics
from hardware.emulator.memory import Memory
from hardware.emulator.profile import Profile

VELOCITY_FILTER = 0.005  # s
DERIVATIVE_FILTER = 0.002  # s
SLOPE = 0.001977  # V a millisecond, one step of the PWM slope register
FASTEST_SLOPE = 255
AMBIENT = 25.0  # degrees Celsius
OVERLOAD_TIME = 2.0  # s
VOLTAGE_ERROR, HEAT_ERROR, OVERLOAD_ERROR = 0x01, 0x04, 0x20
SLOW_TICKS = 10


class Firmware:
    """The control loops of a robot's servos over its physics.

    Args:
        robot: the robot.
        memories: the servos' control tables.
        mechanics: the physics.
        hidden: what the robot hides.
        rng: for the encoders' noise.
    """

    def __init__(
        self,
        robot: Robot,
        memories: list[Memory],
        mechanics: Mechanics,
        hidden: Hidden,
        rng: np.random.Generator,
    ) -> None:
        n = len(memories)
        self.robot, self.memories, self.mechanics, self.hidden = robot, memories, mechanics, hidden
        self.ticks = 0
        self._rng = rng
        self._constants(robot)
        self.base = np.zeros(n)  # whole turns that the servo does not know of
        self.slip = np.zeros(n)  # rad that the horn slipped
        self.flip = np.ones(n)
        self.homing = np.zeros(n)
        self.torque_on = np.zeros(n, bool)
        self.mode = np.full(n, 3)
        self.goal = np.zeros(n)
        self.goal_velocity, self.goal_pwm, self.goal_current = np.zeros(n), np.zeros(n), np.zeros(n)
        self._kp, self._ki, self._kd = np.zeros(n), np.zeros(n), np.zeros(n)
        self._ff1, self._ff2 = np.zeros(n), np.zeros(n)
        self._vp, self._vi = np.zeros(n), np.zeros(n)
        self._slope, self._most_pwm = np.zeros(n), np.zeros(n)
        self._safe = np.zeros((3, n))  # V at least, V at most, degrees at most
        self._shutdown = np.zeros(n, int)
        self._last_speed = np.zeros(n)
        self._sum, self._error, self._derivative = np.zeros(n), np.zeros(n), np.zeros(n)
        self.pwm, self.current = np.zeros(n), np.zeros(n)
        self.velocity, self._difference = np.zeros(n), np.zeros(n)
        self.temperature = np.full(n, AMBIENT)
        self.heating = np.zeros(n)  # K/s from a fault
        self.supply = np.full(n, self.battery)
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
        self.full_battery = robot.supply.voltage * self.hidden.robot["supply_voltage"]
        self.battery = self.full_battery
        self._sag = robot.supply.resistance + self.hidden.robot["supply_sag"]
        hidden = self.hidden
        self._noisy = bool(hidden["sensor_noise"].any() or hidden["quantization"].any())
        self._alpha = hidden["velocity_filter"]
        self._numb = bool(hidden["dead_zone"].any())
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
        self.base[i] = -4096.0 * math.floor(self._raw[i] / 4096)
        self.load(i)
        self.count[i] = self._report(i)
        self.memories[i]["goal_position"] = int(self.count[i])
        self.load_goals(i)
        self._restart(i)

    def _report(self, i: int) -> float:
        return self.flip[i] * (self._raw[i] + self.base[i]) + self.homing[i]

    def _restart(self, i: int) -> None:
        """Forget what the control law remembers."""
        self._sum[i] = self._derivative[i] = self.pwm[i] = self._error[i] = 0.0
        self._profile.jump(i, self.count[i])

    def load(self, i: int) -> None:
        """Take a servo's settings from its control table."""
        memory, hidden = self.memories[i], self.hidden
        units = memory.kind.units
        self.flip[i] = -1.0 if memory["drive_mode"] & 1 else 1.0
        self.homing[i] = memory["homing_offset"]
        self.mode[i] = memory["operating_mode"]
        self._kp[i] = memory["position_p_gain"] / memory.kind.gain_divisor
        self._kp[i] *= hidden["position_gain"][i]
        self._ki[i] = memory["position_i_gain"] / units.position_i
        self._kd[i] = memory["position_d_gain"] / units.position_d * hidden["derivative_gain"][i]
        self._ff1[i] = memory["feedforward_1st_gain"] / units.feedforward
        self._ff2[i] = memory["feedforward_2nd_gain"] / units.feedforward
        self._vp[i] = memory["velocity_p_gain"] / units.velocity_p
        self._vi[i] = memory["velocity_i_gain"] / units.velocity_i
        self._most_pwm[i] = memory["pwm_limit"]
        has_slope = "pwm_slope" in memory.kind.registers
        slope = memory["pwm_slope"] if has_slope else FASTEST_SLOPE
        self._slope[i] = slope * SLOPE if slope < FASTEST_SLOPE else np.inf
        self._simple = bool((self.mode == 3).all() or np.isin(self.mode, (3, 4)).all())
        self._only_p = not (self._ki.any() or self._kd.any() or self._ff1.any() or self._ff2.any())
        self._sloped = bool(np.isfinite(self._slope).any())
        low, high = memory["min_voltage_limit"], memory["max_voltage_limit"]
        self._safe[:, i] = low * 0.1 - 0.05, high * 0.1 + 0.05, memory["temperature_limit"]
        self._shutdown[i] = memory["shutdown"]
        on = bool(memory["torque_enable"]) and not self.errors[i]
        if on and not self.torque_on[i]:
            self._restart(i)
        self.torque_on[i] = on

    def load_goals(self, i: int) -> None:
        """Take a servo's goals and profile from its control table."""
        memory = self.memories[i]
        units = memory.kind.units
        self.goal[i] = memory["goal_position"]
        self.goal_velocity[i] = memory["goal_velocity"]
        self.goal_pwm[i] = memory["goal_pwm"]
        if "goal_current" in memory.kind.registers:
            limit = memory["current_limit"]
            self.goal_current[i] = min(max(memory["goal_current"], -limit), limit)
        speed, sharp = memory["profile_velocity"], memory["profile_acceleration"]
        if memory["drive_mode"] & 4:
            fastest, sharpest = self._timed(i, speed / 1000, sharp / 1000)
        else:
            fastest = speed * units.velocity / units.angle or np.inf
            sharpest = sharp * units.acceleration / units.angle or np.inf
        fastest = min(fastest, self.hidden["profile_velocity"][i] / units.angle)
        sharpest = min(sharpest, self.hidden["profile_acceleration"][i] / units.angle)
        self._profile.limit(i, fastest, sharpest)

    def _timed(self, i: int, span: float, ramp: float) -> tuple[float, float]:
        """Limits [counts/s, counts/s^2] of a profile of this span and ramp [s]."""
        way = abs(self.goal[i] - self._profile.position[i])
        ramp = min(ramp, span / 2)
        fastest = way / (span - ramp) if span > 0 else np.inf
        return fastest or np.inf, fastest / ramp if ramp > 0 and fastest else np.inf

    def hold(self, i: int) -> None:
        """Stop a servo where it is, as its bus watchdog does."""
        self.goal[i] = self.count[i]
        self.goal_velocity[i] = self.goal_pwm[i] = 0.0
        self._profile.jump(i, self.count[i])
        self.memories[i]["goal_position"] = int(self.count[i])

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
        law = self._plain_law if self._simple else self._any_law
        self._output(np.trunc(law(position)))
        self.mechanics.step()
        if self._heats:  # in every tick: torque has spikes in step with the commands
            self._worked += TICK * self.mechanics.torque**2
        if self.ticks % SLOW_TICKS == 0:
            self._slow()

    def _measure(self, raw: np.ndarray) -> None:
        speed = (raw - self._raw) * (self.flip * self._res / TICK)
        self._raw = raw
        self.count = self.flip * (raw + self.base) + self.homing
        self._difference += (speed - self._difference) * (TICK / (VELOCITY_FILTER + TICK))
        self.velocity += (self._difference - self.velocity) * (TICK / (self._alpha + TICK))
        self._history.append((self.count, self.velocity.copy(), self.pwm, self.current))

    def _plain_law(self, position: np.ndarray) -> np.ndarray:
        """PWM of servos that are all in a position mode, for profiled goals [counts], (n,)."""
        return self._position_law(position - self.count)

    def _position_law(self, error: np.ndarray) -> np.ndarray:
        """PWM of the position law for errors [counts], (n,)."""
        if self._numb:
            dead = self.hidden["dead_zone"]
            error = np.where(np.abs(error) * self._res < dead, 0.0, error)
        pwm = self._kp * error
        if not self._only_p:
            change = (error - self._error) * (TICK / (DERIVATIVE_FILTER + TICK))
            self._derivative = self._derivative * (1 - TICK / (DERIVATIVE_FILTER + TICK)) + change
            speed = self._profile.speed * TICK  # counts a tick
            pwm = pwm + self._kd * self._derivative + self._ff1 * speed
            pwm = pwm + self._ff2 * (speed - self._last_speed)
            self._last_speed = speed
            room = np.where(self._ki > 0, self._most_pwm / np.where(self._ki > 0, self._ki, 1), 0)
            self._sum = np.clip(self._sum + error, -room, room)
            pwm = pwm + self._ki * self._sum
        self._error = error
        most = np.minimum(np.abs(self.goal_pwm), self._most_pwm)
        return np.minimum(np.maximum(pwm, -most), most)

    def _any_law(self, position: np.ndarray) -> np.ndarray:
        """PWM of servos in any operating modes, for profiled goals [counts], (n,)."""
        mode, most = self.mode, self._most_pwm
        pwm = self._position_law(position - self.count)
        volts = self._full / np.maximum(self.supply, 1e-3)
        spin = self._motor_speed() * self._k
        steps = np.array([m.kind.current or 0.0 for m in self.memories])
        least = (spin - np.abs(self.goal_current) * steps * self._r) * volts
        largest = (spin + np.abs(self.goal_current) * steps * self._r) * volts
        pwm = np.where(mode == 5, np.clip(pwm, least, largest), pwm)
        wanted = (spin + self.goal_current * steps * self._r) * volts
        pwm = np.where(mode == 0, wanted, pwm)
        if (mode == 1).any():
            unit = self.memories[0].kind.units.velocity
            error = self.goal_velocity - self.velocity / unit
            self._sum = np.where(mode == 1, np.clip(self._sum + error, -1e7, 1e7), self._sum)
            pwm = np.where(mode == 1, self._vp * error + self._vi * self._sum, pwm)
        pwm = np.where(mode == 16, self.goal_pwm, pwm)
        return np.clip(pwm, -most, most)

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
        drawn = np.abs(self.current).sum() * self._sag if self._sag else 0.0
        self.supply[:] = 0.0 if self.dark else max(self.battery - drawn, 0.0)

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
        stalled = self.torque_on & (np.abs(self.pwm) >= 0.95 * self._most_pwm)
        stalled &= np.abs(self.velocity) < 0.1
        self._strain = np.where(stalled, self._strain + dt, np.maximum(self._strain - dt, 0.0))
        self._find_errors(float(self.supply[0]))

    def _find_errors(self, volts: float) -> None:
        if self.dark:
            return
        low, high, hottest = self._safe
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
        """Where the goals are on their way [counts] and how fast [counts/s], (n,) each."""
        return self._profile.position, self._profile.speed

    def clear_turns(self, i: int) -> None:
        """Forget whole turns: the present position comes back into one turn."""
        self.base[i] = -4096.0 * math.floor(self._raw[i] / 4096)
