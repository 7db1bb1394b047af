"""A robot's file that would defeat the guard, or that no servo can follow, is refused."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.config import load_robot, make_robot
from hardware.driver import Driver
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, ServoError
from hardware.parts import Servo
from hardware.record import joint_names
from hardware.tables import servo_type, servo_types
from tests.hardware.conftest import bench_data


def with_register(name: str, value: object, **servo: object) -> dict:
    """Return the keys of bench1 with a register, in a servo with these keys."""
    data = bench_data()
    data["servos"]["hinge"] |= {"registers": {name: value}, **servo}
    return data


@pytest.mark.parametrize(
    ("name", "value", "place"),
    [
        ("torque_enable", 1, "the program itself"),
        ("goal_position", 3000, "the program itself"),
        ("goal_velocity", 100, "the program itself"),
        ("goal_pwm", 300, "the servo's torque: leave"),
        ("drive_mode", 1, "the servo's sign"),
        ("homing_offset", 500, "calibration"),
        ("id", 5, "the servo's key id"),
        ("secondary_id", 2, "the program itself"),
        ("baud_rate", 1, "bus.baud"),
        ("return_delay_time", 250, "bus.return_delay"),
        ("bus_watchdog", 0, "the key watchdog: leave"),
        ("protocol_type", 2, "the program itself"),
        ("status_return_level", 1, "the program itself"),
        ("startup_configuration", 1, "the program itself"),
        ("indirect_address_1", 64, "the program itself"),
        ("indirect_data_1", 1, "the program itself"),
    ],
)
def test_registers_that_the_program_owns_are_refused(name, value, place):
    """In `registers` of the robot or of a servo: the register, its value, and who sets it."""
    for data in (with_register(name, value), bench_data(registers={name: value})):
        with pytest.raises(RobotError, match=rf"hinge: registers: {name} = {value}; .*{place}"):
            make_robot(data)


@pytest.mark.parametrize(
    "name", ["torque_enable", "goal_position", "id", "baud_rate", "homing_offset", "phase", "lock"]
)
def test_feetech_registers_that_the_program_owns_are_refused(name):
    """A Feetech servo has its own names for some of them."""
    data = bench_data(registers={name: 1}, watchdog=0, supply={"voltage": 7.4})
    data["servos"]["hinge"] |= {"model": "sts3215", "velocity": 4.0}
    with pytest.raises(RobotError, match=rf"registers: {name} = 1; it is set by .*: leave it out"):
        make_robot(data)


@pytest.mark.parametrize("model", servo_types())
def test_no_type_has_another_name_for_its_torque_id_or_goal(model):
    """What every type calls its torque, ID, speed and goals is what is refused."""
    assert {"torque_enable", "id", "baud_rate", "goal_position"} <= servo_type(
        model
    ).registers.keys()


@pytest.mark.parametrize("mode", [0, 1, 16])
def test_modes_without_positions_are_refused(mode):
    """Current, velocity and PWM mode: goals would be no positions."""
    with pytest.raises(RobotError, match=rf"operating_mode = {mode}; goals are pos.*'3', '4', '5'"):
        make_robot(with_register("operating_mode", mode))
    assert make_robot(with_register("operating_mode", 5))


@pytest.mark.parametrize("value", ["high", 800.5, None])
def test_registers_hold_whole_numbers(value):
    """Anything else is one sentence."""
    with pytest.raises(RobotError, match=rf"position_p_gain = {value}; expected 0 to 16383"):
        make_robot(with_register("position_p_gain", value))


@pytest.fixture
def bench():
    """Return a function that connects to bench1, its registers not from a file."""

    def connected(**registers: int) -> tuple[Driver, EmulatedRobot]:
        world, clock = EmulatedRobot(load_robot("bench1")), VirtualClock()
        robot = replace(load_robot("bench1"), registers=registers)
        driver = Driver(robot, LoopbackPort(world, clock), clock)
        driver.connect()
        return driver, world

    return connected


@pytest.mark.parametrize("registers", [{"torque_enable": 1}, {"drive_mode": 1}, {"id": 5}])
def test_configuring_writes_no_register_that_the_program_owns(bench, registers):
    """A robot that no file described is refused as well: torque is off, nothing is written."""
    driver, world = bench(**registers)
    before = bytes(world.servos[0].memory.data[:64])
    with pytest.raises(RobotError, match="it is set by"):
        driver.configure()
    assert bytes(world.servos[0].memory.data[:64]) == before
    assert not np.any(world.firmware.torque_on)
    assert driver.powered == set()


def test_configuring_that_fails_leaves_torque_off(bench, monkeypatch):
    """A servo that has torque by the time that a register is refused has none afterwards."""
    driver, world = bench(position_p_gain=800)
    write = driver.write_register

    def refuse(servo: Servo, name: str, value: int) -> None:
        if name == "position_p_gain":
            write(servo, "torque_enable", 1)
            raise ServoError("refused")
        write(servo, name, value)

    monkeypatch.setattr(driver, "write_register", refuse)
    with pytest.raises(ServoError, match="refused"):
        driver.configure()
    assert not np.any(world.firmware.torque_on)


def test_a_multi_turn_servo_reaches_what_its_goal_register_holds():
    """256 turns either way; a travel beyond them is refused."""
    assert make_robot(with_register("operating_mode", 4, position=[-10, 10]))
    with pytest.raises(RobotError, match=r"takes -1048575 to 1048575: narrow it .* in rad"):
        make_robot(with_register("operating_mode", 4, position=[-2000, 10]))


@pytest.mark.parametrize("mode", [4, 5])
def test_degrees_of_a_multi_turn_servo_are_refused_by_its_model(mode):
    """Its encoder takes 90 rad; the joint turns by 2.2. Real robots are checked, too."""
    robot = make_robot(with_register("operating_mode", mode, position=[-90, 90]))
    for check in (EmulatedRobot, joint_names):
        with pytest.raises(RobotError, match=r"position \[-90, 90\].* range -2.2 to 2.2 rad"):
            check(robot)
    assert joint_names(make_robot(with_register("operating_mode", mode))) == ["hinge"]


def test_a_joint_without_a_range_may_turn_many_times(chain):
    """A wheel or a winch; the model says nothing of it."""
    robot = chain(1, registers={"operating_mode": 4})
    wheel = replace(robot.servos[0], position=(-90.0, 90.0))
    assert joint_names(replace(robot, servos=(wheel,))) == ["hinge1"]
