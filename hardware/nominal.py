"""A public model with the servos of a robot's file: their gains, limits, back-EMF and rotors.

    robot = write_nominal_model(load_robot("koch", "low_cost_robot_arm.xml"), Path("koch.xml"))
    robot.model                             # koch.xml

Public models have stiff actuators, and armatures, damping and friction of all kinds of origin. Here
each actuator becomes what its servo is by its registers, its supply and its type's data: torque =
P duty K V / R for an error of position, as far as PWM and current are allowed to go, less back-EMF;
its joint gets the rotor's inertia, and no damping or friction of its own: what there is of them is
for a diagnosis to find.

What no actuator of the engine has, the model states in numbers, which our simulations read: the
derivative time kd / kp [s], since a derivative gain acts on the goal's motion too, and the largest
rate of the torque before back-EMF [N·m/s], where a register limits the slope of the voltage:
`<numeric name="derivative_time.ACTUATOR" data="0.004"/>`, `<numeric name="torque_rate.ACTUATOR"
data="31.4"/>`.
"""

import math
from dataclasses import replace
from pathlib import Path

import mujoco

from hardware.config import Robot, Servo
from hardware.emulator.control import SOFT
from hardware.emulator.feetech_inner import LARGEST_PWM
from hardware.emulator.mechanics import TICK
from hardware.errors import RobotError, format_names
from hardware.files import atomic_write
from hardware.tables import FASTEST_SLOPE

TIME, RATE = "derivative_time", "torque_rate"  # as `envs.servo_numbers` reads them


def write_nominal_model(robot: Robot, path: Path) -> Robot:
    """Write the robot's model with its servos as actuators; return the robot with it.

    Meshes are looked for where the robot's own model has them.

    Raises:
        RobotError: the model cannot be read, or lacks the actuator of a servo.
    """
    with atomic_write(path) as temporary:
        temporary.write_text(nominal(robot).to_xml(), encoding="utf-8")
    return replace(robot, model=path)


def nominal(robot: Robot) -> mujoco.MjSpec:
    """Return the robot's model with its servos as actuators; raises as `write_nominal_model`."""
    try:
        spec = mujoco.MjSpec.from_file(str(robot.model))
    except ValueError as error:
        raise RobotError(f"{robot.model}: the model cannot be read: {error}") from None
    spec.meshdir = str((robot.model.parent / spec.meshdir).resolve())
    spec.texturedir = str((robot.model.parent / spec.texturedir).resolve())
    actuators = {actuator.name: actuator for actuator in spec.actuators}
    if missing := [name for name in robot.names if name not in actuators]:
        raise RobotError(
            f"{robot.model} has no actuators {format_names(missing)}; it has "
            f"{format_names(actuators)}"
        )
    for number in [n for n in spec.numerics if n.name.partition(".")[0] in (TIME, RATE)]:
        spec.delete(number)
    for servo in robot.servos:
        actuator = actuators[servo.name]
        for name, value in _set_servo(actuator, robot, servo).items():
            spec.add_numeric(name=f"{name}.{servo.name}", data=[value], size=1)
        joint = spec.joint(actuator.target)
        joint.armature, joint.frictionloss = servo.type.armature or joint.armature, 0.0
        joint.damping[:] = 0.0
    spec.compile()
    return spec


def _set_servo(actuator: mujoco.MjsActuator, robot: Robot, servo: Servo) -> dict[str, float]:
    """Make an actuator its servo; return by name the numbers that the model has to state of it."""
    kind, volts = servo.type, robot.supply_of(servo).voltage
    registers = {**kind.defaults, **robot.registers_of(servo)}
    per_count = kind.stall_torque(volts) / kind.units.full_pwm / kind.units.angle  # N·m/rad
    kv = registers["position_d_gain"] / kind.units.position_d * per_count * TICK
    kp = kind.position_gain(registers["position_p_gain"], volts)
    kv = kv if kind.maker == "dynamixel" else 0.0
    limit = kind.stall_torque(volts) * _most_duty(servo, registers)
    outside, inside = kind.back_emf_damping, 0.0  # of the limit: of a PWM, or of a current
    if registers["operating_mode"] == SOFT and kind.current is not None:
        allowed = registers.get("goal_current", registers["current_limit"])
        limit = min(limit, kind.torque_constant * allowed * kind.current)
        outside, inside = inside, outside
    actuator.set_to_position(kp=kp, kv=kv + inside)
    actuator.damping[:] = [outside, 0.0, 0.0]
    actuator.forcelimited, actuator.forcerange = 1, [-limit, limit]
    rate = kind.torque_rate(registers.get("pwm_slope", FASTEST_SLOPE))
    stated = {TIME: kv / kp if kp else 0.0, RATE: rate if math.isfinite(rate) else 0.0}
    return {name: value for name, value in stated.items() if value}


def _most_duty(servo: Servo, registers: dict[str, int]) -> float:
    """Return the largest part of the supply that a servo's registers let it use."""
    names = ("torque_limit",) if servo.type.maker == "feetech" else ("pwm_limit", "goal_pwm")
    most = LARGEST_PWM if servo.type.maker == "feetech" else servo.type.units.full_pwm
    return min(most, *(registers[name] for name in names)) / servo.type.units.full_pwm
