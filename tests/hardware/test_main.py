"""The command line finds, watches, calibrates and emulates servos."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

from hardware import commands as command
from hardware.calibrate import calibrate
from hardware.clock import RealClock, VirtualClock
from hardware.config import load_robot
from hardware.connect import make_driver
from hardware.driver import Driver
from hardware.emulator.faults import Fault
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from hardware.port_lock import PortLock
from hardware.safety import Guard, StopLimits
from tests.hardware.person import Person, places_of
from tests.hardware.rig import in_real_time

BUSY = StopLimits(misses=50, patience=5.0, lost=1.0, stale=1.0)  # for a busy machine
SO101 = str(Path(__file__).with_name("so101.xml"))


@contextlib.contextmanager
def emulated(
    *words: str, end: signal.Signals = signal.SIGINT
) -> Iterator[tuple[str, subprocess.Popen]]:
    """Run `python -m hardware emulate`, deaf to SIGINT at first, and yield its device."""
    run = [sys.executable, "-m", "hardware", "emulate", *words]
    deaf = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *run]  # as a shell's `&` does
    process = subprocess.Popen(deaf, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split(" at ")[1].split(",")[0], process
        process.send_signal(end)
        assert process.wait(30) == 0
    finally:
        process.kill()
        process.wait()


def patiently(action: Callable[..., tuple], port: Any, *arguments: object) -> tuple:
    """Repeat what an SDK does until it is answered: a busy machine misses its 34 ms.

    An answer that comes late raises IndexError in the makers' SDKs, or is taken for the next one's:
    it is waited for, and thrown away.
    """
    for _ in range(20):
        with contextlib.suppress(IndexError):
            answer = action(port, *arguments)
            if answer[-2] == COMM_SUCCESS:
                return answer
        time.sleep(0.2)
        port.clearPort()
    raise AssertionError("nobody answers the maker's SDK")


def test_scan_and_monitor(capsys):
    """A scan lists the emulated servo and its rate; the monitor prints its state."""
    assert command.main(["scan", "robot=bench1"]) == 0
    out = capsys.readouterr().out
    assert " 1000000 bits/s  ID   1  xl330-m288  firmware 52" in out
    assert "all 1 servos match its file; fast reads" in out
    assert command.main(["monitor", "seconds=2"]) == 0
    out = capsys.readouterr().out
    assert out.count("hinge   0.0000 rad") == 2
    assert "5.0 V  25 °C torque off, no errors; of 102 answers 0 lost" in out


def test_the_monitor_waits_for_slow_answers(monkeypatch, capsys):
    """Answers that come later than a control step could wait are shown all the same."""
    slow, original = [Fault("late", value=0.015)], command.make_driver

    def driver(robot):
        return original(robot, EmulatedRobot(robot, faults=slow))

    monkeypatch.setattr(command, "make_driver", driver)
    assert command.main(["monitor", "seconds=3"]) == 0
    out = capsys.readouterr().out
    assert out.count("torque off, no errors; of") == 3 and "no answer" not in out


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["scann"], 2, "unknown command 'scann' (did you mean 'scan'?)"),
        (["scan", "prt=1"], 2, "scan does not accept 'prt=1' (did you mean 'port'?)"),
        (["scan", "robot=bench"], 2, "unknown robot 'bench' (did you mean 'bench1'?)"),
        (["scan", "port=/dev/no-such"], 1, "/dev/no-such: no such port"),
        (["monitor", "seconds=x"], 2, "seconds=x is not a number"),
        (["monitor", "seconds=nan"], 2, "seconds=nan is not a finite number"),
        (["write", "servo=1", "register=led", "value=inf"], 2, "value=inf is not a finite number"),
        (["calibrate", f"file={__file__}"], 2, "test_main.py exists; choose another name"),
        (["calibrate", f"file={__file__}/a.json"], 2, "a.json: no file can be made there"),
        (["nominal", "file=/dev/null/a.xml"], 1, "nominal: [Errno 17] File exists"),
        (["emulate", "hidden=/no/file.yaml"], 2, "/no/file.yaml: the effects cannot be read"),
        (["emulate", "link=/no/where/robot"], 2, "link=/no/where/robot: no folder /no/w"),
        (["emulate", f"link={__file__}"], 2, "test_main.py: this exists and is not a link"),
        (["setup"], 2, "port= is missing: setup takes robot=NAME, or port=, model= and file="),
        (["setup", "robot=bench1", "file=a.yaml"], 2, "setup writes file= only without robot="),
        (["write", "servo=hinge"], 2, "register= is missing"),
        (["torque", "on=true", "robot=bench1", "port=/dev/x"], 2, "then add arm=true"),
        (["torque", "on=true"], 2, "on=true needs robot=NAME"),
        (["scan", "robot=no/such.yaml"], 2, "unknown robot 'no/such.yaml'"),
        (["emulate", "held=maybe"], 2, "held=maybe: expected true or false"),
    ],
)
def test_refusals(capsys, words, status, message):
    """What cannot be done is one sentence and an exit status."""
    assert command.main(words) == status
    assert message in capsys.readouterr().err


def test_help(capsys):
    """Help names all verbs and keys."""
    assert command.main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(word in out for word in (*command.KEYS, "robot=", "port=", "hidden=", "link="))


def test_calibrate(tmp_path, monkeypatch, capsys):
    """Moving the joint by hand, its zero elsewhere and turned round, gives that calibration."""
    robot = load_robot("bench1")
    worlds = []

    def driver(robot):
        worlds.append(EmulatedRobot(robot))
        return original(robot, worlds[0])

    original = command.make_driver
    monkeypatch.setattr(command, "make_driver", driver)
    places = iter([-1.0, 1.2, 0.2, 0.1])

    def ask(prompt: str, meanwhile: object = None) -> str:
        assert prompt.startswith("move hinge")
        mechanics = worlds[0].mechanics
        mechanics.data.qpos[:], mechanics.data.qvel[:] = next(places), 0.0
        mechanics.lock(0, True)
        return ""

    path = tmp_path / "bench1.json"
    assert command.main(["calibrate", f"file={path}"], ask) == 0
    joint = json.loads(path.read_text())["joints"]["hinge"]
    step = 2 * np.pi / 4096
    assert joint["sign"] == -1
    assert (joint["drive_mode"], joint["homing_offset"]) == (0, 0)  # of the servo itself
    assert joint["zero"] == pytest.approx(2048 + 0.2 / step, abs=2)
    assert joint["range_min"] == pytest.approx(2048 - 1.0 / step, abs=2)
    assert joint["range_max"] == pytest.approx(2048 + 1.2 / step, abs=2)
    assert robot.name in path.read_text()


def test_calibrate_follows_more_than_half_a_turn(tmp_path, monkeypatch):
    """A range of 5 rad, over the encoder's seam, is followed while the hand moves."""
    robot = replace(load_robot("bench1"), name="wide")
    wide = replace(robot, servos=(replace(robot.servos[0], position=(-3.0, 3.0)),))
    world, clock = EmulatedRobot(wide), VirtualClock()
    person = Person(world, LoopbackPort(world, clock), {"hinge": places_of(-2.2, 2.8, 0.5)})
    path = tmp_path / "wide.json"
    calibrate(make_driver(wide, world, clock), path, person, lambda line: None)
    joint = json.loads(path.read_text())["joints"]["hinge"]
    step = 2 * np.pi / 4096
    assert joint["range_min"] == pytest.approx(2048 - 2.2 / step, abs=2)
    assert joint["range_max"] == pytest.approx(2048 + 2.8 / step, abs=2)
    assert joint["zero"] == pytest.approx(2048 + 0.5 / step, abs=2)


