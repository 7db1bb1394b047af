"""More Python clients that are not ours, over the device file.

They come with the extra `clients`, but for dynamixel-helper, which excludes the maker's SDK that we
have although it works with it. The maker's Easy SDK scans, sets servos up and uses every mode;
dynamixel-python sends every instruction of the protocol; dynamixel-api reads registers by name;
dynamixel-helper searches all speeds; dynamixel-control writes in bulk at the factory's speed.
"""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
import yaml

from tests.hardware.conftest import bench_data, many_benches
from tests.hardware.test_clients import PATIENT, needs, until
from tests.hardware.test_main import emulated

pytestmark = pytest.mark.slow
REMEDY = "pip install -e '.[clients]'"


@pytest.fixture
def serve(tmp_path, monkeypatch) -> Iterator[Callable[..., str]]:
    """Return a function that emulates servos of a model and a speed, and gives their device."""
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", PATIENT)
    with ExitStack() as stack:

        def start(count: int = 3, model: str = "xl330-m288", baud: int = 1_000_000) -> str:
            mjcf, robot = tmp_path / "chain.xml", tmp_path / "chain.yaml"
            mjcf.write_text(many_benches(count, ""))
            data = bench_data(count, name="chain", model=str(mjcf))
            data["bus"]["baud"] = baud
            if model == "xl430-w250":
                data["supply"]["voltage"] = 11.1
                del data["registers"]["pwm_slope"]
            for servo in data["servos"].values():
                servo["model"] = model
            robot.write_text(yaml.safe_dump(data))
            return stack.enter_context(emulated(f"robot={robot}"))[0]

        yield start


def test_easy_sdk(serve):
    """The maker's Easy SDK finds servos, turns them in every mode, and stages group commands."""
    import dynamixel_easy_sdk as easy

    connector = easy.Connector(serve(), 1_000_000)
    motors = connector.createAllMotors(0, 10)
    assert [motor.id for motor in motors] == [1, 2, 3]
    first, second, third = motors
    modes = easy.OperatingMode
    for mode, command in [
        (modes.POSITION, lambda: first.setGoalPosition(2300)),
        (modes.EXTENDED_POSITION, lambda: first.setGoalPosition(6000)),
        (modes.CURRENT_BASED_POSITION, lambda: first.setGoalPosition(5000)),
        (modes.VELOCITY, lambda: first.setGoalVelocity(40)),
        (modes.CURRENT, lambda: first.setGoalCurrent(50)),
        (modes.PWM, lambda: first.setGoalPWM(200)),
    ]:
        first.disableTorque()
        first.setOperatingMode(mode)
        assert first.getOperatingMode() == mode
        first.enableTorque()
        command()
        if mode in (modes.POSITION, modes.EXTENDED_POSITION):
            goal = 2300 if mode == modes.POSITION else 6000
            until(lambda goal=goal: abs(first.getPresentPosition() - goal) < 150)
        elif mode == modes.VELOCITY:
            until(lambda: first.getPresentVelocity() > 20)
        elif mode == modes.CURRENT:
            until(lambda: first.getPresentCurrent() == pytest.approx(50, abs=15))
        elif mode == modes.PWM:
            until(lambda: first.getPresentPWM() == 200)
    second.setDirection(easy.Direction.REVERSE)
    assert 0 <= second.getPresentPosition() <= 4095
    second.setProfileConfiguration(easy.ProfileConfiguration.TIME_BASED)
    second.setHomingOffset(100)
    assert second.getPresentPosition() == pytest.approx(2148, abs=2)
    second.setVelocityLimit(300)
    assert second.getVelocityLimit() == 300
    with pytest.raises(easy.DxlRuntimeError):
        second.setVelocityLimit(2048)
    group = connector.createGroupExecutor()
    for motor in (second, third):
        group.addCmd(motor.stageEnableTorque())
    group.executeWrite()
    group.clearStagedWriteCommands()
    for motor in (second, third):
        group.addCmd(motor.stageIsTorqueOn())
    assert group.executeRead() == [1, 1]
    group.clearStagedReadCommands()
    group.addCmd(second.stageGetPresentPosition())
    group.addCmd(third.stageIsLEDOn())
    position, light = group.executeRead()
    assert position in range(2000, 2160)  # on its way to the goal from before the homing offset
    assert light == 0
    third.disableTorque()
    third.changeID(9)
    assert third.ping() == 1200
    third.reboot()
    time.sleep(0.5)
    third.factoryResetExceptIDAndBaudRate()
    time.sleep(0.5)
    assert sorted(connector.broadcastPing()) == [1, 2, 9]
    connector.closePort()


