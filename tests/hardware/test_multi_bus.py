"""A robot on several buses: asked together, stopped everywhere, whatever becomes of one bus."""

from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from hardware import commands as command
from hardware.clock import VirtualClock
from hardware.config import ROBOTS, Robot, load_robot, make_robot
from hardware.connect import make_driver
from hardware.driver import Driver
from hardware.emulator.faults import Fault
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, SafetyError, SerialPortError, ServoError
from hardware.excite import excite
from hardware.feetech.driver import FeetechDriver
from hardware.handshake import check_rate
from hardware.multi_bus import MultiBusDriver
from hardware.port_lock import PortLock
from hardware.record import record
from hardware.safety import Guard
from tests.hardware.conftest import bench_data, many_benches
from tests.hardware.rig import in_real_time
from tests.hardware.test_main import emulated, patiently

STEP = 2 * np.pi / 4096  # rad, a count


def data_of(name: str = "pair2") -> dict[str, Any]:
    """Return what a robot's file holds."""
    return yaml.safe_load((ROBOTS / f"{name}.yaml").read_text(encoding="utf-8"))


def pairs(tmp_path, buses: int) -> Robot:
    """Return six pendulums on one bus or on two, of the same IDs there."""
    model = tmp_path / "six.xml"
    model.write_text(many_benches(6, ""))
    data = bench_data(6, name="six", model=str(model))
    data["bus"]["latency"] = 1e-4
    if buses == 2:
        bus = data.pop("bus")
        data.pop("port")
        data["buses"] = {"left": bus, "right": bus}
        for i, servo in enumerate(data["servos"].values()):
            servo |= {"bus": ("left", "right")[i % 2], "id": 1 + i // 2}
    return make_robot(data)


class Rig:
    """An emulated robot, its ports, driver and guard, connected."""

    def __init__(self, robot: Robot, faults=()) -> None:
        self.world, self.clock = EmulatedRobot(robot, faults=faults), VirtualClock()
        self.driver = make_driver(robot, self.world, self.clock)
        self.driver.connect()
        self.driver.configure()
        self.guard = Guard(self.driver)

    @property
    def ports(self) -> list[LoopbackPort]:
        """The ports of the buses."""
        found: Any = [part.bus_client.port for part in self.driver.parts]
        return found

    @property
    def powered(self) -> list[bool]:
        """Which servos have torque."""
        return self.world.firmware.torque_on.tolist()


def test_each_bus_has_a_driver_of_its_makers():
    """Dynamixel and Feetech are mixed; their counters and angles come in the robot's order."""
    rig = Rig(load_robot("pair2"))
    assert isinstance(rig.driver, MultiBusDriver)
    assert [type(part) for part in rig.driver.parts] == [Driver, FeetechDriver]
    assert list(rig.driver.counters) == ["hinge", "swing"]
    goal = np.array([0.3, -0.2])
    assert rig.driver.angles(rig.driver.counts(goal)) == pytest.approx(goal, abs=STEP / 2)
    with rig.guard as guard:
        guard.arm()
        assert rig.powered == [True, True]
        health = [rig.driver.health(i) for i in range(2)]
        assert [h.watchdog for h in health if h] == [5, 0]
        guard.move_to(goal)
        rig.clock.sleep_until(rig.clock.now() + 0.05)
        assert guard.read().position == pytest.approx(goal, abs=0.1)
    assert rig.powered == [False, False]


def test_the_log_of_two_buses_agrees_with_the_nominal_model():
    """Both makers' servos are seen when their stamps say: the model replays them to 2 counts."""
    rig = Rig(load_robot("pair2"))
    with rig.guard as guard:
        pose = guard.arm().position
        plan = excite(rig.driver.robot, pose, 6.0, ("ramp", "chirp"), np.random.default_rng(0))
        log = record(guard, plan)
    model = mujoco.MjModel.from_xml_path(str(rig.driver.robot.model))
    model.opt.timestep = 0.0005
    for name in rig.driver.robot.names:
        data, track = mujoco.MjData(model), []
        due = log.time + rig.driver.robot.command_delay
        for stamp in log.column(f"stamp.{name}"):
            while data.time < stamp:
                row = max(int(np.searchsorted(due, data.time, side="right")) - 1, 0)
                data.ctrl[:] = [log.column(f"ctrl.{n}")[row] for n in rig.driver.robot.names]
                mujoco.mj_step(model, data)
            track.append(data.joint(name).qpos[0])
        gap = np.sqrt(np.mean((np.array(track) - log.column(f"qpos.{name}")) ** 2))
        assert gap < 2 * STEP
        assert np.ptp(log.column(f"qpos.{name}")) > 0.5


def test_two_buses_take_as_long_as_one_of_half_the_servos(tmp_path):
    """All buses are asked before any is waited for; equal IDs on two buses are two servos."""
    spans, samples = {}, {}
    for buses in (1, 2):
        rig = Rig(pairs(tmp_path, buses))
        begin = rig.clock.now()
        for _ in range(100):
            reading = rig.driver.read()
            assert reading.fresh.all()
        spans[buses] = (rig.clock.now() - begin) / 100
        samples[buses] = np.ptp(reading.stamp)
    assert spans[2] < 0.75 * spans[1]
    assert samples[2] == pytest.approx(samples[1] * 2 / 5, rel=0.01)
    slow = {"baud": 57600, "return_delay": 0.0005, "latency": 0.001}
    data = data_of() | {"rate": 100.0, "buses": {"dynamixel": slow, "feetech": slow}}
    with pytest.raises(ServoError, match=r"bus dynamixel: 1 servos at 57600 bits/s.*at most"):
        [check_rate(part) for part in make_robot(data).parts()]


def test_a_lost_bus_stops_the_others_at_once():
    """One bus loses its cable: torque goes off on the other, and there when it is back."""
    rig = Rig(load_robot("pair2"))
    with rig.guard as guard:
        guard.arm()
        first, _ = rig.ports
        first.unplugged = True
        sleep, seen = rig.clock.sleep_until, []

        def waiting(moment: float) -> None:
            sleep(moment)
            if first.unplugged:
                seen.append(rig.powered)
                first.unplugged = len(seen) < 5

        rig.clock.sleep_until = waiting
        with pytest.raises(SafetyError, match=r"the port is gone.*; it came back, and torque is o"):
            guard.read()
        assert seen[-1] == [True, False]  # the watchdog holds the first, without its bus
        assert rig.powered == [False, False]


def test_a_bus_that_stays_away_is_named():
    """The others are off; the message says to cut the supply."""
    rig = Rig(load_robot("pair2"))
    with rig.guard as guard:
        guard.arm()
        rig.ports[1].unplugged = True
        with pytest.raises(SafetyError, match=r"could not be switched off within 4 s.*cut the sup"):
            guard.read()
        assert rig.powered == [False, True]
        rig.ports[1].unplugged = False


def test_a_servo_that_dies_on_one_bus_stops_all():
    """The guard names it, and no servo of any bus keeps its torque."""
    rig = Rig(load_robot("pair2"), faults=[Fault("stuck", start=1.5, servo=1)])
    with rig.guard as guard:
        guard.arm()
        with pytest.raises(SafetyError, match="it is stuck"):
            for k in range(200):
                guard.read()
                guard.command(np.full(2, np.sin(k / 20)))
                rig.clock.sleep_until(rig.clock.now() + 0.02)
    assert rig.powered == [False, False]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bus": {}}, "it has both bus and buses"),
        ({"buses": {}}, "expected at least one"),
        ({"buses": {"a": {"baud": 1000000}}}, "the key 'return_delay' is missing"),
        ({"port": "/dev/a"}, "port: '/dev/a' for 2 buses .'dynamixel', 'feetech'.; each has one"),
        ({"port": ["/dev/a", "/dev/a"]}, "each bus needs its own port"),
        ({"port": ["/dev/a", None]}, "no port for 'feetech'; give one for each bus, or for none"),
    ],
)
def test_what_several_buses_cannot_be(changes, message):
    """Each mistake in the file or on the command line is one sentence."""
    with pytest.raises(RobotError, match=message):
        make_robot(data_of() | changes)


