"""What an emulated STS3215 does in each operating mode and with each instruction."""

import pytest

from hardware.config import make_robot
from hardware.emulator.feetech import FeetechBus
from hardware.emulator.world import EmulatedRobot
from hardware.feetech import protocol
from hardware.feetech.protocol import Parser, packet
from hardware.protocol import Packet
from hardware.tables import servo_type
from tests.hardware.conftest import bench_data, many_benches

BAUD = 1_000_000
KIND = servo_type("sts3215")
POSITION, WHEEL, PWM, STEP = range(4)


class Host:
    """Bytes to two emulated STS3215 on pendulums, and their answers."""

    def __init__(self, path) -> None:
        model = path / "two.xml"
        model.write_text(many_benches(2, 'gravity="0 0 0"'))
        data = bench_data(2, name="two", model=str(model), registers={}, watchdog=0.0)
        data["supply"]["voltage"] = 7.4
        for servo in data["servos"].values():
            servo["model"] = "sts3215"
        self.world, self.time = EmulatedRobot(make_robot(data)), 0.0
        self.bus = FeetechBus(self.world)

    def send(self, instruction: int, params: bytes = b"", number: int = 1) -> list[Packet]:
        """Send an instruction and return the answers."""
        arrivals = self.bus.feed(packet(number, instruction, params), self.time, BAUD)
        self.time = max([self.time + 0.005, *(time for time, _ in arrivals)])
        return Parser().feed(b"".join(piece for _, piece in arrivals))

    def read(self, name: str, number: int = 1) -> int:
        """Read a register by name."""
        register = KIND.registers[name]
        (answer,) = self.send(protocol.READ, bytes([register.address, register.size]), number)
        return register.decode(answer.params[1:])

    def write(self, number: int = 1, **registers: int) -> None:
        """Write registers by name, in this order."""
        for name, value in registers.items():
            register = KIND.registers[name]
            body = bytes([register.address]) + register.encode(value)
            assert len(self.send(protocol.WRITE, body, number)) == 1, name

    def wait(self, seconds: float) -> None:
        """Say nothing for a while [s]."""
        self.time += seconds
        self.world.advance(self.time)

    @property
    def count(self) -> float:
        """Where the first servo's shaft is, whole turns included [counts]."""
        return float(self.world.firmware.count[0])


@pytest.fixture
def host(tmp_path) -> Host:
    """Return two servos at rest in the middle of their turn."""
    return Host(tmp_path)


@pytest.mark.parametrize("speed", [1500, -1500])
def test_a_wheel_turns_at_its_speed_and_stops_where_it_is(host, speed):
    """In mode 1 register 46 is the speed, its sign the direction; 0 stops at once, and for good."""
    host.write(operating_mode=WHEEL, torque_enable=1, profile_velocity=speed)
    host.wait(1.0)
    begin = host.count
    host.wait(1.0)
    assert host.count - begin == pytest.approx(speed, rel=0.02)
    assert host.read("present_velocity") == pytest.approx(speed, abs=150)
    assert 0 <= host.read("present_position") < 4096
    host.write(profile_velocity=0)
    host.wait(1.0)
    stopped = host.count
    host.wait(1.0)
    assert host.count == pytest.approx(stopped, abs=2)


def test_a_wheel_gains_speed_by_its_acceleration(host):
    """Register 41 is the acceleration, in steps of 100 counts/s^2."""
    host.write(operating_mode=WHEEL, torque_enable=1, profile_acceleration=10)
    host.write(profile_velocity=2000)
    host.wait(1.0)
    assert host.count - 2048 == pytest.approx(500, abs=120)  # half of 1000 counts/s^2, less the lag


@pytest.mark.parametrize("duty", [300, -300])
def test_pwm_mode_drives_with_its_duty(host, duty):
    """In mode 2 register 44 is the duty; a positive one turns towards smaller positions."""
    host.write(operating_mode=PWM, torque_enable=1, goal_pwm=duty)
    host.wait(1.0)
    assert host.read("present_pwm") == -duty
    free = 7.4 / KIND.torque_constant / KIND.units.velocity  # counts/s without load
    begin = host.count
    host.wait(1.0)
    assert host.count - begin == pytest.approx(-duty / 1000 * free, rel=0.02)
    host.write(torque_limit=100)
    host.wait(0.1)
    assert abs(host.read("present_pwm")) == 100


def test_step_mode_counts_from_the_last_goal(host):
    """In mode 3 goals are ways, to either side; without limits they go on for turns."""
    host.write(operating_mode=STEP, torque_enable=1, goal_position=500)
    host.wait(1.0)
    assert host.count == pytest.approx(2548, abs=12)
    host.write(goal_position=-1000)
    host.wait(1.0)
    assert host.count == pytest.approx(1548, abs=12)
    host.write(goal_position=3000)
    host.wait(2.0)
    assert host.count == pytest.approx(4095, abs=12)  # its upper limit
    host.write(min_position_limit=0, max_position_limit=0)
    host.write(goal_position=6000)
    host.wait(4.0)
    assert host.count == pytest.approx(10095, abs=12)
    assert host.read("present_position") == pytest.approx(10095 % 4096, abs=12)


