"""From servos of the factory to a robot's file: IDs, joints by hand, and nothing half written."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from hardware import commands, detected, scan, wizard
from hardware.bus_client import BusClient
from hardware.clock import VirtualClock
from hardware.config import Robot, load_robot
from hardware.connect import DRIVERS
from hardware.driver import Driver
from hardware.emulator.hand import as_delivered
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from tests.hardware.person import Person, places_of

SO101 = Path(__file__).with_name("so101.xml")


class Desk:
    """A robot whose servos are as from the factory, none connected, behind a port in virtual time.

    Args:
        robot: as it is once it is set up.
        places: see `Person`.
    """

    def __init__(self, robot: Robot, places: dict[str, list[float]]) -> None:
        self.world = EmulatedRobot(as_delivered(robot))
        self.port = LoopbackPort(self.world, VirtualClock())
        self.world.hold()
        for i in range(len(robot.servos)):
            self.world.connect(i, False)
        self.person = Person(self.world, self.port, places)

    def client_of(self, port: str, maker: str) -> BusClient:
        """Return a client of one maker's servos."""
        return DRIVERS[maker].client_type(self.port, self.port.clock, 0.001)

    def make_driver(self, robot: Robot) -> Driver:
        """Return a driver of the robot at the port."""
        return DRIVERS[robot.maker](robot, self.port, self.port.clock)

    def attach(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Let the verbs find this desk at any port, and look at two speeds only."""
        speeds = {"dynamixel": (57600, 1_000_000), "feetech": (1_000_000,)}
        monkeypatch.setattr(scan, "ALL_SPEEDS", speeds)
        for module in (detected, wizard):
            monkeypatch.setattr(module, "client_of", self.client_of)
        for module in (commands, wizard):
            monkeypatch.setattr(module, "make_driver", self.make_driver)


@pytest.fixture
def desk(chain, monkeypatch) -> Desk:
    """Three XL330, the second of which is reversed, with its zero elsewhere."""
    robot = chain(3)
    turned = replace(robot.servos[1], sign=-1, zero=1000)
    robot = replace(robot, servos=(robot.servos[0], turned, robot.servos[2]))
    places = {
        "hinge1": places_of(-1.0, 1.2),
        "hinge2": places_of(-0.5, 0.9, 0.1),
        "hinge3": places_of(1.9, -1.9, 0.0, -0.1),
    }
    made = Desk(robot, places)
    made.attach(monkeypatch)
    return made


def words(desk: Desk, path: Path) -> list[str]:
    """Return the command line that makes the file."""
    return ["setup", "port=/dev/arm", f"model={desk.world.robot.model}", f"file={path}"]


def test_from_the_factory_to_a_file(desk, tmp_path, capsys):
    """IDs and speed are written, and each joint's servo, sign, zero and limits are the hand's."""
    path = tmp_path / "arm.yaml"
    assert commands.main(words(desk, path), desk.person) == 0
    assert [s.id for s in desk.world.servos] == [1, 2, 3]
    assert [s.baud for s in desk.world.servos] == [1_000_000] * 3
    assert not desk.world.firmware.torque_on.any()
    robot = load_robot(path)
    assert robot.names == ["hinge1", "hinge2", "hinge3"]
    assert [servo.sign for servo in robot.servos] == [1, -1, -1]
    step = 6.2831853 / 4096
    assert [servo.zero for servo in robot.servos] == pytest.approx(
        [2048, 1000 - 0.1 / step, 2048], abs=2
    )
    for servo, ends in zip(robot.servos, ((-1.0, 1.2), (-0.6, 0.8), (-1.9, 1.9)), strict=True):
        assert servo.position == pytest.approx(ends, abs=0.012)
    assert robot.port == "/dev/arm"
    assert robot.supply.voltage == pytest.approx(5.0, abs=0.1)
    assert Path(robot.model).samefile(desk.world.robot.model)
    driver = desk.make_driver(robot)
    driver.connect()
    assert "wrote" in capsys.readouterr().out


@pytest.mark.parametrize("answers", [0, 3, 9, 17])
@pytest.mark.parametrize("ends", [KeyboardInterrupt(), EOFError()])
def test_interrupted_half_way(desk, tmp_path, capsys, answers, ends):
    """Ctrl-C, or a terminal that closes, at any question: one sentence, status 2, and no file."""
    path = tmp_path / "arm.yaml"
    desk.person.ends, desk.person.after = ends, answers
    assert commands.main(words(desk, path), desk.person) == 2
    assert "written" in capsys.readouterr().err
    assert list(tmp_path.glob("*.yaml")) == []
    assert not desk.world.firmware.torque_on.any()


def test_a_joint_says_which_servo_turns_it(desk, tmp_path):
    """Servos whose IDs are in another order than the model's joints are told apart by the hand."""
    for i, number in enumerate((3, 1, 2)):
        desk.world.servos[i].memory["id"] = number
        desk.world.servos[i].memory["baud_rate"] = 3
        desk.world.connect(i)
    path = tmp_path / "arm.yaml"
    assert commands.main(words(desk, path), desk.person) == 0
    assert [servo.id for servo in load_robot(path).servos] == [3, 1, 2]
    assert not any("connect" in prompt for prompt in desk.person.asked)


def test_the_wrong_joint_is_asked_for_again(desk, tmp_path):
    """Two joints that move at once, or none, are no answer."""
    for i in range(3):
        desk.world.servos[i].memory["id"] = i + 1
        desk.world.servos[i].memory["baud_rate"] = 3
        desk.world.connect(i)
    moves = desk.person.lines
    wrong = iter([["move hinge1 0.3", "move hinge2 0.3"], []])

    def lines(prompt):
        if "a little, and" in prompt and (first := next(wrong, None)) is not None:
            return iter(first)
        return moves(prompt)

    desk.person.lines = lines
    path = tmp_path / "arm.yaml"
    assert commands.main(words(desk, path), desk.person) == 0
    again = [p for p in desk.person.asked if p.startswith("moved:")]
    assert again[0].startswith("moved: 'servo1', 'servo2'; one of 'servo1', 'servo2', 'servo3'")
    assert again[1].startswith("moved: none")
    assert load_robot(path).names == ["hinge1", "hinge2", "hinge3"]


def test_nothing_is_asked_for_a_file_that_cannot_be_made(desk, tmp_path, capsys):
    """A file that is there, another suffix, a model without actuators: before the port is used."""
    there = tmp_path / "there.yaml"
    there.write_text("kept")
    bare = tmp_path / "bare.xml"
    bare.write_text("<mujoco/>")
    for line, sentence in (
        (words(desk, there), "exists; choose another name"),
        (words(desk, tmp_path / "arm.json"), "ends in .yaml"),
        ([*words(desk, tmp_path / "a.yaml"), f"model={bare}"], "has no actuators"),
    ):
        assert commands.main(line, desk.person) == 2
        assert sentence in capsys.readouterr().err
    assert desk.person.asked == []
    assert there.read_text() == "kept"


def test_a_feetech_arm(tmp_path, monkeypatch):
    """Six STS3215 with ID 1, connected alone: all start at the speed that they keep."""
    robot = load_robot("so101", str(SO101))
    desk = Desk(robot, {name: places_of(-0.2, 0.4) for name in robot.names})
    desk.attach(monkeypatch)
    path = tmp_path / "my_so101.yaml"
    assert commands.main(words(desk, path), desk.person) == 0
    made = yaml.safe_load(path.read_text())
    assert [entry["id"] for entry in made["servos"].values()] == [1, 2, 3, 4, 5, 6]
    assert made["watchdog"] == 0.0
    assert load_robot(path).servos[2].position == pytest.approx((-0.2, 0.4), abs=0.012)


def test_a_limit_outside_the_servo_s(tmp_path):
    """In position mode a servo reaches one turn: more is refused with what it can reach."""
    text = (Path(__file__).parents[2] / "conf" / "robot" / "bench1.yaml").read_text()
    data = yaml.safe_load(text)
    data["servos"]["hinge"] |= {"zero": 3500, "position": [-1.0, 1.0]}
    path = tmp_path / "bench.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(RobotError, match=r"2848 to 4152 counts .* takes 0 to 4095: narrow it"):
        load_robot(path)
    data["registers"]["operating_mode"] = 4
    path.write_text(yaml.safe_dump(data))
    assert load_robot(path).servos[0].position == (-1.0, 1.0)