@pytest.mark.parametrize(("ends", "questions"), [((-1.0, 1.5), 2), ((-1.0, 0.5), 4)])
def test_calibrate_refuses_a_travel_over_the_seam(tmp_path, ends, questions):
    """The horn is such that the encoder jumps at 0.9 rad: said after the ends, nothing written."""
    robot = load_robot("bench1")
    mounted = replace(robot.servos[0], zero=3500, position=(-1.2, 0.3))
    world, clock = EmulatedRobot(replace(robot, servos=(mounted,))), VirtualClock()
    wide = replace(robot, servos=(replace(robot.servos[0], position=(-3.1, 3.1)),))
    person = Person(world, LoopbackPort(world, clock), {"hinge": places_of(*ends)})
    path = tmp_path / "bench1.json"
    refused = pytest.raises(RobotError, match=r"hinge: .*the encoder's seam lies inside the travel")
    with refused if questions == 2 else contextlib.nullcontext():
        calibrate(make_driver(wide, world, clock), path, person, lambda line: None)
    assert len(person.asked) == questions
    assert path.exists() == (questions == 4)


def test_calibrate_needs_somebody(tmp_path, capsys):
    """Without a terminal it says so, and writes nothing."""

    def nobody(prompt: str, meanwhile: object = None) -> str:
        raise EOFError

    file = tmp_path / "arm.json"
    assert command.main(["calibrate", f"file={file}"], nobody) == 2
    assert "there is none" in capsys.readouterr().err
    assert not file.exists()