def test_a_wheel_that_becomes_a_position_servo_again_stays_within_its_turn(host):
    """The whole turns that it made are forgotten, and it goes to its goal the short way."""
    host.write(operating_mode=WHEEL, torque_enable=1, profile_velocity=3000)
    host.wait(4.0)
    host.write(profile_velocity=0)
    host.wait(0.5)
    here = host.read("present_position")
    before = host.count
    assert before > 4096
    host.write(goal_position=here, operating_mode=POSITION)
    host.wait(1.0)
    assert host.count == pytest.approx(before, abs=20)


@pytest.mark.parametrize(
    ("written", "halfway", "seconds"),
    [
        (bytes([44]) + (2000).to_bytes(2, "little"), 1.0, 2.0),
        (bytes([46]) + (300).to_bytes(2, "little"), 1.0, 2.0),
        (bytes([41, 6]), 1.0, 2.0),
    ],
)
def test_what_shapes_a_move(host, written, halfway, seconds):
    """A goal time, a speed, or an acceleration alone: 600 counts take 2 s each way."""
    host.write(torque_enable=1)
    host.send(protocol.WRITE, written)
    host.write(goal_position=2648)
    host.wait(halfway)
    assert host.count == pytest.approx(2348, abs=20)
    assert host.read("moving") == 1
    host.wait(seconds - halfway + 0.2)
    assert host.count == pytest.approx(2648, abs=12)
    assert host.read("moving") == 0


def test_damping_brakes_what_free_torque_lets_run(host):
    """Torque 2 is a short-circuited motor: it brakes and holds no position."""
    speeds = []
    for torque in (0, 2):
        host.write(torque_enable=torque)
        host.world.mechanics.data.qvel[:] = 3.0
        host.wait(0.1)
        speeds.append(abs(host.world.mechanics.speed[0]))
    assert speeds[0] == pytest.approx(3.0, rel=0.05)
    assert speeds[1] < 0.5
    assert host.read("torque_enable") == 2
    host.wait(0.5)
    host.write(torque_enable=1)
    begin = host.count
    host.wait(0.5)
    assert host.count == pytest.approx(begin, abs=3)


def test_torque_128_lets_the_present_position_be_the_middle(host):
    """The homing offset is set so, kept over a restart, and torque stays as it was."""
    host.write(torque_enable=1, goal_position=2500)
    host.wait(1.0)
    shaft = host.count
    host.write(torque_enable=128)
    assert host.read("torque_enable") == 1
    assert host.read("present_position") == pytest.approx(2048, abs=1)
    host.wait(0.5)
    assert host.count == pytest.approx(shaft, abs=12)
    host.send(protocol.REBOOT)
    host.wait(1.0)
    assert host.read("homing_offset") == pytest.approx(shaft - 2048, abs=1)
    assert host.read("present_position") == pytest.approx(2048, abs=12)


def test_calibration_to_a_value(host):
    """Instruction 0x0B takes a value, or the middle without one; other lengths are unanswered."""
    assert len(host.send(protocol.CALIBRATE, (3000).to_bytes(2, "little"))) == 1
    assert host.read("present_position") == 3000
    assert host.read("homing_offset") == 2048 - 3000
    assert len(host.send(protocol.CALIBRATE)) == 1
    assert host.read("present_position") == 2048
    assert host.send(protocol.CALIBRATE, b"\x00") == []


def test_the_homing_offset_holds_in_position_mode_only(host):
    """In the other modes the encoder's own count is reported."""
    host.write(homing_offset=100)
    assert host.read("present_position") == 1948
    host.write(operating_mode=WHEEL)
    assert host.read("present_position") == 2048


def test_registered_writes_wait_for_the_action(host):
    """Both servos start together; the flag in register 64 says that a write waits."""
    host.write(torque_enable=1)
    host.write(2, torque_enable=1)
    goal = bytes([42]) + (2300).to_bytes(2, "little")
    for number in (1, 2):
        assert len(host.send(protocol.REG_WRITE, goal, number)) == 1
    assert host.read("registered_instruction") == 1
    assert host.read("goal_position") == 2048
    assert host.send(protocol.ACTION, number=0xFE) == []
    host.wait(1.0)
    assert host.read("registered_instruction") == 0
    for number in (1, 2):
        assert host.read("present_position", number) == pytest.approx(2300, abs=12)
    assert len(host.send(protocol.ACTION)) == 1  # nothing waits: nothing happens
    assert host.read("goal_position") == 2300


def test_a_reset_keeps_the_id(host):
    """Instruction 0x06 takes the EEPROM back from the factory, torque off; 0x0A is unanswered."""
    host.write(2, lock=0, id=9)
    host.write(9, position_p_gain=5, homing_offset=77, operating_mode=WHEEL, torque_enable=1)
    assert len(host.send(protocol.RESET, number=9)) == 1
    found = [host.read(n, 9) for n in ("id", "position_p_gain", "homing_offset", "operating_mode")]
    assert found == [9, 32, 0, POSITION]
    assert host.read("torque_enable", 9) == 0
    assert host.send(0x0A, number=9) == []


def test_a_reboot_is_unanswered_and_takes_a_while(host):
    """Torque goes off, what was not kept in the EEPROM is lost, and it is silent for 0.8 s."""
    host.write(torque_enable=1, position_p_gain=5, operating_mode=WHEEL)
    assert host.send(protocol.REBOOT) == []
    host.wait(0.7)
    assert host.send(protocol.PING) == []
    host.wait(0.1)
    assert len(host.send(protocol.PING)) == 1
    found = [host.read(name) for name in ("torque_enable", "position_p_gain", "operating_mode")]
    assert found == [0, 32, POSITION]
