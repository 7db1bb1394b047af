"""What goes wrong with servos, hosts and policies: detected, and stopped where it must be.

The numbers are those of benchmarks/notebook/servos.md; 1 to 6 are in test_wire_faults.py.
"""

import sys

import numpy as np
import pytest

from hardware import serial_ports
from hardware.clock import VirtualClock
from hardware.driver import Driver
from hardware.emulator.faults import Fault
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import SafetyError, SerialPortError, ServoError
from hardware.pace import FixedRate
from hardware.safety import StopLimits
from tests.hardware.rig import START, Rig, wave


def test_07_a_servo_that_starts_anew(rig):
    """A reboot in mid-run is seen within a second; torque goes off everywhere until armed."""
    r = rig(Fault("reboot", start=START + 0.5, servo=2, count=1))
    with pytest.raises(SafetyError, match=r"hinge2"):
        r.run(200, wave)
    assert r.clock.now() < START + 1.5
    assert r.powered == [False] * 3
    r.clock.sleep_until(r.clock.now() + 1)
    r.driver.configure()
    r.run(20)
    assert r.powered == [True] * 3


def test_08_low_supply(rig):
    """A supply that sinks by a third stops the robot with its voltage."""
    r = rig(Fault("supply", start=START + 0.5, value=3.6))
    with pytest.raises(SafetyError, match=r"has 3\.6 V, not 5\.0 V"):
        r.run(200, wave)
    assert r.powered == [False] * 3


def test_08_brown_out(rig):
    """Without supply for 0.2 s no servo answers: stopped, and off when they are back."""
    r = rig(Fault("blackout", start=START + 0.5, stop=START + 0.7))
    with pytest.raises(SafetyError, match=r"no new answer|does not report"):
        r.run(200, wave)
    r.clock.sleep_until(3.0)
    r.world.advance(3.0)
    assert r.powered == [False] * 3


def test_09_overheating(rig):
    """A servo that warms is stopped before its own limit, which only a reboot would clear."""
    r = rig(Fault("heat", start=START, value=30.0, servo=3))
    with pytest.raises(SafetyError, match=r"hinge3 is at 6\d °C; let it cool"):
        r.run(400, wave)
    assert r.powered == [False] * 3
    assert not r.world.firmware.errors.any()


def test_09_overload(rig):
    """An overload that a servo reports stops the robot, though group reads hide it in the SDK."""
    r = rig()
    r.run(20)
    r.world.firmware.shut_down(1, 0x20)
    with pytest.raises(SafetyError, match=r"hinge2 reports 'overload'"):
        r.run(20)
    assert r.powered == [False] * 3
    with pytest.raises(SafetyError, match=r"hinge2 reports 'overload'.*reboot"):
        r.guard.arm()
    assert r.driver.bus_client.reboot(2) is not None
    r.clock.sleep_until(r.clock.now() + 0.5)
    r.driver.configure()
    r.run(10)
    assert r.powered == [True] * 3


def test_10_unplugged_cable(rig):
    """Without the cable the watchdogs stop the robot; back again, it must be armed anew."""
    r = rig()
    r.run(20, wave)
    r.port.unplugged = True
    with pytest.raises(SafetyError, match=r"is the cable in\?.*stops after 0.1 s by its watchdog"):
        r.run(5)
    r.world.advance(r.clock.now() + 0.5)
    assert [s.memory["bus_watchdog"] for s in r.world.servos] == [-1] * 3
    r.port.unplugged = False
    r.clock.sleep_until(r.clock.now() + 1)
    r.driver.connect()
    r.driver.configure()
    assert r.powered == [False] * 3
    with pytest.raises(SafetyError, match="not armed"):
        r.guard.command(np.zeros(3))
    r.run(20, wave)
    assert r.powered == [True] * 3


@pytest.mark.parametrize("away", [0.05, 1.0, 3.0])
def test_10_torque_goes_off_when_the_cable_is_back(rig, monkeypatch, away):
    """A cable that is out for a moment and comes back finds torque switched off, and verified."""
    r = rig()
    r.run(20, wave)
    back, sleep = r.clock.now() + away, r.clock.sleep_until

    def plug_in(moment: float) -> None:
        sleep(moment)
        r.port.unplugged = r.clock.now() < back

    monkeypatch.setattr(r.clock, "sleep_until", plug_in)
    r.port.unplugged = True
    with pytest.raises(SafetyError, match=r"is the cable in\?; it came back, and torque is off"):
        r.guard.read()
    assert back <= r.clock.now() < back + 0.3
    assert r.powered == [False] * 3


