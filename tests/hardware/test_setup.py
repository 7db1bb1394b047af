"""Servos fresh from the factory, or set up for something else, become a robot's."""

import math

import pytest

from hardware.bus_client import BusClient
from hardware.clock import VirtualClock
from hardware.driver import Driver
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import HardwareError, ServoError
from hardware.scan import DetectedServo, scan
from hardware.settings import Difference
from hardware.setup import set_up, write_settings

FACTORY = {"id": 1, "baud_rate": 1, "return_delay_time": 250}


class Bench:
    """Three emulated servos in any state, a person who answers, and what they were told."""

    def __init__(self, robot, registers, answers=(), connected=(0, 1, 2)) -> None:
        self.robot, self.world = robot, EmulatedRobot(robot, registers=registers)
        self.port = LoopbackPort(self.world, VirtualClock())
        self.client = BusClient(self.port, self.port.clock, robot.bus.latency)
        self.answers, self.told, self.asked = iter(answers), [], []
        self.connect(*connected)

    def connect(self, *indices: int) -> None:
        """Connect these servos, and no others."""
        for i, servo in enumerate(self.world.servos):
            servo.silent_until = 0.0 if i in indices else math.inf

    def ask(self, prompt: str, meanwhile: object = None) -> str:
        """Do what the next answer says: connect servos, or say a word."""
        self.asked.append(prompt)
        answer = next(self.answers)
        if isinstance(answer, tuple):
            self.connect(*answer)
            return ""
        return answer

    def go(self) -> None:
        """Set the robot up."""
        set_up(self.robot, self.client, self.ask, self.told.append)

    def memory(self) -> list[bytes]:
        """Return the EEPROM of every servo."""
        return [bytes(s.memory.data[:64]) for s in self.world.servos]


def test_a_robot_that_is_set_up_is_left_alone(chain):
    """Nothing differs, so nobody is asked and nothing is written."""
    bench = Bench(chain(3), {})
    before = bench.memory()
    bench.go()
    assert bench.asked == []
    assert bench.memory() == before


def test_factory_servos_one_by_one(chain):
    """Each is asked for, connected beside those that are done, shown, and written: then it runs."""
    registers = {f"hinge{i}": FACTORY for i in (1, 2, 3)}
    answers = [(0,), "y", (0, 1), "y", (0, 1, 2), "yes"]
    bench = Bench(chain(3), registers, answers, connected=())
    bench.go()
    assert [s.id for s in bench.world.servos] == [1, 2, 3]
    assert [s.baud for s in bench.world.servos] == [1_000_000] * 3
    assert [s.return_delay for s in bench.world.servos] == [0.0] * 3
    assert "servo 2 (hinge2) is missing; connect it alone, a xl330-m288" in bench.asked[2]
    told = "\n".join(bench.told)
    assert "servo 3 (hinge3): id 1 -> 3: each servo needs its own ID" in told
    assert "servo 3 (hinge3): baud_rate 1 -> 3: 57600 -> 1000000 bits/s" in told
    assert "return_delay_time 250 -> 0: answers after 500 us" in told
    driver = Driver(bench.robot, bench.port, bench.port.clock)
    driver.connect()
    assert not bench.world.firmware.torque_on.any()


def test_all_offenders_are_shown_at_once_and_written_after_one_yes(chain):
    """Modes, offset, limits, speed and second ID of three servos: one table, one question."""
    registers = {
        "hinge1": {"drive_mode": 8, "homing_offset": 100},
        "hinge2": {"operating_mode": 4, "baud_rate": 1, "secondary_id": 3},
        "hinge3": {"min_position_limit": 1900, "max_position_limit": 2100},
    }
    bench = Bench(chain(3), registers, ["y"])
    bench.go()
    assert bench.asked == ["write these 7 values? [y/N] "]
    bench.told.clear()
    bench.go()
    assert not any("->" in line for line in bench.told)


def test_no_means_no(chain):
    """Any answer but yes writes nothing; nobody to ask is said so."""
    registers = {"hinge2": {"drive_mode": 1}}
    bench = Bench(chain(3), registers, ["n"])
    before = bench.memory()
    with pytest.raises(HardwareError, match="nothing was written"):
        bench.go()
    assert bench.memory() == before

    def nobody(prompt: str, meanwhile: object = None) -> str:
        raise EOFError

    bench.ask = nobody
    with pytest.raises(HardwareError, match="there is none; nothing was written"):
        bench.go()
    assert bench.memory() == before


