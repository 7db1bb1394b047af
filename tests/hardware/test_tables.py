"""Control tables and servo data agree with the manuals."""

from dataclasses import replace

import pytest

from hardware.config import make_robot
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from hardware.tables import servo_by_number, servo_type, servo_types
from tests.hardware.conftest import bench_data

PLACES = {
    "id": (7, 1), "torque_enable": (64, 1), "hardware_error_status": (70, 1),
    "position_p_gain": (84, 2), "bus_watchdog": (98, 1), "goal_position": (116, 4),
    "realtime_tick": (120, 2), "present_position": (132, 4), "present_temperature": (146, 1),
}  # fmt: skip


DYNAMIXEL = [name for name in servo_types() if servo_type(name).maker == "dynamixel"]


@pytest.mark.parametrize("name", DYNAMIXEL)
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


@pytest.mark.parametrize(
    ("name", "register", "span", "factory"),
    [
        ("xc330-m181", "velocity_limit", (0, 2047), 545),
        ("xc330-t288", "current_limit", (0, 910), 910),
        ("xc330-t288", "min_voltage_limit", (55, 140), 55),
        ("xc430-w150", "velocity_limit", (0, 1023), 460),
        ("xm540-w270", "current_limit", (0, 2047), 2047),
        ("2xc430-w250", "velocity_limit", (0, 1023), 275),
        ("2xc430-w250", "max_voltage_limit", (60, 160), 160),
        ("2xc430-w250", "temperature_limit", (0, 100), 80),
        ("xh430-w350", "max_voltage_limit", (95, 160), 160),
        ("2xl430-w250", "velocity_limit", (0, 1023), 250),
        ("xw540-t260", "current_limit", (0, 2047), 2047),
        ("mx-64-2", "current_limit", (0, 1941), 1941),
        ("mx-64-2", "goal_position", (-1048575, 1048575), None),
    ],
)
def test_ranges_are_the_manuals(name, register, span, factory):
    """Limits of current, velocity and voltage, and extended goals, as the type's page has them."""
    kind = servo_type(name)
    assert kind.registers[register].fixed_range == span
    assert kind.defaults.get(register) == factory


def test_a_value_beyond_its_range_is_refused_before_anything_is_asked():
    """A robot's file cannot ask for what its servo would refuse."""
    data = bench_data(registers={"current_limit": 1750, "position_p_gain": 800})
    make_robot(data)
    with pytest.raises(RobotError, match=r"current_limit = 1751; expected 0 to 1750"):
        make_robot(bench_data(registers={"current_limit": 1751}))
    with pytest.raises(RobotError, match=r"pwm_slope = 0; expected 1 to 255"):
        make_robot(bench_data(registers={"pwm_slope": 0}))


@pytest.mark.parametrize("name", servo_types())
def test_registers_do_not_overlap(name):
    """Every register has 1, 2 or 4 bytes of its own, and all goals of a type lie in the RAM."""
    taken: dict[int, str] = {}
    for register in servo_type(name).registers.values():
        assert register.size in (1, 2, 4)
        for address in range(register.address, register.address + register.size):
            assert address not in taken, (register.name, taken[address])
            taken[address] = register.name
        assert register.eeprom == (register.address < (40 if name.startswith("sts3215") else 64))
        assert not (register.name.startswith("goal_") and register.eeprom)


@pytest.mark.parametrize(
    ("name", "number", "register", "place"),
    [
        ("xc330-m288", 1240, "pwm_slope", (62, 1)),
        ("xc330-t181", 1210, "indirect_data_1", (208, 1)),
        ("xc430-w240", 1080, "present_load", (126, 2)),
        ("xm540-w270", 1120, "external_port_mode_1", (56, 1)),
        ("xm540-w150", 1130, "current_limit", (38, 2)),
        ("xh540-v270", 1140, "present_current", (126, 2)),
        ("xw540-t260", 1170, "indirect_data_29", (634, 1)),
        ("xd430-t210", 1011, "present_current", (126, 2)),
        ("xd430-t350", 1001, "goal_current", (102, 2)),
        ("xd540-t150", 1111, "external_port_mode_3", (58, 1)),
        ("xd540-t270", 1101, "external_port_data_1", (152, 2)),
        ("xw430-t333", 1270, "startup_configuration", (60, 1)),
        ("2xl430-w250", 1090, "present_load", (126, 2)),
        ("mx-28-2", 30, "present_load", (126, 2)),
        ("mx-106-2", 321, "acceleration_limit", (40, 4)),
    ],
)
def test_anchors_of_the_manuals(name, number, register, place):
    """Model numbers and a telling register of each family are the manual's."""
    kind = servo_type(name)
    assert kind.number == number
    assert (kind.registers[register].address, kind.registers[register].size) == place


def test_most_types_by_data_sheet_have_no_emulation(chain):
    """They have motor constants of their own sheet; an emulated robot of them is refused."""
    kind = servo_type("xm540-w270")
    assert kind.stall_torque(12.0) == pytest.approx(10.6, rel=0.3)
    assert 12.0 / kind.torque_constant == pytest.approx(30 * 2 * 3.14159 / 60, rel=0.3)
    assert kind.defaults["temperature_limit"] == 80
    robot = chain(1)
    servos = tuple(replace(servo, model="xm540-w270") for servo in robot.servos)
    message = r"chain1: servos.hinge1: a xm540-w270 cannot be emulated; give port= .* use 'xl3"
    with pytest.raises(RobotError, match=message):
        EmulatedRobot(replace(robot, servos=servos))
    assert servo_by_number(350) == "xl320"
    assert servo_by_number(1280) == "xw430-t200"
    assert servo_by_number(9999) is None


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