def test_10_servos_that_are_silent_for_a_moment(rig):
    """A bus that is cut behind the adapter for a second: the stop does not give up before."""
    r = rig(Fault("drop_command", start=START, stop=START + 1.0))
    with pytest.raises(SafetyError, match=r"no new answer 5 times in a row; the robot was stopped"):
        r.run(100, wave)
    assert r.powered == [False] * 3


def test_10_reconnecting_by_itself(rig, monkeypatch):
    """A cable that comes back within the patience is taken up again, torque off; else given up."""
    r = rig(limits=StopLimits(return_time=0.0))
    r.run(20, wave)
    back = r.clock.now() + 1.5
    monkeypatch.setattr(r.port, "unplugged", True)
    with pytest.raises(SafetyError, match="is the cable in"):
        r.run(5)
    with pytest.raises(SerialPortError, match=r"is the cable in\?; given up after 0.5 s"):
        r.driver.reconnect(patience=0.5)
    sleep = r.clock.sleep_until

    def plug_in(moment: float) -> None:
        sleep(moment)
        r.port.unplugged = r.clock.now() < back

    monkeypatch.setattr(r.clock, "sleep_until", plug_in)
    r.driver.reconnect(patience=5.0)
    assert back <= r.clock.now() < back + 1.5
    assert r.powered == [False] * 3
    r.run(10, wave)
    assert r.powered == [True] * 3


def test_11_stuck_servo_and_slipped_horn(rig):
    """A joint that does not follow, or jumps, is named."""
    r = rig(Fault("stuck", start=START, servo=2))
    with pytest.raises(SafetyError, match=r"hinge2 is at .* and should be at .*: it is stuck"):
        r.run(200, lambda k: np.full(3, min(0.02 * k, 1.9)))
    assert r.powered == [False] * 3
    r = rig(Fault("slip", start=START, servo=1, value=0.3))
    r.run(100)
    assert r.readings[-1].position[0] == pytest.approx(0.0, abs=0.1)
    assert r.world.mechanics.angle[0] == pytest.approx(-0.3, abs=0.1)


def test_11_reversed_joint(chain):
    """A joint that counts the other way runs to its mirror image, as a look reveals."""
    real = chain(3)
    believed = chain(3)
    servos = tuple(type(s)(**{**s.__dict__, "sign": -s.sign}) for s in believed.servos)
    believed = type(believed)(**{**believed.__dict__, "servos": servos})
    r = Rig(real, believed=believed)
    r.run(60, 0.4)
    assert r.readings[-1].position[0] == pytest.approx(0.35, abs=0.1)
    assert r.world.mechanics.angle[0] == pytest.approx(-0.35, abs=0.1)


def test_12_wrong_speed(rig):
    """A factory servo at 57600 among others at 1 M is found, and the remedy printed."""
    with pytest.raises(ServoError, match=r"from '3 \(hinge3\)'; found: 3 at 57600 bits/s: set its"):
        rig(registers={"hinge3": {"baud_rate": 1}})


def test_12_missing_and_wrong_servo(rig, chain):
    """A missing servo, and one of another type, are named."""
    with pytest.raises(ServoError, match=r"no answer at any speed from '2 \(hinge2\)'"):
        rig(registers={"hinge2": {"id": 77}})
    robot = chain(3)
    servos = tuple(type(s)(**{**s.__dict__, "model": "xl430-w250"}) for s in robot.servos)
    believed = type(robot)(**{**robot.__dict__, "servos": servos})
    with pytest.raises(ServoError, match=r"is xl330-m288, but the robot's file has xl430"):
        Rig(robot, believed=believed)


def test_13_old_firmware_and_silent_writes(rig):
    """Without fast reads plain ones are used; servos that do not answer writes still obey."""
    r = rig(registers={"hinge2": {"firmware_version": 40}})
    r.world.servos[1].memory["firmware_version"] = 40
    r.driver.connect()
    assert not r.driver.fast
    r.run(30, wave)
    assert r.readings[-1].fresh.all()
    r = rig(registers={f"hinge{i}": {"status_return_level": 1} for i in (1, 2, 3)})
    r.run(30, wave)
    assert r.powered == [True] * 3
    r.guard.stop()
    assert r.powered == [False] * 3


