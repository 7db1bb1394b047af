"""The command line for servos: python -m hardware VERB key=value ...

    find-port  list the serial ports, what hinders each, and which one the robot is at
    scan       find servos at every speed; with robot= compare them with its file
    setup      with robot= give its servos their IDs, speed and settings; without one make a file
               of the robot from its servos and its model: IDs, then each joint moved by hand
    calibrate  torque off; move every joint through its range and to its zero; writes a JSON file
    monitor    torque off; print what the servos measure and how the link does, once a second
    read       print a register, or all
    write      write a register of one servo and read it back
    reboot     reboot a servo, or all: their torque goes off
    torque     switch torque off and verify it; with on=true arm=true hold the robot until Enter
    nominal    write the robot's MJCF with its servos as actuators, as a diagnosis needs it
    pack       one ZIP file of a folder of runs to send to others, with nothing personal in it
    emulate    an emulated robot behind a device file, for any client, until Ctrl-C; it obeys what a
               person would do: `connect JOINT`, `unplug JOINT`, `move JOINT ANGLE`

Keys:
    robot=NAME       a robot of conf/robot, or a path that ends in .yaml (default: bench1; with
                     port= scan, read, write, reboot and torque take the servos that answer)
    model=PATH       the robot's MJCF, where its file leaves it open and it is emulated; setup: of
                     the robot whose file is made
    port=DEVICE      the serial port, such as /dev/ttyUSB0; without it an emulated robot; of several
                     buses a port each, in their order, with commas between
    file=PATH        calibrate: where to write (default: NAME.json); monitor: a calibration to
                     apply; setup: the robot's file to make, .yaml; nominal: the MJCF to write
    folder=PATH      pack: what runs wrote; pack writes file=PATH
    servo=NAME       read, write, reboot: a servo by its name or ID
    register=NAME    read, write: as in the servo's manual, such as position_p_gain
    value=NUMBER     write: the raw value
    on=BOOL          torque: hold the robot where it is (default: false)
    arm=BOOL         torque, write: whether a real servo may move (default: false)
    seconds=NUMBER   monitor, emulate: how long (default: until Ctrl-C)
    hidden=PATH      emulate: a file of effects that the robot hides
    link=PATH        emulate: a symbolic link to make to the device; of several PATH-NAME to each
    held=BOOL        emulate: hold the robot in its pose `home` until its servos have torque
                     (default: true); the signal SIGUSR1 puts it back there and holds it again
    factory=BOOL     emulate: servos as from the factory, all with ID 1, none connected yet
                     (default: false)
    seed=NUMBER      emulate: of its randomness (default: 0)

The exit status is 0, 1 if the servos or the port refuse or a servo may still have torque, 2 for a
wrong command line or file, 130 after Ctrl-C (0 if it is the usual end: emulate, monitor).
"""

import math
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from hardware import emulate as emulation
from hardware import single_servo
from hardware.calibrate import calibrate as calibrate_by_hand
from hardware.calibration import apply_calibration, read_calibration
from hardware.command_line import Keys, UsageError, number, parse_keys, required, yes_or_no
from hardware.config import Robot, load_robot
from hardware.connect import make_driver
from hardware.detected import detect, scan_port
from hardware.driver import Driver
from hardware.errors import HardwareError, RobotError
from hardware.find_port import find_port
from hardware.monitor import monitor as show
from hardware.nominal import write_nominal_model
from hardware.pack import pack as pack_folder
from hardware.scan import DetectedServo
from hardware.scan import scan as find_servos
from hardware.setup import set_up
from hardware.switch_off import switch_off, switch_off_at
from hardware.terminal import Ask, ask_terminal
from hardware.wizard import make_robot_file

AT = ("robot", "model", "port")
KEYS = {
    "find-port": (),
    "scan": AT,
    "setup": (*AT, "file"),
    "calibrate": (*AT, "file"),
    "monitor": (*AT, "file", "seconds"),
    "read": (*AT, "servo", "register"),
    "write": (*AT, "servo", "register", "value", "arm"),
    "reboot": (*AT, "servo"),
    "torque": (*AT, "on", "arm"),
    "nominal": ("robot", "model", "file"),
    "pack": ("folder", "file"),
    "emulate": ("robot", "model", "hidden", "link", "held", "factory", "seconds", "seed"),
}
BY_SCAN = ("read", "write", "reboot")  # verbs that need no robot's file
ENDLESS = ("emulate", "monitor")  # verbs that Ctrl-C ends
INTERRUPTED = 130  # exit status, 128 + SIGINT
tell = partial(print, flush=True)


