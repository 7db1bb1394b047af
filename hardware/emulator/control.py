"""The control laws inside the servos: from goals and measurements to PWM, for n servos at once.

    control.load(i, memory)               # gains, limits and operating mode of one servo
    control.load_goals(i, memory)
    pwm = control.position_law(error, speed)

    position  PWM = P/divisor e + I/65536 sum(e) + D/16 (e - e') + FF1/4 v + FF2/4 a    e in counts
    velocity  PWM = P/128 e + I/65536 sum(e)     e in steps of 0.229 turns/min, to the goal velocity
                                                 that the profile acceleration leads there
    current   V = R i + K w for the goal current, as its inner loop would settle
    current-based position: the position law's PWM, its current no more than the goal current

Goal PWM limits all of them; in PWM mode it is the PWM itself.

Sources: the makers' manuals for gains and units; the derivative's filter is an assumption, and so
are sums that stop where they alone would drive full PWM.
"""

from collections.abc import Sequence

import numpy as np

from hardware.emulator.hidden import HiddenEffects
from hardware.emulator.mechanics import TICK
from hardware.emulator.memory import ControlTable
from hardware.emulator.profile import MILLISECOND, TIMED

DERIVATIVE_FILTER = 0.002  # s
CURRENT, VELOCITY, SINGLE_TURN, EXTENDED, SOFT, PWM = 0, 1, 3, 4, 5, 16  # operating modes
POSITION_MODES = (SINGLE_TURN, EXTENDED, SOFT)