@pytest.mark.parametrize(
    ("servo", "message"),
    [
        ({"bus": "left"}, "bus 'left': the robot has no such bus; give one of 'dynamixel', 'feet"),
        ({"bus": "feetech", "registers": {}}, "it has no servo; each servo's key bus"),
        ({"id": 300}, "id 300; expected 0 to 251"),
    ],
)
def test_where_a_servo_cannot_be(servo, message):
    """A servo is on one of the robot's buses, and each bus has one."""
    data = data_of()
    data["servos"]["hinge"] = data["servos"]["hinge"] | servo
    with pytest.raises(RobotError, match=message):
        make_robot(data)


def test_a_bus_has_one_maker_and_ids_of_its_own():
    """Two makers, or one ID twice, are refused on one bus and allowed on two."""
    data = data_of()
    both = {**data["servos"], "other": data["servos"]["hinge"] | {"bus": "feetech", "id": 2}}
    with pytest.raises(RobotError, match=r"buses.feetech: servos of .* on one bus"):
        make_robot(data | {"servos": both})
    twice = {**data["servos"], "other": data["servos"]["hinge"]}
    with pytest.raises(RobotError, match="id 1 is not unique on its bus"):
        make_robot(data | {"servos": twice})
    with pytest.raises(RobotError, match="bus 'left': the robot has no such bus; leave it out"):
        hinge = bench_data()["servos"]["hinge"]
        make_robot(bench_data(servos={"hinge": hinge | {"bus": "left"}}))
    robot = make_robot(data_of() | {"port": ["/dev/a", "/dev/b"]})
    assert [(part.port, part.watchdog) for part in robot.parts()] == [
        ("/dev/a", 0.1),
        ("/dev/b", 0),
    ]
    assert robot.at(None).parts()[0].port is None