def main(arguments: list[str], ask: Ask = ask_terminal) -> int:
    """Run one verb and return the exit status; see the module."""
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(__doc__)
        return 0 if arguments else 2
    verb = arguments[0]
    try:
        keys = parse_keys(verb, arguments[1:], KEYS)
        _VERBS[verb](_robot(verb, keys), keys, ask)
    except HardwareError as error:
        print(error, file=sys.stderr)
        return 2 if isinstance(error, UsageError | RobotError) else 1
    except EOFError:
        print(f"{verb} needs a person at a terminal, and there is none", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{verb}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print()
        return 0 if verb in ENDLESS else INTERRUPTED
    return 0


def _robot(verb: str, keys: Keys) -> Robot:
    """Return the robot that a command line means."""
    port = keys.get("port")
    if verb in BY_SCAN and port is not None and "robot" not in keys:
        return detect(port)
    robot = load_robot(keys.get("robot", "bench1"), keys.get("model"), port is None)
    return robot.at(port.split(",") if port is not None and robot.buses else port)


def find(robot: Robot, keys: Keys, ask: Ask) -> None:
    """List the serial ports, and find the robot's."""
    find_port(ask, tell)


def scan(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Print every servo found at every speed, and what differs from the robot's file."""
    if "port" in keys and "robot" not in keys:
        return _list(scan_port(keys["port"]))
    driver = make_driver(robot)
    try:
        for part in driver.parts:
            if len(driver.parts) > 1:
                tell(f"{part.robot.name} at {part.bus_client.port.port_name}:")
            _list(find_servos(part.bus_client, part.robot.maker))
        driver.connect()
        ways = "fast reads" if driver.fast else "plain reads only"
        rate = 1 / driver.cycle_time()
        tell(f"{robot.name}: all {len(driver)} servos match its file; {ways};")
        tell(f"the bus allows {rate:.0f} steps per second; {robot.rate:g} are requested")
    finally:
        driver.close()


def _list(found: Iterable[DetectedServo]) -> None:
    """Print servos as they are found."""
    nobody = True
    for servo in found:
        tell(servo)
        nobody = False
    if nobody:
        tell("no servo answers at any speed: check supply, cable and adapter")


def setup(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Write into the servos what the robot's file wants, or make a file of the servos."""
    if "robot" not in keys:
        why = "setup takes robot=NAME, or port=, model= and file= of a robot that has no file yet"
        port, model, file = (required(keys, key, why) for key in ("port", "model", "file"))
        return make_robot_file(port, Path(model), Path(file), ask, tell)
    if "file" in keys:
        raise UsageError("setup writes file= only without robot=")
    driver = make_driver(robot)
    try:
        for part in driver.parts:
            set_up(part.robot, part.bus_client, ask, tell)
        driver.connect()
        tell(f"{robot.name}: all {len(driver)} servos match its file")
    finally:
        driver.close()


def calibrate(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Take every joint's range and zero by hand."""
    path = Path(keys.get("file", f"{robot.name}.json"))
    _with(robot, lambda driver: calibrate_by_hand(driver, path, ask, tell))


def read(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Print registers."""
    servo, register = keys.get("servo"), keys.get("register")
    _with(robot, lambda driver: single_servo.read(driver, servo, register, tell))


def write(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Write one register of one servo."""
    why = "write takes servo=NAME register=NAME value=NUMBER"
    servo, register, text = (required(keys, key, why) for key in ("servo", "register", "value"))
    value, arm = number(keys, "value", 0), yes_or_no(keys, "arm", False)
    if value != int(value):
        raise UsageError(f"value={text}: registers hold whole numbers")
    _with(robot, lambda d: single_servo.write(d, servo, register, int(value), arm, tell))


def reboot(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Reboot a servo, or all."""
    _with(robot, lambda driver: single_servo.reboot(driver, keys.get("servo"), tell))


def torque(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Switch torque off, or hold the robot."""
    if not yes_or_no(keys, "on", False):
        if "port" in keys and "robot" not in keys:
            return switch_off_at(keys["port"].split(","), tell)
        return _with(robot, lambda driver: switch_off(driver, tell))
    if "robot" not in keys:
        raise UsageError("on=true needs robot=NAME: its file has the limits")
    if robot.port is not None and not yes_or_no(keys, "arm", False):
        raise UsageError(
            f"{robot.name} at {robot.port} would have torque; clear the space around it, then add "
            "arm=true"
        )
    _with(robot, lambda driver: single_servo.hold(driver, ask, tell))


def _with(robot: Robot, action: Callable[[Driver], None]) -> None:
    """Do something with a robot's driver, and close its ports."""
    driver = make_driver(robot)
    try:
        action(driver)
    finally:
        driver.close()


def monitor(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Print what the servos measure and how the link does, once a second; torque off."""
    seconds = number(keys, "seconds", math.inf)
    if "file" in keys:
        robot = apply_calibration(robot, read_calibration(keys["file"]))
    show(robot, seconds)


def nominal(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Write the robot's MJCF with its servos as actuators."""
    path = Path(required(keys, "file", "nominal takes robot=NAME file=PATH.xml"))
    write_nominal_model(robot, path)
    tell(f"wrote {path}: {robot.name} with its {len(robot.servos)} servos")


def pack(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Write a ZIP file of a folder of runs."""
    why = "pack takes folder=PATH file=PATH.zip"
    folder, file = (Path(required(keys, key, why)) for key in ("folder", "file"))
    pack_folder(folder, file, tell)


def emulate(robot: Robot, keys: Keys, ask: Ask) -> None:
    """Serve an emulated robot at a device file."""
    emulation.emulate(robot, keys, tell)


_VERBS: dict[str, Callable[[Robot, Keys, Ask], None]] = {
    "find-port": find,
    "scan": scan,
    "setup": setup,
    "calibrate": calibrate,
    "monitor": monitor,
    "read": read,
    "write": write,
    "reboot": reboot,
    "torque": torque,
    "nominal": nominal,
    "pack": pack,
    "emulate": emulate,
}
