"""The emulator's servos behind Feetech ones: their motor, gains and units.

    robot = inner(load_robot("so101"))              # what `World` is made of

What a client sees of them is in `feetech.py`.
"""

from dataclasses import dataclass, field, fields, replace
from functools import cache

from hardware.config import Robot, Servo
from hardware.tables import ServoType, servo_type

INNER = "xm430-w350"  # whose control table the inner servos have
FASTEST = 32767  # counts/s, more than any servo turns
LARGEST_PWM = 970  # of 1000 (BAM, by oscilloscope)
EXTENDED = 4  # the inner servos' first operating mode: limits and turns are the shell's


@dataclass(frozen=True)
class InnerServo(Servo):
    """A servo of the emulator in place of a Feetech one."""

    settings: dict[str, int] = field(default_factory=dict)  # of Feetech's registers

    @property
    def type(self) -> ServoType:
        """The inner type."""
        return inner_type(self.model)


@cache
def inner_type(name: str) -> ServoType:
    """Return the emulator's own type with the motor and units of a Feetech type."""
    kind, table = servo_type(name), servo_type(INNER)
    units = replace(
        table.units,
        velocity=kind.units.velocity,
        acceleration=kind.units.acceleration,
        full_pwm=kind.units.full_pwm,
        velocity_p=kind.units.velocity_p,
        velocity_i=kind.units.velocity_i,
    )
    names = ("temperature_limit", "max_voltage_limit", "min_voltage_limit", "shutdown")
    gains = ("position_p_gain", "velocity_p_gain", "velocity_i_gain")
    own = {name: kind.defaults[name] for name in (*names, *gains)} | {"velocity_limit": FASTEST}
    own |= {"operating_mode": EXTENDED, "pwm_limit": LARGEST_PWM, "goal_pwm": LARGEST_PWM}
    kept = {f.name: getattr(kind, f.name) for f in fields(kind)}
    kept |= {name: getattr(table, name) for name in ("firmware", "modes", "indirect", "registers")}
    return ServoType(**kept | {"defaults": {**table.defaults, **own}, "units": units})


def inner(robot: Robot) -> Robot:
    """Return a robot with inner servos for Feetech ones; one without any is returned as it is."""
    if all(s.type.maker != "feetech" or isinstance(s, InnerServo) for s in robot.servos):
        return robot
    servos = []
    for servo in robot.servos:
        if servo.type.maker != "feetech":
            own = {**robot.registers, **servo.registers}
            servos.append(replace(servo, registers=own))
            continue
        given = {f.name: getattr(servo, f.name) for f in fields(servo)}
        given |= {"registers": {}, "torque": None}
        servos.append(InnerServo(**given, settings=robot.registers_of(servo)))
    return replace(robot, servos=tuple(servos), registers={})
