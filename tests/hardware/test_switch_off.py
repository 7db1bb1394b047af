"""Torque goes off wherever a servo can be reached, and the others are named."""

import math
from collections.abc import Sequence

import pytest

from hardware import commands, scan, switch_off
from hardware.clock import VirtualClock
from hardware.config import load_robot
from hardware.connect import DRIVERS, make_driver
from hardware.driver import Driver
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import SerialPortError

FEW = {"dynamixel": (57600, 1_000_000), "feetech": (500_000, 1_000_000)}


@pytest.fixture
def robot(monkeypatch):
    """Return a function that emulates a powered robot behind the command line."""

    def emulate(name: str) -> tuple[EmulatedRobot, Sequence[Driver]]:
        world, clock = EmulatedRobot(load_robot(name)), VirtualClock()
        driver = make_driver(load_robot(name), world, clock)
        for part in driver.parts:
            part.bus_client.open(part.robot.bus.baud)
            for servo in part.robot.servos:
                part.write_register(servo, "torque_enable", 1)
        assert world.firmware.torque_on.all()
        monkeypatch.setattr(commands, "make_driver", lambda robot: driver)
        return world, driver.parts

    return emulate


@pytest.fixture
def port(chain, monkeypatch):
    """Return a function that puts three powered servos behind a port, with these registers."""

    def emulate(**registers: dict) -> EmulatedRobot:
        world, clock = EmulatedRobot(chain(3), registers=registers), VirtualClock()
        for servo in world.servos:
            servo.write(DRIVERS["dynamixel"].torque, b"\x01", world.time)
        assert world.firmware.torque_on.all()

        def client_of(name: str, maker: str):
            return DRIVERS[maker].client_type(LoopbackPort(world, clock), clock, 0.001)

        monkeypatch.setattr(switch_off, "client_of", client_of)
        for module in (scan, switch_off):
            monkeypatch.setattr(module, "ALL_SPEEDS", FEW)
        return world

    return emulate


def refuse(*_: object) -> None:
    """Be a port that is not there."""
    raise SerialPortError("/dev/away: no such port")


@pytest.mark.parametrize("missing", [0, 1])
def test_a_missing_port_keeps_no_other_bus_powered(robot, monkeypatch, capsys, missing):
    """Of two buses one cannot be opened: the other is switched off, and the first one named."""
    world, parts = robot("pair2")
    away, there = parts[missing], parts[1 - missing]
    opened = type(away.bus_client).open
    kind = type(away.bus_client)
    monkeypatch.setattr(
        kind, "open", lambda c, baud: refuse() if type(c) is kind else opened(c, baud)
    )
    assert commands.main(["torque", "robot=pair2"]) == 1
    on = dict(zip(world.robot.names, world.firmware.torque_on.tolist(), strict=True))
    assert [name for name, powered in on.items() if powered] == away.robot.names
    said = capsys.readouterr()
    assert f"torque is off in {there.robot.names[0]!r}" in said.out
    named = f"no such port; torque may still be on in {away.robot.names[0]!r}: cut the supply"
    assert named in said.err


def test_a_servo_that_does_not_confirm_is_named(robot, capsys):
    """One servo silent: the others are off, it may be on, and the status says so."""
    world, _ = robot("arm2")
    world.servos[1].silent_until = math.inf
    assert commands.main(["torque", "robot=arm2"]) == 1
    said = capsys.readouterr()
    assert "torque is off in 'shoulder'" in said.out
    assert said.err == "torque may still be on in 'elbow': cut the supply\n"


def test_servos_of_several_speeds_are_switched_off_without_a_file(port, capsys):
    """One servo at another speed than the rest: all are off, and each has confirmed."""
    world = port(hinge2={"baud_rate": 1})
    assert commands.main(["torque", "port=/dev/x"]) == 0
    assert not world.firmware.torque_on.any()
    out = capsys.readouterr().out
    assert out.count("torque is off in") == 3 and "57600 bits/s  ID   2" in out


def test_an_unknown_type_keeps_no_other_servo_powered(port, capsys):
    """A servo whose registers are not known is named; the others are off."""
    world = port(hinge3={"model_number": 999})
    assert commands.main(["torque", "port=/dev/x"]) == 1
    assert world.firmware.torque_on.tolist()[:2] == [False, False]
    assert "may still be on: ID 3 at 1000000 bits/s (model number 999" in capsys.readouterr().err


def test_servos_that_share_an_id_have_not_confirmed(port, capsys):
    """Two servos answer as 1: both are off, but no answer says of which one it is."""
    world = port(hinge2={"id": 1})
    assert commands.main(["torque", "port=/dev/x"]) == 1
    assert not world.firmware.torque_on.any()
    assert "ID 1 at 1000000 bits/s (several servos answer as 1" in capsys.readouterr().err


@pytest.mark.parametrize("moment", ["scan", "write_register"])
def test_ctrl_c_after_the_broadcast_finds_torque_off(port, monkeypatch, capsys, moment):
    """Torque-off is broadcast before anything is looked for; the status is not that of success."""
    world = port(hinge2={"baud_rate": 1})

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(switch_off, moment, interrupt)
    assert commands.main(["torque", "port=/dev/x"]) == 130
    assert not world.firmware.torque_on.any()
    assert "may still have torque: cut the supply" in capsys.readouterr().out


def test_ctrl_c_with_a_file_names_who_may_be_powered(robot, monkeypatch, capsys):
    """Interrupted before a servo confirmed, it says which."""
    _, parts = robot("arm2")

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(type(parts[0]), "torque_off", interrupt)
    assert commands.main(["torque", "robot=arm2"]) == 130
    out = capsys.readouterr().out
    assert "interrupted; torque may still be on in 'shoulder', 'elbow'" in out


def test_nobody_at_a_port_is_no_success(port, capsys):
    """Where no servo answers, nothing is known of torque; each port is looked at."""
    world = port()
    for servo in world.servos:
        servo.silent_until = math.inf
    assert commands.main(["torque", "port=/dev/x,/dev/y"]) == 1
    error = capsys.readouterr().err
    assert "/dev/x: no servo answers" in error and "/dev/y: no servo answers" in error
