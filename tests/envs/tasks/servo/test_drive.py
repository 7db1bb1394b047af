"""The two fidelities: constants from registers, and how near the emulated bus each comes."""

import logging
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from envs.effects import make
from envs.errors import TaskError
from envs.plant import Plant
from envs.replay import Recording, replay
from envs.simulation import Simulation
from envs.tasks import Bench1, Hopper2, Quad8, Quad12, ServoTask
from envs.tasks.base import CommandState, State
from envs.tasks.servo.drive import KINDS, max_torque_rate, servo
from envs.tasks.servo.robot import ROBOTS
from hardware.config import Robot, make_robot
from hardware.connect import make_driver
from hardware.log import Log
from hardware.record import record
from hardware.safety import Guard
from hardware.tables import servo_type

log_ = logging.getLogger(__name__)


def robot_file(name: str, **registers: int) -> dict[str, Any]:
    """Return what a robot's file holds, with some registers set otherwise."""
    data = yaml.safe_load((ROBOTS / f"{name}.yaml").read_text(encoding="utf-8"))
    data["registers"].update(registers)
    return data


@pytest.mark.parametrize("task", [make("servo") for make in (Bench1, Hopper2, Quad8, Quad12)])
def test_the_registers_give_the_models_own_actuators(task: ServoTask) -> None:
    """Registers and supply yield the gains, limits and back-EMF that the MJCF states."""
    own, model = mujoco.MjModel.from_xml_path(f"envs/assets/{task.asset}"), task.spec().compile()
    for field in ("actuator_biasprm", "actuator_gainprm", "actuator_forcerange"):
        np.testing.assert_allclose(getattr(model, field), getattr(own, field), rtol=2e-4, atol=1e-9)
    np.testing.assert_allclose(model.actuator_damping, own.actuator_damping, rtol=2e-4)
    np.testing.assert_allclose(model.actuator_delay, 0.001)


def test_registers_scale_the_law() -> None:
    """Half the P gain halves the stiffness, half the PWM limit the torque; D gives damping."""
    models = []
    for registers in ({}, {"position_p_gain": 400, "pwm_limit": 442, "position_d_gain": 160}):
        models.append(Bench1("servo", robot_file("bench1", **registers)).spec().compile())
    full, half = models
    np.testing.assert_allclose(half.actuator_biasprm[0, 1], full.actuator_biasprm[0, 1] / 2)
    np.testing.assert_allclose(half.actuator_forcerange, full.actuator_forcerange * 442 / 885)
    kp, kv = -half.actuator_biasprm[0, 1], -half.actuator_biasprm[0, 2]
    assert kv / kp == pytest.approx(160 / 16 * 0.001 / (400 / 256))
    assert full.actuator_biasprm[0, 2] == 0


@pytest.mark.parametrize("name", KINDS)
def test_a_type_is_the_same_motor_in_both_rooms(name: str) -> None:
    """What trains and what the driver's emulator runs have the same constants, to their digits."""
    motor, kind = KINDS[name], servo_type(name)
    assert motor.constant == pytest.approx(kind.torque_constant, rel=1e-3)
    assert motor.resistance == pytest.approx(kind.resistance, rel=1e-3)
    assert (motor.divisor, motor.full) == (kind.gain_divisor, kind.units.full_pwm)
    assert motor.slope == pytest.approx(1e3 * kind.slope)
    if kind.maker == "dynamixel":
        assert motor.current == kind.current


def test_what_is_not_simulated_is_refused() -> None:
    """An integral gain and an unknown servo are named, with the remedy."""
    with pytest.raises(TaskError, match="position_i_gain=5"):
        Bench1("servo", robot_file("bench1", position_i_gain=5))
    spec = mujoco.MjSpec.from_file("envs/assets/bench1.xml")
    with pytest.raises(TaskError, match="xl330-m288"):
        servo(spec.actuator("hinge"), "xl330-m28", {"position_p_gain": 1}, 5.0, 0.0, 0.001)


def emulated(robot: Robot, goals: np.ndarray) -> Log:
    """Drive the emulated bus along goals [rad], (T, n)."""
    driver = make_driver(robot)
    try:
        driver.connect()
        driver.configure()
        with Guard(driver) as guard:
            guard.arm()
            return record(guard, goals)
    finally:
        driver.close()


