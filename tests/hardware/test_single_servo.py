"""The verbs read, write, reboot and torque on emulated servos, in virtual time."""

from collections.abc import Callable

import pytest

from hardware import commands
from hardware.clock import VirtualClock
from hardware.connect import make_driver
from hardware.emulator.world import EmulatedRobot


@pytest.fixture
def world(monkeypatch) -> Callable[[], EmulatedRobot]:
    """Return a function that returns the world which all commands of a test share."""
    made: list[EmulatedRobot] = []
    clock = VirtualClock()

    def driver(robot):
        made[:] = made or [EmulatedRobot(robot)]
        return make_driver(robot, made[0], clock)

    monkeypatch.setattr(commands, "make_driver", driver)
    return lambda: made[0]


def test_read(world, capsys):
    """One register of one servo by its name or ID, of all servos, and whole tables."""
    assert commands.main(["read", "robot=arm2", "servo=elbow", "register=goal_pwm"]) == 0
    assert capsys.readouterr().out == "elbow (ID 2, xl330-m288)\n  goal_pwm = 885\n"
    assert commands.main(["read", "robot=arm2", "register=id"]) == 0
    assert capsys.readouterr().out.count("  id = ") == 2
    assert commands.main(["read", "robot=arm2", "servo=1"]) == 0
    out = capsys.readouterr().out
    assert "  present_input_voltage = 50\n" in out and "  drive_mode = 0\n" in out


def test_write(world, capsys):
    """RAM and EEPROM are written and read back; an ID is answered from there on."""
    line = ["write", "robot=arm2", "servo=elbow"]
    assert commands.main([*line, "register=position_p_gain", "value=321"]) == 0
    assert "elbow: position_p_gain 400 -> 321" in capsys.readouterr().out
    assert world().servos[1].memory["position_p_gain"] == 321
    assert commands.main([*line, "register=temperature_limit", "value=60"]) == 0
    assert world().servos[1].memory["temperature_limit"] == 60
    assert commands.main([*line, "register=id", "value=1"]) == 1
    assert "a servo already has the ID 1" in capsys.readouterr().err
    assert commands.main([*line, "register=id", "value=7"]) == 0
    assert world().servos[1].id == 7


def test_eeprom_of_two_servos_with_one_id_is_not_written(world, capsys):
    """An ID that two servos answer is refused, and both keep theirs."""
    assert commands.main(["read", "robot=arm2", "servo=elbow", "register=id"]) == 0
    world().servos[0].memory["id"] = 2
    assert commands.main(["write", "robot=arm2", "servo=elbow", "register=id", "value=7"]) == 1
    assert "several servos answer as 2; connect one only" in capsys.readouterr().err
    assert [servo.id for servo in world().servos] == [2, 2]


def test_a_servo_with_torque_is_not_written_to(world, capsys):
    """It may move: only with arm=true, and torque itself has its own verb."""
    assert commands.main(["read", "robot=arm2", "servo=elbow", "register=id"]) == 0
    world().servos[1].write(64, b"\x01", world().time)
    line = ["write", "robot=arm2", "servo=elbow", "register=goal_position", "value=2100"]
    before = world().servos[1].memory["goal_position"]
    assert commands.main(line) == 1
    assert "elbow has torque and may move" in capsys.readouterr().err
    assert world().servos[1].memory["goal_position"] == before
    assert commands.main([*line, "arm=true"]) == 0
    assert world().servos[1].memory["goal_position"] == 2100
    assert commands.main(["torque", "robot=arm2"]) == 0
    assert not world().firmware.torque_on.any()
    assert "torque is off in 'shoulder', 'elbow'" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["servo=elbo", "register=id", "value=1"], "no such servo (did you mean 'elbow'?)"),
        (["servo=elbow", "register=idd", "value=1"], "no register 'idd' (did you mean 'id'?)"),
        (["servo=elbow", "register=id", "value=300"], "id = 300; expected 0 to 252"),
        (["servo=elbow", "register=led", "value=1.5"], "registers hold whole numbers"),
        (["servo=elbow", "register=present_position", "value=1"], "can only be read"),
        (["servo=elbow", "register=torque_enable", "value=1"], "python -m hardware torque"),
    ],
)
def test_what_cannot_be_written(world, capsys, words, sentence):
    """A wrong name or value is one sentence and status 2, before the port is used."""
    assert commands.main(["write", "robot=arm2", *words]) == 2
    assert sentence in capsys.readouterr().err


def test_reboot(world, capsys):
    """A reboot clears what was in the RAM; a Feetech servo says how it is done."""
    assert commands.main(["read", "robot=arm2", "servo=elbow", "register=id"]) == 0
    world().servos[1].memory["position_p_gain"] = 1
    assert commands.main(["reboot", "robot=arm2", "servo=elbow"]) == 0
    assert "elbow (ID 2) has rebooted" in capsys.readouterr().out
    assert world().servos[1].memory["position_p_gain"] == 400


def test_hold(world, capsys):
    """The robot holds, watched, until Enter; then torque is off."""
    powered = []

    def ask(prompt: str, meanwhile: Callable[[], object] | None = None) -> str:
        assert meanwhile is not None
        for _ in range(20):
            meanwhile()
        powered.extend(world().firmware.torque_on.tolist())
        return ""

    assert commands.main(["torque", "robot=arm2", "on=true"], ask) == 0
    assert powered == [True, True]
    assert not world().firmware.torque_on.any()

    def nobody(prompt: str, meanwhile: object = None) -> str:
        raise EOFError

    assert commands.main(["torque", "robot=arm2", "on=true"], nobody) == 2
    assert not world().firmware.torque_on.any()