def test_two_new_servos_at_once_are_told_apart_by_connecting_one(chain):
    """Two factory servos answer as one ID; the person is asked again until one is there."""
    registers = {"hinge2": FACTORY, "hinge3": FACTORY}
    answers = [(0, 1, 2), (0, 1), "y", (0, 1, 2), "y"]
    bench = Bench(chain(3), registers, answers, connected=(0,))
    bench.go()
    assert [s.id for s in bench.world.servos] == [1, 2, 3]
    assert "several servos answer as 1; connect one only" in bench.told


def test_an_id_of_the_file_that_two_servos_have_is_not_written_to(chain):
    """Two servos answer as ID 1, which the file has: each is asked for alone."""
    registers = {"hinge1": {"drive_mode": 1}, "hinge2": {"id": 1, "drive_mode": 1}}
    bench = Bench(chain(3), registers, [(0,), "y", (1,), "y", (0, 1, 2)])
    bench.go()
    assert [s.id for s in bench.world.servos] == [1, 2, 3]
    assert bench.asked[0].startswith("servo 1 (hinge1) is missing; connect it alone")
    assert "ID   1  xl330-m288  firmware 52: several servos answer as 1" in bench.told[0]


@pytest.mark.parametrize("moment", ["before", "after"])
def test_settings_are_written_to_one_servo_only(chain, moment):
    """Another servo with the ID that is written to, or with the one it gets: no silent success."""
    robot = chain(2)
    twin = {"before": 1, "after": 2}[moment]
    bench = Bench(robot, {"hinge2": {"id": twin}}, connected=(0, 1))
    servo = robot.servos[1]
    found = DetectedServo(1_000_000, 1, servo.type.number, 52)
    change = Difference(servo, "id", 1, 2, "each servo needs its own ID")
    before = bench.memory()
    with pytest.raises(ServoError, match=rf"^several servos answer as {twin}; connect one only$"):
        write_settings(bench.client, servo, found, [change], 1_000_000)
    assert (bench.memory() == before) == (moment == "before")


def test_another_type_is_not_written_to(chain):
    """A servo of another model in its place is named, and the right one asked for again."""
    registers = {"hinge3": {**FACTORY, "model_number": 1060}}
    bench = Bench(chain(3), registers, [(0, 1, 2)])
    with pytest.raises(StopIteration):
        bench.go()
    assert any("xl430-w250" in line and "one new xl330-m288" in line for line in bench.told)


def test_a_servo_that_does_not_keep_a_value_is_told(chain, monkeypatch):
    """A speed that the servo did not take is found out at the end."""
    bench = Bench(chain(1), {"hinge1": {"baud_rate": 1}}, ["y"], connected=(0,))
    write = bench.client.write
    monkeypatch.setattr(
        bench.client, "write", lambda n, at, data: None if at == 8 else write(n, at, data)
    )
    with pytest.raises(ServoError, match=r"hinge1.* does not answer at its new ID and speed"):
        bench.go()


def test_all_offenders_are_refused_at_once(chain):
    """The handshake names every servo that is not as the file says, in one refusal."""
    registers = {
        "hinge1": {"drive_mode": 8},
        "hinge2": {"id": 77},
        "hinge3": {"return_delay_time": 250, "homing_offset": 5},
    }
    bench = Bench(chain(3), registers)
    with pytest.raises(ServoError) as caught:
        Driver(bench.robot, bench.port, bench.port.clock).connect()
    message = str(caught.value)
    assert message.startswith("chain3: 4 differences from its file:")
    for word in (
        "servo 1 (hinge1): drive mode 8",
        "servo 3 (hinge3): its own homing offset is 5",
        "servo 3 (hinge3): answers after 500 us",
        "no answer at any speed from '2 (hinge2)'",
    ):
        assert word in message
    assert message.count("python -m hardware setup") == 3


def test_scan_says_that_servos_share_an_id(chain):
    """Two healthy servos of one ID are one line, which says so; the third is as ever."""
    bench = Bench(chain(3), {"hinge2": {"id": 1}})
    first, third = scan(bench.client)
    assert (first.id, first.shared, third.id, third.shared) == (1, True, 3, False)
    assert str(first).endswith("firmware 52: several servos answer as 1; connect one only")


def test_scan_finds_every_servo_at_every_speed(chain):
    """Three servos at three speeds, one of them at 9600 bits/s and of another ID."""
    registers = {"hinge1": {"baud_rate": 0, "id": 42}, "hinge3": {"baud_rate": 6}}
    bench = Bench(chain(3), registers)
    found = [(f.baud, f.id, f.model) for f in scan(bench.client)]
    assert found == [
        (9600, 42, "xl330-m288"),
        (1_000_000, 2, "xl330-m288"),
        (4_000_000, 3, "xl330-m288"),
    ]
