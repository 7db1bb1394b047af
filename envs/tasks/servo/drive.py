"""Two ways to simulate a position servo, `ideal` and `servo`, both as one MuJoCo actuator.

    ideal(spec.actuator("knee"), "xl330-m288")
    servo(spec.actuator("knee"), "xl330-m288", {"position_p_gain": 800}, 5.0, 0.001, 0.001)

`ideal` is the naive model of a servo that follows its goal: stiff,
critically damped, limited by the data sheet's stall torque, acting at once.

`servo` is the motor and its firmware: PWM = P / divisor * counts of error, no more than the PWM
limit; V = PWM / 885 * supply; torque = K (V - K w) / R. The last term, back-EMF, is the actuator's
`damping`, outside the limit on the voltage. Together they are a direct-current motor driven by
voltage, and an affine actuator, so that every effect on servos applies. Gains are in register
units; an integral gain is refused, as no affine actuator has one, and so is a derivative gain whose
scale is not known.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import mujoco

from envs.errors import TaskError, did_you_mean

COUNT = 2.0 * math.pi / 4096.0  # rad, one step of an X-series encoder and of its goals
FULL_PWM = 885  # counts of full duty of an X-series servo
TICK = 0.001  # s, one pass of the firmware's loop
SLOPE = 1.977  # V/s, one step of the PWM slope register; the manual's 1.977 mV a millisecond
NO_SLOPE = 255  # the register's largest value, taken as no limit
CURRENT_BASED = 5  # the operating mode of positions under a limit of current
DERIVATIVE = 16  # divisor of the D gain register
LINEAR = 1  # the engine's number for linear interpolation of a delay line


class ServoMotorConstants(NamedTuple):
    """A servo type at its output: constant [N·m/A], resistance [ohm], P divisor, stall [N·m].

    `stiff` is what a naive model takes for its stiffness [N·m/rad]: a guess. `full` is the register
    of full duty, `max_pwm` the largest that the firmware gives, `limit` the register that lowers
    it, `derivative` the divisor of the D gain register (None: not known), `slope` one step of the
    PWM slope register [V/s], `current` one of the goal current's [A] (None: it has none),
    `factory_slope` the PWM slope register as delivered.
    """

    constant: float
    resistance: float
    divisor: float
    stall: float
    stiff: float
    full: int = FULL_PWM
    max_pwm: int = FULL_PWM
    limit: str = "pwm_limit"
    derivative: int | None = DERIVATIVE
    slope: float = SLOPE
    current: float | None = None
    factory_slope: int = NO_SLOPE


KINDS = {
    # constant, resistance, divisor: identified in Rhoban's BAM, params/xl330; stall: e-manual, 5 V
    "xl330-m288": ServoMotorConstants(
        0.386, 3.40, 256, 0.52, 10.0, current=0.001, factory_slope=140
    ),
    # sqrt(0.215 N·m / 1.47 A * 5 V / 40.1 rad/s) and 5 V / 1.47 A of its data sheet
    "xl330-m077": ServoMotorConstants(
        0.135, 3.40, 256, 0.215, 10.0, current=0.001, factory_slope=140
    ),
    # sqrt(1.4 N·m / 1.3 A * 11.1 V / 6.0 rad/s) and 11.1 V / 1.3 A of its data sheet;
    # stiffness: that of a public model of such servos (MuJoCo Menagerie's dynamixel_2r)
    "xl430-w250": ServoMotorConstants(1.42, 8.54, 128, 1.4, 50.0),
    # sqrt(3.0 N·m / 2.3 A * 12 V / 8.06 rad/s) and 12 V / 2.3 A of its data sheet;
    # stiffness: as above
    "xm430-w210": ServoMotorConstants(1.39, 5.22, 128, 3.0, 50.0, current=0.00269),
    # sqrt(4.1 N·m / 2.3 A * 12 V / 4.8 rad/s) and 12 V / 2.3 A of its data sheet;
    # stiffness: as above
    "xm430-w350": ServoMotorConstants(2.11, 5.22, 128, 4.1, 50.0, current=0.00269),
    # the same of their data sheets at 11.1 V, 12 V and 12 V; stiffness: of ToddlerBot's public
    # model (MuJoCo Menagerie's toddlerbot_2xm)
    "xc330-t288": ServoMotorConstants(1.369, 13.875, 128, 0.92, 10.0, slope=3.955, current=0.001),
    "xc430-w240": ServoMotorConstants(1.491, 8.571, 128, 1.9, 10.0),
    "2xc430-w250": ServoMotorConstants(1.517, 8.571, 128, 1.8, 4.0),
    # constant, resistance, P gain, largest duty: identified in Rhoban's BAM,
    # params/feetech_sts3215_7_4V; stall, stiffness: the public model of the SO-101 (SO-ARM100)
    "sts3215": ServoMotorConstants(
        1.178, 2.48, 3.93, 2.94, 998.22, 1000, 970, "torque_limit", None
    ),
    # its gears 1:191 and 1:147 in place of 1:345; at 12 V sqrt(2.94 N·m / 2.7 A * 12 V / 4.7 rad/s)
    # and 12 V / 2.7 A of the data sheet
    "sts3215-c044": ServoMotorConstants(
        0.652, 2.48, 3.93, 1.63, 998.22, 1000, 970, "torque_limit", None
    ),
    "sts3215-c046": ServoMotorConstants(
        0.502, 2.48, 3.93, 1.25, 998.22, 1000, 970, "torque_limit", None
    ),
    "sts3215-c018": ServoMotorConstants(
        1.665, 4.44, 3.93, 2.94, 998.22, 1000, 970, "torque_limit", None
    ),
}


def motor_constants(name: str) -> ServoMotorConstants:
    """Return a servo type's constants; raises TaskError for an unknown one."""
    if name not in KINDS:
        raise TaskError(
            f"the servo type {name!r} is not simulated{did_you_mean(name, KINDS)};"
            f" choose one of: {', '.join(KINDS)}"
        )
    return KINDS[name]