def test_14_watchdog_trip(rig):
    """A host that stalls lets the servos stop, notices, and switches off."""
    r = rig()
    r.run(30, wave)
    r.clock.sleep_until(r.clock.now() + 0.3)
    r.world.advance(r.clock.now())
    assert [s.memory["bus_watchdog"] for s in r.world.servos] == [-1] * 3
    with pytest.raises(SafetyError, match="its bus watchdog tripped"):
        r.run(10, wave)
    assert r.powered == [False] * 3


def test_15_late_host():
    """Steps that take too long lose their deadlines; nothing is made up in a burst."""
    clock = VirtualClock()
    pace = FixedRate(clock, rate=50.0)
    times = []
    for _ in range(10):
        pace.wait()
        times.append(clock.now())
        clock.sleep_until(clock.now() + 0.06)
    assert pace.missed == 18
    np.testing.assert_allclose(np.diff(times), 0.06)
    for _ in range(5):
        pace.wait()
        times.append(clock.now())
    assert np.diff(times[-5:]).min() == pytest.approx(0.02)


def test_16_exceptions_and_kill(rig):
    """An exception switches torque off; a killed host leaves it to the watchdogs to stop."""
    r = rig()
    with pytest.raises(ZeroDivisionError), r.guard:
        r.run(10, wave)
        raise ZeroDivisionError
    assert r.powered == [False] * 3
    r = rig()
    r.run(30, lambda k: np.full(3, 0.1 * k))
    r.world.advance(r.clock.now() + 0.3)
    stopped = r.world.firmware.goal.copy()
    r.world.advance(r.clock.now() + 2.5)
    np.testing.assert_array_equal(r.world.firmware.goal, stopped)
    assert np.abs(r.world.firmware.velocity).max() < 0.3


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_17_commands_that_are_no_numbers(rig, bad):
    """NaN and infinity are refused, and the robot is stopped."""
    r = rig()
    r.run(10)
    with pytest.raises(SafetyError, match="is not 3 finite angles"):
        r.guard.command(np.array([0.0, bad, 0.0]))
    assert r.powered == [False] * 3


def test_17_wild_commands(rig):
    """Commands out of range are clamped, large steps slewed, and both are reported."""
    r = rig()
    r.run(100, 1e9)
    assert r.sent.limited == ("limit",) * 3
    np.testing.assert_allclose(r.sent.angles, 2.0, atol=2e-3)
    r.run(1, -1.0)
    assert r.sent.limited == ("step",) * 3
    np.testing.assert_allclose(r.sent.angles, 2.0 - 0.16, atol=4e-3)
    goals = np.array([s.memory["goal_position"] for s in r.world.servos])
    np.testing.assert_array_equal(goals, r.driver.counts(r.sent.angles))


def test_18_the_seam(chain):
    """A joint that swings across the encoder's seam reads and commands without a jump."""
    robot = chain(3, registers={"operating_mode": 4, "position_p_gain": 800, "pwm_slope": 255})
    servos = tuple(type(s)(**{**s.__dict__, "zero": 4090}) for s in robot.servos)
    robot = type(robot)(**{**robot.__dict__, "servos": servos})
    r = Rig(robot)
    r.run(150, lambda k: np.full(3, 0.6 * np.sin(k / 12)))
    track = np.array([x.position[0] for x in r.readings])
    counts = np.array([x.count[0] for x in r.readings])
    assert counts.min() < 4096 < counts.max()
    assert np.abs(np.diff(track)).max() < 0.15
    assert np.ptp(track) > 0.8


def test_19_goals_that_are_not_taken(rig):
    """A goal that a servo silently refuses is found by reading it back."""
    r = rig(registers={"hinge2": {"max_position_limit": 2200}})
    with pytest.raises(SafetyError, match=r"hinge2 does not take its goals"):
        r.run(200, 0.8)
    assert r.powered == [False] * 3


