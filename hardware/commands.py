"""The command line for servos: python -m hardware VERB key=value ...

    scan       find servos at every speed; with robot= compare them with its file
    setup      give a robot's servos their IDs, speed and settings, after showing and asking
    calibrate  torque off; move every joint through its range and to its zero; writes a JSON file
    monitor    torque off; print what the servos measure and how the link does, once a second
    emulate    an emulated robot behind a device file, for any client, until Ctrl-C

Keys:
    robot=NAME       a robot of conf/robot, or a path (default: bench1; scan with port=: none)
    model=PATH       the robot's MJCF, where its file leaves it open and it is emulated
    port=DEVICE      the serial port, such as /dev/ttyUSB0; without it an emulated robot; of several
                     buses a port each, in their order, with commas between
    file=PATH        calibrate: where to write (default: NAME.json); monitor: a calibration to apply
    seconds=NUMBER   monitor, emulate: how long (default: until Ctrl-C)
    hidden=PATH      emulate: a file of effects that the robot hides
    link=PATH        emulate: a symbolic link to make to the device; of several PATH-NAME to each
    held=BOOL        emulate: hold the robot in its pose `home` until its servos have torque
                     (default: true); the signal SIGUSR1 puts it back there and holds it again
    seed=NUMBER      emulate: of its randomness (default: 0)
"""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from hardware.bus_client import BusClient
from hardware.calibration import (
    Calibration,
    Joint,
    apply_calibration,
    read_calibration,
    write_calibration,
)
from hardware.config import Robot, load_robot
from hardware.connect import DRIVERS, make_driver
from hardware.driver import Driver
from hardware.emulator.pty import check_link, serve
from hardware.emulator.world import EmulatedRobot
from hardware.errors import HardwareError, SerialPortError, did_you_mean, format_names
from hardware.imu.rvc import BAUD
from hardware.monitor import monitor as show
from hardware.scan import scan as find
from hardware.setup import set_up

KEYS = {
    "scan": ("robot", "model", "port"),
    "setup": ("robot", "model", "port"),
    "calibrate": ("robot", "model", "port", "file"),
    "monitor": ("robot", "model", "port", "file", "seconds"),
    "emulate": ("robot", "model", "hidden", "link", "held", "seconds", "seed"),
}
Keys = dict[str, str]
Ask = Callable[[str], str]


def main(arguments: list[str], ask: Ask = input) -> int:
    """Run one verb and return the exit status: 0, 1 for a refusal, 2 for a wrong command line."""
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(__doc__)
        return 0 if arguments else 2
    verb = arguments[0]
    try:
        keys = _parse(verb, arguments[1:])
    except HardwareError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        open_model = "port" in keys  # only an emulated robot needs it
        robot = load_robot(keys.get("robot", "bench1"), keys.get("model"), not open_model)
        port = keys.get("port")
        robot = robot.at(port.split(",") if port is not None and robot.buses else port)
        _VERBS[verb](robot, keys, ask)
    except HardwareError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print()
    return 0


def _parse(verb: str, words: list[str]) -> Keys:
    if verb not in KEYS:
        hint = did_you_mean(verb, KEYS)
        raise HardwareError(f"unknown command {verb!r}{hint}; there are {format_names(KEYS)}")
    keys = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key not in KEYS[verb]:
            hint = did_you_mean(key, KEYS[verb])
            raise HardwareError(
                f"{verb} takes no {word!r}{hint}; it takes {format_names(KEYS[verb])}"
            )
        keys[key] = value
    return keys


def _number(keys: Keys, key: str, default: float) -> float:
    try:
        return float(keys.get(key, default))
    except ValueError:
        raise HardwareError(f"{key}={keys[key]} is not a number") from None


def _yes_or_no(keys: Keys, key: str, default: bool) -> bool:
    answers = {"true": True, "false": False}
    word = keys.get(key, str(default).lower())
    if word not in answers:
        raise HardwareError(f"{key}={word}: it can be true or false")
    return answers[word]


