"""One servo: the firmware's loop, and the motor that it drives.

    servo = Servo(kp=16, limit=3, braking=0.25)
    firmware = Firmware(servo, period=0.0005, home=0.0)
    demand = firmware.tick(goal=0.3, angle=0.29)    # N·m that the loop asks for
    motor = Motor(servo, step=0.0005)
    torque = motor(demand, speed=1.0)               # N·m at the joint

The loop runs at a rate of its own on the angle that its encoder counts, takes the speed from
differences of counts through a first-order filter, and holds its demand until the next tick. A
motor driven by voltage brakes itself by its back-EMF, current or not; one with a current loop does
not, and has a torque that falls off near its no-load speed.
"""

import math
from dataclasses import dataclass

FILTER = 0.001  # s: time constant of the firmware's filter of speed
COLDEST = 0.05  # the least share of its torque that a hot motor keeps


@dataclass(frozen=True)
class Servo:
    """The settings of one servo and the data of its motor."""

    kp: float = 0.0  # torque per error [N·m/rad]; 0 with `torque`: commands are torques
    kd: float = 0.0  # torque per speed, taken off [N·m·s/rad]
    ki: float = 0.0  # torque per integral of the error [N·m/(rad·s)]
    limit: float = math.inf  # largest demand [N·m]
    torque: bool = False  # whether commands are torques in N·m instead of angles
    # torque per speed of the back-EMF in a motor that is driven by voltage [N·m·s/rad]
    braking: float = 0.0
    counts: float = 2.0**16  # of the encoder in one turn, as the firmware has it
    strength: float = 1.0  # factor on torque and its limit
    supply: float = 1.0  # factor on the voltage
    stall: float = math.inf  # torque at rest of the torque-speed limit [N·m]; inf is none
    no_load: float = math.inf  # speed at which that has fallen to 0 [rad/s]
    lag: float = 0.0  # time constant of the current loop [s]
    heating: float = 0.0  # loss per N²·m²·s
    dead_zone: float = 0.0  # error that the firmware takes for 0 [rad]
    fastest: float = math.inf  # limit of the goal's speed [rad/s]
    sharpest: float = math.inf  # limit of the goal's acceleration [rad/s²]


class Firmware:
    """The control loop of one servo."""

    def __init__(self, servo: Servo, period: float, home: float) -> None:
        """Start at rest, with the goal at `home` [rad]."""
        self._servo, self._period = servo, period
        self._goal, self._goal_speed = home, 0.0
        self._before: float | None = None
        self._speed = self._sum = 0.0

    def tick(self, goal: float, angle: float) -> float:
        """Return the torque that the loop asks for until the next tick [N·m].

        Args:
            goal: the last command that arrived [rad, or N·m].
            angle: what the joint is at, as its encoder sees it [rad].
        """
        servo = self._servo
        if servo.torque:
            return max(-servo.limit, min(servo.limit, goal))
        count = 2 * math.pi / servo.counts
        seen = round(angle / count) * count
        before = seen if self._before is None else self._before
        share = self._period / (FILTER + self._period)
        self._speed += share * ((seen - before) / self._period - self._speed)
        self._before = seen
        error = self._follow(goal) - seen
        error = math.copysign(max(abs(error) - servo.dead_zone, 0.0), error)
        demand = servo.kp * error - servo.kd * self._speed + servo.ki * self._sum
        bounded = max(-servo.limit, min(servo.limit, demand))
        if demand == bounded:  # the integral rests while the motor cannot do more
            self._sum += self._period * error
        return bounded

    def _follow(self, goal: float) -> float:
        """Return the goal of a trapezoidal profile, moved on by one tick [rad]."""
        servo, period = self._servo, self._period
        if math.isinf(servo.fastest) and math.isinf(servo.sharpest):
            self._goal = goal
            return goal
        way = goal - self._goal
        brake = math.sqrt(2 * servo.sharpest * abs(way)) if servo.sharpest < math.inf else math.inf
        wanted = math.copysign(min(servo.fastest, brake, abs(way) / period), way)
        most = servo.sharpest * period
        self._goal_speed += max(-most, min(most, wanted - self._goal_speed))
        self._goal += self._goal_speed * period
        return self._goal


class Motor:
    """The motor of one servo, with what it has heated up."""

    def __init__(self, servo: Servo, step: float) -> None:
        self._servo, self._step = servo, step
        self._torque = self._heat = 0.0

    def __call__(self, demand: float, speed: float) -> float:
        """Return the torque at the joint after one step [N·m].

        Args:
            demand: of the firmware [N·m].
            speed: of the motor at the joint [rad/s].
        """
        servo, step = self._servo, self._step
        driven = self._within(servo.strength * servo.supply * demand, speed)
        rise = 1.0 if servo.lag == 0 else -math.expm1(-step / servo.lag)
        self._torque += rise * (driven - self._torque)
        kept = 1.0
        if servo.heating:
            kept = max(1 - servo.heating * self._heat, COLDEST)
            self._heat += step * (kept * self._torque) ** 2
        return kept * self._torque - servo.braking * speed

    def _within(self, torque: float, speed: float) -> float:
        """Return a torque bounded by the line from stall to no-load speed [N·m]."""
        servo = self._servo
        if math.isinf(servo.stall):
            return torque
        left = servo.stall * (1 - speed / servo.no_load)
        right = -servo.stall * (1 + speed / servo.no_load)
        return max(min(right, 0.0), min(max(left, 0.0), torque))