@pytest.mark.parametrize(
    ("register", "value", "message"),
    [
        ("drive_mode", 8, r"servo 2 \(hinge2\): drive mode 8: a goal would switch its torque on"),
        ("drive_mode", 1, r"drive mode 1 reverses it or times its profile"),
        ("homing_offset", 100, r"its own homing offset is 100.*write homing_offset = 0"),
        ("return_delay_time", 250, r"answers after 500 us.*write return_delay_time"),
    ],
)
def test_20_21_settings_of_a_servo(rig, register, value, message):
    """Settings that would surprise are refused before torque, with the remedy."""
    with pytest.raises(ServoError, match=message):
        rig(registers={"hinge2": {register: value}})


def test_21_latency_timer(rig, tmp_path, monkeypatch):
    """An adapter that holds bytes for 16 ms is refused with the command that changes it."""
    r = rig()
    timer = tmp_path / "loopback:chain3" / "latency_timer"
    timer.parent.mkdir()
    timer.write_text("16\n")
    monkeypatch.setattr(serial_ports, "ADAPTERS", tmp_path)
    with pytest.raises(ServoError, match=r"latency timer is 16 ms.*has 1; run: setserial"):
        r.driver.connect()
    link = tmp_path / "usb-FTDI_USB__-__Serial_Converter-if00-port0"
    link.symlink_to(r.port.port_name)
    monkeypatch.setattr(r.port, "port_name", str(link))
    with pytest.raises(ServoError, match=r"^loopback:chain3: its latency timer is 16 ms"):
        r.driver.connect()
    timer.write_text("1\n")
    r.driver.connect()


def test_21_a_rate_that_the_bus_cannot_reach(chain):
    """A rate beyond the bus is refused with the largest possible one."""
    bus = {"baud": 57600, "return_delay": 0.0005, "latency": 0.016}
    with pytest.raises(ServoError, match=r"at most \d+ steps per second, not 50"):
        Rig(chain(3, bus=bus))


def test_lost_port_in_connect(chain):
    """A cable that is out is one sentence before anything else."""
    world, clock = EmulatedRobot(chain(3)), VirtualClock()
    port = LoopbackPort(world, clock)
    port.unplugged = True
    with pytest.raises(SerialPortError, match="is the cable in"):
        Driver(world.robot, port, clock).connect()


@pytest.mark.slow
@pytest.mark.timeout(7200)  # 4 minutes of processor time; the machine may be shared
def test_22_an_hour_of_twelve_servos(chain):
    """An hour at 50 Hz with 12 servos: nothing grows, none missed. `benchmarks.bus` times it."""
    import resource
    import time

    r = Rig(chain(12))
    before = r.count("asked")
    r.guard.arm()
    pace = FixedRate(r.clock, 50.0)
    began, work, base = time.perf_counter(), time.process_time(), 0
    for k in range(180_000):
        pace.wait()
        assert r.guard.read().fresh.all()
        r.guard.command(np.full(12, 0.3 * np.sin(k / 20)))
        pace.jitter.clear()
        if k == 9_000:
            base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, busy = time.perf_counter() - began, time.process_time() - work
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - base
    speeds = f"{3600 / wall:.1f} x real time, {3600 / busy:.1f} x in processor time"
    sys.stdout.write(f"\n{speeds}; memory grew by {grown} kB, missed {pace.missed}\n")
    assert pace.missed == 0
    assert grown < 5_000
    assert r.counted() == ({},) * 12
    arming = 1 + 1 + 2 + 8  # a reading, a health, 2 limits, 4 writes, each read back
    expected = arming + 180_000 + 180_000 // 12  # readings, and healths in turn
    assert (np.array(r.count("asked")) - before).tolist() == [expected] * 12
    assert r.world.firmware.errors.tolist() == [0] * 12


def test_a_hundred_steps_a_second_with_twelve_servos(chain):
    """Twelve servos at 1 Mbit/s are read, commanded and watched 100 times a second, none missed."""
    r = Rig(chain(12, rate=100.0))
    r.guard.arm()
    pace = FixedRate(r.clock, 100.0)
    for k in range(100):
        pace.wait()
        assert r.guard.read().fresh.all()
        r.guard.command(np.full(12, 0.2 * np.sin(k / 20)))
    assert pace.missed == 0
    assert max(pace.jitter) < 1e-6
    assert r.driver.cycle_time() < 0.005