def test_device_file_with_the_bare_sdk(tmp_path):
    """The SDK's own port drives the device file; a client that dies leaves the robot for others."""
    link = tmp_path / "robot"
    with emulated("robot=bench1", f"link={link}") as (device, process):
        assert os.path.realpath(link) == device
        handler = PacketHandler(2.0)
        for _ in range(2):
            port = PortHandler(device)
            assert port.setBaudRate(1_000_000)
            assert patiently(handler.ping, port, 1) == (1200, COMM_SUCCESS, 0)
            assert patiently(handler.write2ByteTxRx, port, 1, 84, 321)[-1] == 0
            assert patiently(handler.read2ByteTxRx, port, 1, 84)[0] == 321
            port.closePort()
        port = PortHandler(device)
        assert port.setBaudRate(57600)
        assert handler.ping(port, 1)[1] != COMM_SUCCESS
        port.closePort()
        assert process.poll() is None
    assert not link.exists()


def test_a_port_in_use_is_refused(capsys):
    """A monitor beside another program is refused with one sentence; nothing is sent."""
    with emulated("robot=bench1") as (device, _):
        lock = PortLock(device)
        lock.take()
        try:
            assert command.main(["monitor", "robot=bench1", f"port={device}"]) == 1
        finally:
            lock.release()
        assert f"{device} is held by" in capsys.readouterr().err
        assert command.main(["scan", "robot=bench1", f"port={device}"]) == 0


@pytest.mark.slow
def test_a_feetech_arm_behind_a_device_file(capsys):
    """The maker's SDK reads the arm before and after our driver moved it; then it is watched."""
    sdk = pytest.importorskip("scservo_sdk")
    handler = sdk.PacketHandler(0)

    def position(device: str) -> int:
        port = sdk.PortHandler(device)
        assert port.setBaudRate(1_000_000)
        assert patiently(handler.ping, port, 3)[0] == 777
        value = patiently(handler.read2ByteTxRx, port, 3, 56)[0]
        port.closePort()
        return value

    with emulated("robot=so101", f"model={SO101}") as (device, _):
        assert abs(position(device) - 2048) < 5
        robot = replace(load_robot("so101", SO101), port=device)

        def drive() -> None:
            driver = make_driver(robot)
            try:
                driver.connect()
                driver.configure()
                with Guard(driver, BUSY) as guard:
                    guard.arm()
                    guard.move_to(np.array([0, 0, 0.3, 0, 0, 0]), speed=2.0)
                    time.sleep(0.3)
                    assert guard.read().position[2] == pytest.approx(0.3, abs=0.1)
                assert not driver.health(2).torque
            finally:
                driver.close()

        in_real_time(drive)
        assert abs(position(device) - 2048) < 250
        capsys.readouterr()
        assert command.main(["monitor", "robot=so101", f"port={device}", "seconds=0.1"]) == 0
        assert "gripper" in capsys.readouterr().out


def test_the_emulator_ends_when_it_is_told(tmp_path):
    """SIGTERM ends it as Ctrl-C does: its link is gone, and it says that all was well."""
    link = tmp_path / "robot"
    with emulated("robot=bench1", f"link={link}", end=signal.SIGTERM):
        assert link.exists()
    assert not link.is_symlink()


def test_an_emulated_robot_is_held_until_it_is_armed():
    """quad8 waits in its pose; without torque it falls, and SIGUSR1 puts it back and holds it."""
    robot = load_robot("quad8")
    home, handler = robot.servos[1].count(-1.2), PacketHandler(2.0)
    with emulated("robot=quad8") as (device, process):
        port = PortHandler(device)
        assert port.setBaudRate(robot.bus.baud)

        def knee() -> int:
            return patiently(handler.read4ByteTxRx, port, robot.servos[1].id, 132)[0]

        time.sleep(0.5)
        assert knee() == home
        for torque in (1, 0):
            for servo in robot.servos:
                assert patiently(handler.write1ByteTxRx, port, servo.id, 64, torque)[-1] == 0
        deadline = time.perf_counter() + 20
        while abs(knee() - home) < 20 and time.perf_counter() < deadline:
            time.sleep(0.05)
        assert abs(knee() - home) >= 20
        process.send_signal(signal.SIGUSR1)
        time.sleep(0.5)
        assert knee() == home
        port.closePort()


def test_device_file_with_our_driver():
    """Our driver and guard move the robot behind a device file, in real time."""
    with emulated("robot=bench1") as (device, _):
        robot = replace(load_robot("bench1"), watchdog=2.54)

        def drive() -> None:
            driver = Driver(robot, PortHandler(device), RealClock())
            try:
                driver.connect()
                driver.configure()
                with Guard(driver, BUSY) as guard:
                    guard.arm()
                    guard.move_to(np.array([0.3]), speed=2.0)
                    time.sleep(0.03)
                    reading = guard.read()
                assert reading.position[0] == pytest.approx(0.25, abs=0.12)
                health = driver.health(0)
                assert health is None or not health.torque
            finally:
                driver.close()

        in_real_time(drive)