def gap(task: ServoTask, log: Log) -> float:
    """Return how far the task's servos are from a log's under its commands [rad], rms.

    The angles were read some milliseconds before the command of their row, so that the simulation
    is asked for both moments.
    """
    model = task.spec().compile()
    actuators = [model.actuator(i).name for i in range(model.nu)]
    joints = [model.joint(model.actuator_trnid[i, 0]).name for i in range(model.nu)]
    ctrl = np.column_stack([log.column(f"ctrl.{name}") for name in actuators])
    read = np.column_stack([log.column(f"qpos.{name}") for name in joints])
    stamp = np.column_stack([log.column(f"stamp.{name}") for name in joints]).mean(axis=1)
    time = np.append(log.time[0], np.column_stack([stamp[1:], log.time[1:]]).ravel())
    held = np.stack([ctrl[:-1], ctrl[1:]], axis=1).reshape(-1, ctrl.shape[1])
    qpos = task.start.copy()
    qpos[task.q] = read[0]
    plant = Plant(task.spec(), fixed=[e for e in task.fixed() if e[0].name == "pwm_slope"])
    recording = Recording(time, np.concatenate([ctrl[:1], held]), qpos, np.zeros(task.nv))
    (path,) = replay(plant, [recording])
    simulated = path[1::2, task.q]
    return float(np.sqrt(np.mean((simulated - read[1:]) ** 2)))


def pattern(task: ServoTask, action: np.ndarray, steps: int) -> np.ndarray:
    """Return the goals of a task under a constant action [rad], (T, n), before any limit."""
    idle = np.tile(action, (steps, 1))
    goal = np.zeros((steps, len(task.q)))
    command = CommandState(np.arange(steps) * task.dt, idle, goal)
    state = State(np.tile(task.start, (steps, 1)), np.zeros((steps, task.nv)), None, None, command)
    return task.target_angles(state, idle)


@pytest.mark.parametrize(
    ("make_task", "action", "nearest", "farthest"),
    [
        (Bench1, [0.0], 6e-3, 50e-3),
        pytest.param(Hopper2, [0.1, -0.3], 25e-3, 25e-3, marks=pytest.mark.slow),
        (Quad8, [0.1, 0.1, 0.0, 0.0, -0.2, -0.1, -0.1, -0.2], 13e-3, 25e-3),
        pytest.param(
            *(Quad12, [0.1, 0.1, 0.0, 0.0, -0.2, -0.1, -0.1, -0.2, 0, 0, 0.1, 0.1], 16e-3, 25e-3),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_servo_is_near_the_emulated_bus_and_ideal_is_not(
    make_task: type[Bench1 | Hopper2 | Quad8 | Quad12],
    action: list[float],
    nearest: float,
    farthest: float,
) -> None:
    """Under the same commands, one is within milliradians, the other several times farther off."""
    task = make_task("servo")
    goals = pattern(task, np.array(action), round(3.0 * task.machine.rate))
    log = emulated(make_robot(robot_file(task.machine.name)), goals)
    near, far = gap(task, log), gap(make_task("ideal"), log)
    log_.info("%s: servo %.1f mrad, ideal %.1f", task.machine.name, 1e3 * near, 1e3 * far)
    assert near < nearest
    assert far > farthest
    assert far > 3 * near


def test_a_slow_voltage_is_simulated_too() -> None:
    """With the factory's PWM slope, the simulation that has it is nearer than the one without."""
    data = robot_file("bench1", pwm_slope=20)
    goals = 1.2 * np.sign(np.sin(2 * np.pi * 0.7 * np.arange(150) / 50))[:, None]
    data["max_step"], data["servos"]["hinge"]["velocity"] = 3.0, 150.0
    log = emulated(make_robot(data), goals)
    with_slope, without = gap(Bench1("servo", data), log), gap(Bench1("servo"), log)
    log_.info("PWM slope: with it %.1f mrad, without %.1f", 1e3 * with_slope, 1e3 * without)
    assert with_slope < 15e-3 < 3 * with_slope < without
    assert max_torque_rate("xl330-m288", {"pwm_slope": 255}) == np.inf
    motor = KINDS["xl330-m288"]
    volts = max_torque_rate("xl330-m288", {"pwm_slope": 140}) * motor.resistance / motor.constant
    assert volts == pytest.approx(277, abs=1)  # V/s: 140 steps of 1.977 mV a millisecond


def test_the_users_effect_replaces_the_tasks_own() -> None:
    """A quantization or filter that the user gives counts instead of the firmware's."""
    coarse = Simulation(Bench1("servo"), 1, threads=1, fixed=[(make("quantization"), (0.1,))])
    coarse.reset(np.arange(1), coarse.space.points(1), np.array([1], np.uint64))
    for _ in range(30):
        angle = coarse.step(None, np.zeros((1, 1))).observation[0, 0]
    assert angle / 0.1 == pytest.approx(round(angle / 0.1))