def test_setup_and_scan_go_through_all_buses(monkeypatch, capsys):
    """Each bus is scanned, compared and written to in turn."""
    original = command.make_driver

    def driver(robot: Robot) -> Driver:
        made = original(
            robot, EmulatedRobot(robot, registers={"hinge": {"return_delay_time": 250}})
        )
        port: Any = made.parts[1].bus_client.port
        shell = port._bus.shells[0]
        shell["return_delay_time"] = 250
        shell._kept = bytes(shell.data[:40])
        return made

    monkeypatch.setattr(command, "make_driver", driver)
    assert command.main(["setup", "robot=pair2"], lambda prompt, meanwhile=None: "y") == 0
    out = capsys.readouterr().out
    assert out.count("return_delay_time 250 -> 0") == 2
    assert "pair2: all 2 servos match its file" in out


@pytest.mark.timeout(120)
def test_two_device_files_for_clients_that_are_not_ours(tmp_path, capsys):
    """Each maker's SDK reads its bus; our scan and monitor use both, and a held one is named."""
    scs = pytest.importorskip("scservo_sdk")
    import dynamixel_sdk as dxl

    link = tmp_path / "two"
    with emulated("robot=pair2", f"link={link}") as (first, process):
        assert process.stdout is not None
        second = process.stdout.readline().split(" at ")[1].split(",")[0]
        links = [str(link) + "-dynamixel", str(link) + "-feetech"]
        port, other = dxl.PortHandler(first), scs.PortHandler(second)
        for each in (port, other):
            assert each.openPort() and each.setBaudRate(1_000_000)

        assert patiently(dxl.PacketHandler(2.0).read4ByteTxRx, port, 1, 132)[0] == 2048
        assert patiently(scs.PacketHandler(0).read2ByteTxRx, other, 1, 56)[0] == 2048
        port.closePort()
        other.closePort()
        lock = PortLock(links[1])
        lock.take()
        words = ["monitor", "robot=pair2", f"port={','.join(links)}", "seconds=0.5"]
        assert command.main(words) == 1
        assert "two-feetech is held by an open driver of this program" in capsys.readouterr().err
        lock.release()

        def watch() -> None:
            if command.main(words):
                raise SerialPortError(capsys.readouterr().err)

        in_real_time(watch)
        out = capsys.readouterr().out
        assert "hinge" in out and "swing" in out