def max_torque_rate(name: str, registers: Mapping[str, int]) -> float:
    """Return how fast the firmware lets a motor's torque change [N·m/s]; inf for no limit."""
    motor = motor_constants(name)
    steps = registers.get("pwm_slope", motor.factory_slope)
    return (
        math.inf if steps >= NO_SLOPE else steps * motor.slope * motor.constant / motor.resistance
    )


def ideal(actuator: mujoco.MjsActuator, name: str) -> None:
    """Make an actuator the naive model of a servo type."""
    motor = motor_constants(name)
    actuator.set_to_position(kp=motor.stiff, dampratio=1.0)
    actuator.damping[:] = 0.0
    actuator.forcerange = [-motor.stall, motor.stall]


def servo(
    actuator: mujoco.MjsActuator,
    name: str,
    registers: Mapping[str, int],
    volts: float,
    delay: float,
    timestep: float,
) -> None:
    """Make an actuator the motor and firmware of a servo type.

    Args:
        actuator: the actuator of the spec.
        name: the servo's type.
        registers: its settings, raw values; those left out are the factory's.
        volts: the voltage of the supply [V].
        delay: the time from writing a command to its effect [s].
        timestep: the timestep of the physics [s].

    Raises:
        TaskError: a type or a setting that is not simulated.
    """
    motor = motor_constants(name)
    if registers.get("position_i_gain", 0):
        raise TaskError(
            f"{actuator.name}: position_i_gain={registers['position_i_gain']} is not simulated;"
            " set it to 0"
        )
    d_gain = registers.get("position_d_gain", 0)
    if d_gain and motor.derivative is None:
        raise TaskError(
            f"{actuator.name}: position_d_gain={d_gain} of a {name} is not simulated, because its "
            f"scale is unknown; set it to 0"
        )
    full = volts * motor.constant / motor.resistance  # N·m at full duty
    duty = full / motor.full / COUNT  # N·m/rad for a gain of one PWM step a count
    kp = registers["position_p_gain"] / motor.divisor * duty
    kv = d_gain / (motor.derivative or 1) * duty * TICK
    limit = full * min(registers.get(motor.limit, motor.max_pwm), motor.max_pwm) / motor.full
    outside, inside = motor.constant**2 / motor.resistance, 0.0  # of the limit: of PWM, of current
    if registers.get("operating_mode") == CURRENT_BASED and motor.current is not None:
        allowed = registers.get("goal_current", math.inf)
        limit = min(limit, motor.constant * allowed * motor.current)
        outside, inside = inside, outside
    actuator.set_to_position(kp=kp, kv=kv + inside)
    actuator.damping[:] = [outside, 0.0, 0.0]
    actuator.forcerange = [-limit, limit]
    if delay > 0:
        actuator.delay = delay
        actuator.nsample = math.ceil(delay / timestep) + 1
        actuator.interp = LINEAR