def scan(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Print every servo found at every speed, and what differs from the robot's file."""
    alone = "port" in keys and "robot" not in keys
    driver = make_driver(robot)
    try:
        found = 0
        for part in driver.parts:
            if len(driver.parts) > 1:
                print(f"{part.robot.name} at {part.bus_client.port.port_name}:")
            for client, maker in _clients(part, alone):
                for servo in find(client, maker):
                    print(servo)
                    found += 1
                if alone:
                    client.close()
        if not found:
            print("no servo answers at any speed: check supply, cable and adapter")
        if alone:
            return
        driver.connect()
        ways = "fast reads" if driver.fast else "plain reads only"
        rate = 1 / driver.cycle_time()
        print(f"{robot.name}: all {len(driver)} servos are as its file says; {ways};")
        print(f"the bus allows {rate:.0f} steps a second, {robot.rate:g} are asked for")
    finally:
        driver.close()


def _clients(driver: Driver, alone: bool) -> Iterator[tuple[BusClient, str]]:
    """Yield the client of the robot's maker; without a robot one for each maker."""
    if not alone:
        yield driver.bus_client, driver.robot.servos[0].type.maker
        return
    for maker, kind in DRIVERS.items():
        client = driver.bus_client
        yield kind.client_type(client.port, client.clock, client.latency), maker


def setup(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Write into the servos what the robot's file wants, after showing it and asking."""
    if "robot" not in keys:
        raise HardwareError("setup needs robot=NAME: its file says what is written")
    driver = make_driver(robot)
    try:
        for part in driver.parts:
            set_up(part.robot, part.bus_client, ask, print)
        driver.connect()
        print(f"{robot.name}: all {len(driver)} servos are as its file says")
    finally:
        driver.close()


def monitor(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Print what the servos measure and how the link does, once a second; torque off."""
    seconds = _number(keys, "seconds", math.inf)
    if "file" in keys:
        robot = apply_calibration(robot, read_calibration(keys["file"]))
    show(robot, seconds)


def calibrate(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Switch torque off, take every joint's range and zero by hand, and write the file."""
    path = Path(keys.get("file", f"{robot.name}.json"))
    driver = make_driver(robot)
    try:
        driver.connect()
        driver.torque_off()
        joints = {}
        for i, servo in enumerate(robot.servos):
            low = _count(driver, i, ask, "one end of its range")
            high = _count(driver, i, ask, "the other end")
            zero = _count(driver, i, ask, "its zero")
            up = _count(driver, i, ask, "a little to where its angle grows")
            joints[servo.name] = Joint(
                id=servo.id,
                drive_mode=0,
                homing_offset=0,
                range_min=min(low, high),
                range_max=max(low, high),
                model=servo.model,
                zero=zero,
                sign=-1 if up < zero else 1,
            )
        calibration = Calibration(joints, robot.name)
        apply_calibration(robot, calibration)
        write_calibration(path, calibration)
        print(f"wrote {path}")
    finally:
        driver.close()


def _count(driver: Driver, i: int, ask: Ask, where: str) -> int:
    """Ask for a joint to be moved somewhere, and return its count there, whole turns included."""
    try:
        ask(f"move {driver.robot.names[i]} to {where}, then press Enter ")
    except EOFError:
        raise HardwareError(
            "calibrate needs a person at a terminal, and there is none; "
            "nothing was written: run it in a terminal"
        ) from None
    driver.clock.sleep_until(driver.clock.now() + 0.05)
    reading = driver.read()
    if not reading.fresh[i]:
        raise SerialPortError(f"{driver.robot.names[i]} did not answer; begin again")
    return driver.robot.servos[i].count(float(reading.position[i]))


def emulate(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Serve an emulated robot at a device file until it is stopped, also in the background."""
    link = Path(keys["link"]) if "link" in keys else None
    held = _yes_or_no(keys, "held", True)
    hidden = Path(keys["hidden"]) if "hidden" in keys else robot.hidden
    if link is not None:
        check_link(link)
    world = EmulatedRobot(replace(robot, hidden=hidden), seed=int(_number(keys, "seed", 0)))
    end = time.perf_counter() + _number(keys, "seconds", math.inf)
    told, back = threading.Event(), threading.Event()

    def ready(devices: dict[str, str]) -> None:
        bauds = {bus.name: bus.baud for bus in robot.buses} or {"": robot.bus.baud}
        for number, (name, device) in enumerate(devices.items(), 1):
            words = f"{robot.name} {name}".rstrip()
            end = "; Ctrl-C ends it" if number == len(devices) else ""
            print(f"{words} at {device}, {bauds.get(name, BAUD)} bits/s{end}", flush=True)

    def stopped() -> bool:
        if back.is_set():
            back.clear()
            world.hold()
        return told.is_set() or time.perf_counter() > end

    if held:
        world.hold()
    events = {signal.SIGUSR1: back, signal.SIGTERM: told}
    events[signal.SIGINT] = told  # a shell's background jobs begin deaf to it
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # unless it runs under nohup
        events[signal.SIGHUP] = told
    before = {
        number: signal.signal(number, lambda n, _: events[signal.Signals(n)].set())
        for number in events
    }
    try:
        serve(world, ready, stopped, link)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


_VERBS: dict[str, Callable[[Robot, Keys, Ask], None]] = {
    "scan": scan,
    "setup": setup,
    "calibrate": calibrate,
    "monitor": monitor,
    "emulate": emulate,
}