class Control:
    """The control modes of n servos, with the state of their controllers.

    Args:
        memories: the servos' control tables.
        hidden: what the robot hides.
    """

    def __init__(self, memories: Sequence[ControlTable], hidden: HiddenEffects) -> None:
        n, kinds = len(memories), [memory.kind for memory in memories]
        self._hidden = hidden
        self._k = np.array([kind.torque_constant for kind in kinds])
        self._r = np.array([kind.resistance for kind in kinds])
        self._amps = np.array([kind.current or 0.0 for kind in kinds])  # A a step
        self._res = np.array([kind.units.angle for kind in kinds])
        self._velocity = np.array([kind.units.velocity for kind in kinds])  # rad/s a step
        self._dead = hidden["dead_zone"] / self._res if hidden["dead_zone"].any() else None
        self.mode = np.full(n, SINGLE_TURN)
        self.goal_velocity, self.goal_pwm, self.goal_current = np.zeros(n), np.zeros(n), np.zeros(n)
        self.way = np.zeros(n)  # steps, the goal velocity on its way
        self._sharpest = np.full(n, np.inf)  # steps a tick, its fastest change
        self.most_pwm, self._most_current = np.zeros(n), np.zeros(n)
        self._kp, self._ki, self.kd = np.zeros(n), np.zeros(n), np.zeros(n)
        self._ff1, self._ff2 = np.zeros(n), np.zeros(n)
        self._vp, self._vi = np.zeros(n), np.zeros(n)
        self._sum, self._speed_sum = np.zeros(n), np.zeros(n)
        self._error, self._derivative, self._last_speed = np.zeros(n), np.zeros(n), np.zeros(n)
        self._only_p = True
        self.plain = True  # all servos are in a position mode without a limit of current

    def load(self, i: int, memory: ControlTable) -> None:
        """Take a servo's operating mode, gains and limits from its control table."""
        hidden, units = self._hidden, memory.kind.units
        self.mode[i] = memory["operating_mode"]
        self._kp[i] = memory["position_p_gain"] / memory.kind.gain_divisor
        self._kp[i] *= hidden["position_gain"][i]
        self._ki[i] = memory["position_i_gain"] / units.position_i
        self.kd[i] = memory["position_d_gain"] / units.position_d * hidden["derivative_gain"][i]
        self._ff1[i] = memory["feedforward_1st_gain"] / units.feedforward
        self._ff2[i] = memory["feedforward_2nd_gain"] / units.feedforward
        self._vp[i] = memory["velocity_p_gain"] / units.velocity_p
        self._vi[i] = memory["velocity_i_gain"] / units.velocity_i
        self.most_pwm[i] = memory["pwm_limit"]
        if "current_limit" in memory.kind.registers:
            self._most_current[i] = memory["current_limit"]
        self.plain = bool(np.isin(self.mode, (SINGLE_TURN, EXTENDED)).all())
        self._only_p = not (self._ki.any() or self.kd.any() or self._ff1.any() or self._ff2.any())

    def load_goals(self, i: int, memory: ControlTable, velocity: bool) -> None:
        """Take a servo's goals from its control table, but for the position.

        Args:
            i: the servo.
            memory: its control table.
            velocity: whether its goal velocity is new, and begins with the acceleration as it is.
        """
        self.goal_pwm[i] = memory["goal_pwm"]
        if "goal_current" in memory.kind.registers:
            self.goal_current[i] = memory["goal_current"]
        if not velocity:
            return
        self.goal_velocity[i] = memory["goal_velocity"]
        sharp, units = memory["profile_acceleration"], memory.kind.units
        if sharp == 0:
            self._sharpest[i] = np.inf
        elif memory["drive_mode"] & TIMED:
            change = abs(self.goal_velocity[i] - self.way[i])
            self._sharpest[i] = change * TICK / (sharp * MILLISECOND)
        else:
            self._sharpest[i] = sharp * units.acceleration / units.velocity * TICK

    def stop(self, i: int, memory: ControlTable) -> None:
        """Let a servo that regulates no position drive nothing: no speed, no current, no PWM."""
        goals = {CURRENT: "goal_current", VELOCITY: "goal_velocity", PWM: "goal_pwm"}
        if (mode := int(self.mode[i])) in goals:
            memory[goals[mode]] = 0
            self.way[i] = 0.0

    def restart(self, i: int, velocity: float) -> None:
        """Forget what a servo's laws remember; it moves at this velocity [rad/s]."""
        self._sum[i] = self._speed_sum[i] = self._derivative[i] = self._error[i] = 0.0
        self.way[i] = velocity / self._velocity[i]

    def position_law(self, error: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """PWM of the position law.

        Args:
            error: goal minus position [counts], (n,).
            speed: of the goal [counts/s], (n,).
        """
        if self._dead is not None:
            error = np.where(np.abs(error) < self._dead, 0.0, error)
        pwm = self._kp * error
        if not self._only_p:
            change = (error - self._error) * (TICK / (DERIVATIVE_FILTER + TICK))
            self._derivative = self._derivative * (1 - TICK / (DERIVATIVE_FILTER + TICK)) + change
            speed = speed * TICK  # counts a tick
            pwm = pwm + self.kd * self._derivative + self._ff1 * speed
            pwm = pwm + self._ff2 * (speed - self._last_speed)
            self._last_speed = speed
            self._sum = self._wound(self._sum + error, self._ki)
            pwm = pwm + self._ki * self._sum
        self._error = error
        return self._limited(pwm)

    def any_law(
        self,
        error: np.ndarray,
        speed: np.ndarray,
        velocity: np.ndarray,
        turning: np.ndarray,
        volt: np.ndarray,
    ) -> np.ndarray:
        """PWM of servos in any operating modes.

        Args:
            error: goal minus position [counts], (n,).
            speed: of the position goal [counts/s], (n,).
            velocity: as the servos measure it [rad/s], (n,).
            turning: how fast the motors turn [rad/s], (n,).
            volt: the PWM that is one volt, (n,).
        """
        mode, spin = self.mode, self._k * turning
        pwm = self.position_law(error, speed)
        drop = self._clipped(self.goal_current, self._most_current) * self._amps * self._r
        least, largest = (spin - np.abs(drop)) * volt, (spin + np.abs(drop)) * volt
        pwm = np.where(mode == SOFT, np.clip(pwm, least, largest), pwm)
        pwm = np.where(mode == CURRENT, (spin + drop) * volt, pwm)
        if (mode == VELOCITY).any():
            pwm = np.where(mode == VELOCITY, self._velocity_law(velocity), pwm)
        return np.where(
            mode == PWM, self._clipped(self.goal_pwm, self.most_pwm), self._limited(pwm)
        )

    def _velocity_law(self, velocity: np.ndarray) -> np.ndarray:
        """PWM of the velocity law, (n,), for the goal on its way; velocity [rad/s], (n,)."""
        self.way = self.way + self._clipped(self.goal_velocity - self.way, self._sharpest)
        error = self.way - velocity / self._velocity
        total = self._wound(self._speed_sum + error, self._vi)
        self._speed_sum = np.where(self.mode == VELOCITY, total, 0.0)
        return self._vp * error + self._vi * self._speed_sum

    def way_speed(self, speed: np.ndarray) -> np.ndarray:
        """Speeds of the goals on their way [counts/s], (n,), given those of position goals."""
        if self.plain:
            return speed
        return np.where(self.mode == VELOCITY, self.way * self._velocity / self._res, speed)

    def _wound(self, total: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """A sum of errors that by itself drives no more than full PWM."""
        room = np.where(gain > 0, self.most_pwm / np.where(gain > 0, gain, 1), 0)
        return np.clip(total, -room, room)

    def _limited(self, pwm: np.ndarray) -> np.ndarray:
        return self._clipped(pwm, np.minimum(np.abs(self.goal_pwm), self.most_pwm))

    @staticmethod
    def _clipped(values: np.ndarray, most: np.ndarray) -> np.ndarray:
        return np.minimum(np.maximum(values, -most), most)
