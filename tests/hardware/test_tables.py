"""Control tables and servo data agree with the manuals."""

from __future__ import annotations

import pytest

from hardware.errors import RobotError
from hardware.tables import servo_by_number, servo_type, servo_types

PLACES = {
    "id": (7, 1),
    "torque_enable": (64, 1),
    "hardware_error_status": (70, 1),
    "position_p_gain": (84, 2),
    "bus_watchdog": (98, 1),
    "goal_position": (116, 4),
    "realtime_tick": (120, 2),
    "present_position": (132, 4),
    "present_temperature": (146, 1),
}


@pytest.mark.parametrize("name", servo_types())
def test_table(name):
    """Addresses are the manual's, factory values are registers in range, numbers go both ways."""
    kind = servo_type(name)
    for register, place in PLACES.items():
        assert (kind.registers[register].address, kind.registers[register].size) == place
    assert set(kind.defaults) <= set(kind.registers)
    assert servo_by_number(kind.number) == name
    assert ("present_load" in kind.registers) == (kind.current is None)
    goal = kind.registers["goal_position"]
    for value in (-(2**31), -1, 0, 5, 2**31 - 1):
        assert goal.decode(goal.encode(value)) == value


def test_stall_torque_and_speed_are_near_the_data_sheet():
    """Motor constants give the data sheet's stall torque and no-load speed within 30 %."""
    sheet = {  # N·m, rad/s
        "xl330-m288": (0.52, 10.8),
        "xl330-m077": (0.215, 40.1),
        "xl430-w250": (1.4, 6.0),
        "xm430-w210": (3.0, 8.1),
        "xm430-w350": (4.1, 4.8),
    }
    for name, (torque, speed) in sheet.items():
        kind = servo_type(name)
        assert kind.stall_torque(kind.voltage) == pytest.approx(torque, rel=0.33)
        assert kind.voltage / kind.torque_constant == pytest.approx(speed, rel=0.33)


def test_unknown_names():
    """An unknown type or register is refused with the nearest."""
    with pytest.raises(RobotError, match=r"did you mean 'xl430-w250'"):
        servo_type("xl430-w25")
    with pytest.raises(RobotError, match=r"did you mean 'goal_position'"):
        servo_type("xl430-w250").register("goal_positon")