@needs("dxl2", REMEDY)
def test_dynamixel_python(serve):
    """dynamixel-python, written from scratch, gets through every instruction of the protocol."""
    from dxl2 import v2

    device = serve()
    bus = v2.MotorBus(device, 1_000_000, timeout=1.0)
    bus.connect()
    assert bus.ping(2).data == {"model_number": 1200, "firmware_version": 52}
    assert bus.ping(9).timeout
    assert bus.write(1, 84, 2, 321).ok
    assert bus.read(1, 84, 2).data == 321
    assert bus.write(1, 11, 1, 2).error == 4
    assert bus.write(1, 116, 2, 5).error == 5
    assert bus.write(1, 116, 4, 4096).error == 6
    assert bus.write(1, 132, 4, 0).error == 7
    assert bus.action(1).error == 2
    assert bus.reg_write(1, 65, 1, 1).ok
    assert bus.action(1).ok
    assert bus.read(1, 65, 1).data == 1

    group = v2.SyncParams(116, 4, signed=True)
    for number in (1, 2, 3):
        group.add_value(number, 2000 + number)
    bus.sync_write(group)
    bulk = v2.BulkParams()
    bulk.add_value(2, 65, 1, 1)
    bulk.add_value(3, 84, 2, 77)
    bus.bulk_write(bulk)
    group = v2.SyncParams(116, 4, signed=True)
    for number in (3, 1, 2):
        group.add_motor(number)
    assert bus.sync_read(group).data == [2003, 2001, 2002]
    assert bus.fast_sync_read(group, signed=True).data == [2003, 2001, 2002]
    bulk = v2.BulkParams()
    bulk.add_address(2, 65, 1)
    bulk.add_address(3, 84, 2)
    assert bus.bulk_read(bulk).data == [1, 77]
    assert bus.fast_bulk_read(bulk).data == [1, 77]

    assert bus.write(1, 11, 1, 4).ok
    assert bus.clear_position(1).ok
    assert bus.write(1, 20, 4, 55).ok
    assert bus.control_table_restore(1).error == 1
    assert bus.control_table_backup(1).ok
    assert bus.read(1, 147, 1).data == 1
    assert bus.write(1, 20, 4, 66).ok
    assert bus.control_table_restore(1).ok
    time.sleep(0.5)
    assert bus.read(1, 20, 4).data == 55
    assert bus.reboot(1).ok
    time.sleep(0.5)

    assert bus.write(1, 7, 1, 20).ok
    assert bus.write(20, 8, 1, 1).ok
    found = bus.scan([57600, 115_200, 1_000_000, 4_500_000])
    assert {baud: set(motors) for baud, motors in found.items()} == {57600: {20}, 1_000_000: {2, 3}}
    bus.set_baudrate(57600)
    assert bus.factory_reset_except_id_baudrate(20).ok
    time.sleep(0.5)
    assert bus.read(20, 20, 4).data == 0
    assert bus.factory_reset_except_id(20).ok
    time.sleep(0.5)
    assert bus.factory_reset(20).ok
    time.sleep(0.5)
    assert bus.ping(1).ok
    bus.disconnect()


@needs("dynamixel_api", REMEDY)
def test_dynamixel_api(serve):
    """dynamixel-api reads every register of its table, and drives position and velocity mode."""
    from dynamixel_api.models.xl430w250t import XL430W250T_FIELDS, XL430W250TConnector
    from dynamixel_api.motor_control import Motor

    connector = XL430W250TConnector(serve(1, "xl430-w250"), 1_000_000, 1)
    connector.connect()
    expected = {
        field.name: field.initial_value
        for field in XL430W250T_FIELDS
        if field.initial_value is not None
    }
    found = {name: connector.read_field(name) for name in expected}
    set_up = {"baud_rate": 3, "return_delay_time": 0, "startup_configuration": 0}
    moving = {name: found[name] for name in ("moving", "moving_status")}
    assert found == expected | set_up | moving
    motor = Motor(connector)
    motor.torque_enabled = True
    motor.goal_position = 2200
    until(lambda: abs(motor.current_position - 2200) < 40)
    motor.torque_enabled = False
    motor.operating_mode = 1
    motor.torque_enabled = True
    motor.goal_velocity = 50
    until(lambda: abs(motor.current_velocity - 50) < 15)
    connector.disconnect()


@needs("dynamixel_helper", "pip install --no-deps dynamixel-helper")
def test_dynamixel_helper(serve, tmp_path, capsys):
    """dynamixel-helper tries every speed until its motors answer, at theirs and no other."""
    from dynamixel_helper import DxlHelper

    preset = tmp_path / "preset.json"
    motors = [{"id": n, "alias": f"joint{n}", "model": "XL430-W250"} for n in (1, 2)]
    ports = [serve(2, "xl430-w250", 2_000_000)]
    words = {"ports": ports, "baud rates": "auto", "protocol versions": [2.0], "motors": motors}
    preset.write_text(json.dumps(words))
    helper = DxlHelper(str(preset), "quiet")
    motor = helper.get_motor("joint2")
    assert motor.baud == 2_000_000
    assert motor.set_operating_mode(4)
    assert motor.set_torque(True)
    assert motor.set_goal_position(6000)
    until(lambda: abs(motor.get_present_position()[0] - 6000) < 60)
    assert motor.set_torque(False)


@needs("dynamixel_control", REMEDY)
def test_dynamixel_control(serve, monkeypatch, capsys):
    """dynamixel-control speaks the factory's 57600 bits/s, in bulk writes and bulk reads."""
    from dynamixel_control import Dynamixel

    fleet = Dynamixel(serve(3, baud=57600))
    for number in (1, 2, 3):
        fleet.add_dynamixel("XL-330", number, calibration=[1023, 2048, 3073])
    monkeypatch.setattr(
        fleet, "convert_pos_to_rad", lambda counts: counts
    )  # it asks for a number 0
    fleet.set_speed(200)
    fleet.setup_all()
    fleet.update_PID(800, 0, 0)
    fleet.go_to_position_all([2148, 2048, 1948])

    def arrived() -> bool:
        fleet.bulk_read_pos()
        places = [fleet.get_position(number) for number in (1, 2, 3)]
        return all(abs(p - goal) < 25 for p, goal in zip(places, (2148, 2048, 1948), strict=True))

    until(arrived)
    fleet.reboot_dynamixel()
    time.sleep(0.5)
    fleet.end_program()
