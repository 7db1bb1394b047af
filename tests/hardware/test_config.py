"""A robot's file is read whole, or refused with the key that is wrong."""

import copy

import pytest
import yaml

from envs.tasks.servo.robot import read_machine
from hardware.config import NO_MODEL, ROBOTS, load_robot, make_robot
from hardware.errors import RobotError
from hardware.tables import servo_types

BENCH = yaml.safe_load((ROBOTS / "bench1.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", sorted(ROBOTS.glob("*.yaml")), ids=lambda p: p.stem)
def test_every_robot_is_read(path):
    """Each robot of the project has its model and its servos, and every key has a comment."""
    robot = load_robot(path.stem, needs_model=False)
    assert robot.name == path.stem
    assert robot.model.is_file() or robot.model == NO_MODEL
    assert all(servo.model in servo_types() for servo in robot.servos)
    lines = path.read_text(encoding="utf-8").splitlines()
    plain = [i for i, line in enumerate(lines) if line[:1].isalpha()]
    assert all(lines[i - 1].startswith("#") for i in plain), "a key without a comment above it"


def test_servos_share_what_they_do_not_say():
    """A servo's own value counts more than the robot's, and that more than sign 1 without limit."""
    data = copy.deepcopy(BENCH)
    hinge = data["servos"]["hinge"]
    shared = {key: hinge.pop(key) for key in ("model", "sign", "zero", "velocity", "torque")}
    assert make_robot(data | {"servo": shared}) == make_robot(BENCH)
    del shared["sign"], shared["torque"]
    assert make_robot(data | {"servo": shared}) == make_robot(BENCH)
    hinge["velocity"] = 2.0
    assert make_robot(data | {"servo": shared}).servos[0].velocity == 2.0
    machine = read_machine(data | {"servo": shared}, ["hinge"])
    assert machine.kinds == ("xl330-m288",)
    assert machine.most_step.tolist() == [2.0 / 50.0]


def test_counts_and_angles_are_inverse():
    """Any count becomes an angle and the same count again, whatever sign and zero are."""
    data = copy.deepcopy(BENCH)
    data["servos"]["hinge"] |= {"sign": -1, "zero": 1000, "position": [-2.0, 1.5]}
    servo = make_robot(data).servos[0]
    assert all(servo.count(servo.angle(count)) == count for count in range(-5000, 5000, 7))
    assert servo.angle(1000) == 0
    assert servo.angle(1001) == pytest.approx(-0.0015339808)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("rat",), 50, r"unknown key 'rat' \(did you mean 'rate'\?\)"),
        (("rate",), "fast", r"rate: 'fast' is not float"),
        (("rate",), 0, r"rate: 0.0 is not above 0"),
        (("rate",), True, r"rate: True is not float"),
        (("model",), "bench2.xml", r"no file 'bench2.xml' \(did you mean 'bench1.xml'"),
        (("bus", "baud"), 1000001, r"bus.baud: 1000001 is not one of"),
        (("bus", "speed"), 1, r"bus: unknown key 'speed'"),
        (("supply",), 5, r"supply: 5 is not a table"),
        (("servos",), {}, r"at least one"),
        (("servos", "hinge", "sign"), 2, r"servos.hinge: sign 2; expected 1 or -1"),
        (("servos", "hinge", "zero"), 99999, r"servos.hinge: zero 99999; a turn .* 4096 counts"),
        (("servos", "hinge", "id"), 253, r"id 253; expected 0 to 251"),
        (("servos", "hinge", "position"), [1, -1], r"position \[1.0, -1.0\]"),
        (("servos", "hinge", "position"), 1, r"1 is not a pair of numbers"),
        (("servos", "hinge", "model"), "xl330-m280", r"unknown servo type.*'xl330-m288'"),
        (("servo",), {"velocty": 8.0}, r"servo: unknown key 'velocty' \(did you mean 'velocity'"),
        (("servo",), {"id": 1}, r"servo: unknown key 'id'"),
        (("servo",), 8.0, r"servo: 8.0 is not a table"),
        (("registers", "position_gain"), 1, r"no register 'position_gain' \(did you mean"),
        (("registers", "present_position"), 1, r"'present_position' can only be read"),
        (("watchdog",), 3, r"watchdog: 3.0 s; expected 0 \(off\), or 0.02 to 2.54 s"),
        (("watchdog",), 0.01, r"watchdog: 0.01 s; expected 0 \(off\), or 0.02 to 2.54 s"),
        (("max_step",), 20, r"max_step: 20; .* at most 4, .*angles are in rad"),
        (("max_step",), float("inf"), r"max_step: inf is not a finite number"),
        (
            ("servos", "hinge", "velocity"),
            360,
            r"360 rad/s; .* at most [0-9.]+, its whole .*angles are in rad",
        ),
        (("servos", "hinge", "position"), [float("-inf"), 1], r"position: -inf is not a finite"),
        (
            ("servos", "hinge", "position"),
            [-115, 115],
            r"is -72920 to 77016 counts .* angles are in rad",
        ),
    ],
)
def test_refuses(path, value, message):
    """A wrong key or value is refused with its place."""
    data = copy.deepcopy(BENCH)
    part = data
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    with pytest.raises(RobotError, match=message):
        make_robot(data)


def test_missing_key_duplicate_id_and_unknown_robot():
    """A missing key, an ID used twice and an unknown robot are refused."""
    data = copy.deepcopy(BENCH)
    data["servos"]["knee"] = data["servos"]["hinge"]
    with pytest.raises(RobotError, match=r"servos.hinge: id 1 is not unique"):
        make_robot(data)
    del data["servos"]["knee"]["zero"]
    with pytest.raises(RobotError, match=r"servos.hinge: the key 'zero' is missing"):
        make_robot(data)
    with pytest.raises(RobotError, match=r"unknown robot 'bench' \(did you mean 'bench1'"):
        load_robot("bench")


@pytest.mark.parametrize(
    ("key", "again", "line"),
    [
        ("    id: 1", "    id: 2", 5),
        ("  hinge:", "  hinge: {id: 3}", 4),
        ("name: bench1", "name: a", 2),
    ],
)
def test_a_key_that_is_there_twice_is_refused(tmp_path, key, again, line):
    """The last of two would count: the file is refused with the line of the second."""
    text = "name: bench1\nservos:\n  hinge:\n    id: 1\n"
    path = tmp_path / "twice.yaml"
    path.write_text(text.replace(key, f"{again}\n{key}", 1))
    name = key.split(":")[0].strip()
    with pytest.raises(RobotError, match=rf"line {line}: the key '{name}' is there twice; keep"):
        load_robot(path)
