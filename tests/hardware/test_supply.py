"""Servos of one bus on supplies of their own, such as the 12 V and 5 V of a Koch arm."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from envs.tasks.servo.robot import read_machine
from hardware.commands import main
from hardware.config import Robot, load_robot, make_robot
from hardware.emulator.faults import Fault
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, SafetyError
from hardware.parts import Supply
from tests.hardware.conftest import bench_data
from tests.hardware.emulator.host import put

LARGE = {"model": "xl430-w250", "current": None, "registers": {}}
LARGE |= {"supply": {"voltage": 12.0, "resistance": 0.2}}


def mixed(chain) -> Robot:
    """Return three pendulums on one bus: an XL430 at 12 V, two XL330 at 5 V."""
    robot = chain(3, registers={"position_p_gain": 800})
    first = make_robot(bench_data(1, registers={}, servo=LARGE)).servos[0]
    return replace(robot, servos=(first, *robot.servos[1:]))


def test_each_servo_is_armed_at_its_own_voltage(rig, chain):
    """Both supplies are measured, and neither stops the robot."""
    r = rig(robot=mixed(chain))
    r.run(10)
    volts = [r.driver.health(i).voltage for i in range(3)]
    assert volts == pytest.approx([12.0, 5.0, 5.0], abs=0.06)
    assert r.powered == [True] * 3


def test_a_supply_that_sinks_stops_its_servos_alone(rig, chain):
    """What fails is one supply: the message has its voltage, the other servo keeps its own."""
    r = rig(Fault("supply", servo=1, start=1.2, value=8.0), robot=mixed(chain))
    with pytest.raises(SafetyError, match=r"hinge1 has 8\.0 V, not 12\.0 V: the supply"):
        r.run(100)
    assert r.powered == [False] * 3
    assert r.driver.health(1).voltage == pytest.approx(5.0, abs=0.06)


def test_the_wrong_supply_is_noticed(rig, chain):
    """Servos that have another voltage than their file's supply get no torque at all."""
    believed = mixed(chain)
    r = rig(robot=replace(believed, supply=Supply(6.6)), believed=believed)
    with pytest.raises(SafetyError, match=r"hinge2 has 6\.6 V, not 5\.0 V: the supply"):
        r.guard.arm()
    assert r.powered == [False] * 3


def test_servos_sag_with_those_of_their_supply(chain):
    """V = V0 - r sum |i| over the servos of one supply; the other stays as it is."""
    robot = replace(mixed(chain), supply=Supply(5.0, 0.5))
    world = EmulatedRobot(robot, faults=[Fault("stuck", servo=2)])
    put(world, position_p_gain=800, torque_enable=1)
    stuck = world.servos[1]
    goal = stuck.memory.kind.registers["goal_position"]
    assert stuck.write(goal.address, goal.encode(4000), world.time) == 0
    world.advance(0.5)
    stalled = 5.0 / (robot.servos[1].type.resistance + 0.5)
    assert world.firmware.current[1] == pytest.approx(stalled, rel=0.02)
    np.testing.assert_allclose(world.firmware.supply, [12.0, *[5.0 - 0.5 * stalled] * 2], rtol=0.01)


def test_a_limit_of_torque_is_one_of_the_servos_own_voltage(chain):
    """The part of full PWM that stalls at that torque."""
    robot = mixed(chain)
    servo = replace(robot.servos[0], torque=0.5)
    limit = robot.registers_of(servo)["goal_pwm"]
    assert limit == round(885 * 0.5 / (12.0 * servo.type.torque_constant / servo.type.resistance))


def test_the_simulated_robot_has_the_same_voltages():
    """A task reads each servo's supply from the same file."""
    data = bench_data(2)
    data["servos"]["hinge2"]["supply"] = {"voltage": 4.5}
    assert read_machine(data, ["hinge1", "hinge2"]).voltage == (5.0, 4.5)


@pytest.mark.parametrize(
    ("supply", "message"),
    [
        ({"voltage": 12.0}, r"hinge1: its supply has 12 V, and a xl330-m288 takes 3.5 to 7 V"),
        ({"voltage": 3.0}, r"its supply has 3 V, .* give this servo its own, as in supply: \{volt"),
        ({"voltage": 0.0}, r"servos.hinge1: supply.voltage: 0.0 is not above 0"),
        ({"voltage": 5.0, "resistance": -1.0}, r"supply.resistance: -1.0 is below 0"),
        ({"volts": 5.0}, r"servos.hinge1: supply: unknown key 'volts' \(did you mean 'voltage'"),
        (5.0, r"servos.hinge1: supply: 5.0 is not a table"),
    ],
)
def test_a_supply_that_cannot_be_is_refused(supply, message):
    """Its value, its place and what is allowed; nothing was asked of a servo."""
    data = bench_data(2)
    data["servos"]["hinge1"]["supply"] = supply
    with pytest.raises(RobotError, match=message):
        make_robot(data)


def test_a_masked_voltage_error_is_taken_at_its_word():
    """Whoever lets the servo run beyond its limits has written so into its shutdown register."""
    assert load_robot("bench1_bam").supply.voltage == 7.4
    data = bench_data(supply={"voltage": 7.4})
    with pytest.raises(RobotError, match=r"7\.4 V, and a xl330-m288 takes 3\.5 to 7 V"):
        make_robot(data)
    data["registers"]["shutdown"] = 52
    assert make_robot(data).supply.voltage == 7.4


def test_the_command_line_refuses_in_one_sentence(tmp_path, capsys):
    """Exit status 2, one line, no servo touched."""
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(bench_data(supply={"voltage": 12.0})))
    assert main(["scan", f"robot={path}"]) == 2
    said = capsys.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1


def test_a_rehearsal_of_a_type_without_emulation_is_refused(tmp_path, capsys):
    """Which servo, and what to do; a real one at a port is no rehearsal."""
    path = tmp_path / "mine.yaml"
    data = bench_data(supply={"voltage": 12.0}, registers={"position_p_gain": 800})
    data["servos"]["hinge"] |= {"model": "xm540-w270", "velocity": 3.0}
    path.write_text(yaml.safe_dump(data))
    for verb in ("emulate", "scan", "monitor"):
        assert main([verb, f"robot={path}"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("bench1: servos.hinge: a xm540-w270 cannot be emulated; give port= ")
    assert make_robot(data | {"port": "/dev/ttyUSB0"}).servos[0].type.name == "xm540-w270"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": [-3.2, 3.2]}, r"is -38 to 4134 counts \(zero 2048\), and a .* takes 0 to 40"),
        ({"zero": 100}, r"position \[-2, 2\] is -1204 to 1404 counts \(zero 100\)"),
        ({"current": 9.0}, r"current 9.0; it is above 0, at most 1.75 A"),
    ],
)
def test_a_limit_beyond_the_servos_is_refused(changes, message):
    """Angles that no goal in position mode reaches, and more current than a limit can be."""
    data = bench_data()
    data["servos"]["hinge"] |= changes
    with pytest.raises(RobotError, match=message):
        make_robot(data)


def test_modes_that_count_turns_have_no_such_limit():
    """Extended position goes round and round."""
    data = bench_data()
    data["servos"]["hinge"] |= {"position": [-10.0, 10.0], "registers": {"operating_mode": 4}}
    assert math.isclose(make_robot(data).servos[0].position[1], 10.0)
