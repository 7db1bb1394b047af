"""Every type that can be emulated turns a pendulum as its motor constants say."""

import math

import numpy as np
import pytest

from hardware.config import Robot, make_robot
from hardware.emulator.faults import Fault
from hardware.emulator.world import EmulatedRobot
from hardware.tables import servo_type, servo_types
from tests.hardware.conftest import bench_data
from tests.hardware.emulator.host import Host, put

TYPES = [name for name in servo_types() if servo_type(name).emulated]
DYNAMIXEL = [name for name in TYPES if servo_type(name).maker == "dynamixel"]


def bench(name: str) -> Robot:
    """Return the pendulum on this type at its rated voltage."""
    data = bench_data(registers={}, supply={"voltage": servo_type(name).voltage}, watchdog=0.0)
    data["servos"]["hinge"]["model"] = name
    return make_robot(data)


@pytest.mark.parametrize("name", DYNAMIXEL)
def test_a_stalled_motor_draws_what_its_winding_lets_through(name):
    """In PWM mode V / R flows through a stuck motor; a servo reports it, or its load."""
    kind, host = servo_type(name), Host(EmulatedRobot(bench(name), faults=[Fault("stuck")]))
    host.set(operating_mode=16, torque_enable=1, goal_pwm=400)
    host.wait(0.3)
    amps = kind.voltage * 400 / 885 / kind.resistance
    if kind.current is None:
        assert host.read(1, "present_load") == pytest.approx(1000 * 400 / 885, abs=1)
    else:
        assert host.read(1, "present_current") * kind.current == pytest.approx(amps, rel=0.02)
    assert host.read(1, "present_input_voltage") == round(10 * kind.voltage)


@pytest.mark.parametrize("name", DYNAMIXEL)
def test_a_free_motor_runs_as_fast_as_its_back_emf_allows(name):
    """Without load the speed is V / K, in whichever direction."""
    kind, world = servo_type(name), EmulatedRobot(bench(name))
    world.mechanics.model.opt.gravity[:] = 0.0
    world.mechanics.model.jnt_limited[:] = 0
    put(world, operating_mode=16, torque_enable=1, goal_pwm=-885)
    world.advance(3.0)
    speed = float(world.firmware.present()[1][0])
    assert speed == pytest.approx(-kind.voltage / kind.torque_constant, rel=0.02)


@pytest.mark.parametrize("name", [name for name in TYPES if name not in DYNAMIXEL])
def test_gears_trade_torque_for_speed(name):
    """Behind another gear the same motor stalls at another torque and runs at another speed."""
    kind, other = servo_type(name), servo_type("sts3215")
    ratio = kind.torque_constant / other.torque_constant
    if kind.resistance == other.resistance:
        assert kind.armature == pytest.approx(other.armature * ratio**2, rel=0.02)
    assert kind.number == other.number
    assert math.isclose(
        kind.stall_torque(kind.voltage) * kind.resistance, kind.voltage * kind.torque_constant
    )


def test_two_axes_of_one_servo_are_two_ids():
    """Both axes of a 2XC430 answer, each with a table of its own."""
    data = bench_data(2, registers={}, supply={"voltage": 12.0}, model="pair2.xml")
    for name, servo in zip(("hinge", "swing"), list(data["servos"].values()), strict=True):
        data["servos"][name] = servo | {"model": "2xc430-w250"}
    data["servos"] = {name: data["servos"][name] for name in ("hinge", "swing")}
    host = Host(EmulatedRobot(make_robot(data)))
    assert [host.read(number, "model_number") for number in (1, 2)] == [1160, 1160]
    assert host.write(2, "position_p_gain", 333) == 0
    assert [host.read(number, "position_p_gain") for number in (1, 2)] == [700, 333]
    assert np.isclose(host.world.firmware.supply, 12.0).all()
