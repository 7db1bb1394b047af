"""Every robot is driven over the emulated bus, and its log agrees with its nominal model."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.body import EmulatedBody
from hardware.config import NO_MODEL, ROBOTS, load_robot
from hardware.connect import make_driver
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.errors import LogError, SafetyError, SerialPortError
from hardware.excite import ExcitationPlan
from hardware.log import Log, check_names, read_log, write_log
from hardware.record import Recording, joint_names, record
from hardware.safety import Guard
from hardware.stop_limits import full_duty_errors

NAMES = sorted(  # whose models are ours
    path.stem
    for path in ROBOTS.glob("*.yaml")
    if load_robot(path.stem, needs_model=False).model != NO_MODEL
)


def home(robot) -> np.ndarray:
    """Return the servos' angles in the keyframe `home`."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    starts = [model.jnt_qposadr[model.joint(name).id] for name in joint_names(robot)]
    return model.key("home").qpos[starts]


def drive(name: str, steps: int = 100, size: float = 0.4, effects=()) -> Log:
    """Return the log of a robot that waves all its joints about its home pose."""
    robot = load_robot(name)
    driver = make_driver(robot, EmulatedRobot(robot, make_hidden(list(effects), robot)))
    driver.connect()
    driver.configure()
    middle, order = home(robot), np.arange(len(robot.servos))
    time = np.arange(steps) / robot.rate
    waves = size * np.sin(time[:, None] * (3 + order) + 2 * time[:, None] ** 2)
    low, high = np.array([servo.position for servo in robot.servos]).T
    with Guard(driver) as guard:
        guard.arm()
        guard.move_to(middle, speed=1.0)
        return record(guard, np.clip(middle + waves, low, high))


def replay(log: Log, robot) -> np.ndarray:
    """Return the nominal model's angles at the log's rows, (T, n); no effect, declared delay."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    joints = joint_names(robot)
    places = [model.jnt_qposadr[model.joint(name).id] for name in joints]
    order = [model.actuator(name).id for name in robot.names]
    data.qpos[places] = [log.column(f"qpos.{joint}")[0] for joint in joints]
    speeds = [model.jnt_dofadr[model.joint(name).id] for name in joints]
    data.qvel[speeds] = [log.column(f"qvel.{joint}")[0] for joint in joints]
    ctrl = np.stack([log.column(f"ctrl.{name}") for name in robot.names], axis=1)  # (T, n)
    due = log.time + robot.command_delay
    times, track = [], []
    while data.time < log.time[-1] + 0.01:
        row = max(int(np.searchsorted(due, data.time + 1e-9, "right")) - 1, 0)
        data.ctrl[order] = ctrl[row]
        times.append(data.time)
        track.append(data.qpos[places].copy())
        mujoco.mj_step(model, data)
    path = np.array(track)
    stamps = [np.clip(log.column(f"stamp.{joint}"), 0, None) for joint in joints]
    return np.stack([np.interp(t, times, path[:, i]) for i, t in enumerate(stamps)], axis=1)


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_is_driven(name, tmp_path):
    """A robot arms, follows a motion, and its log is whole, readable and named as its model."""
    robot = load_robot(name)
    log = drive(name, steps=40, size=0.1)
    assert len(log) == 40
    assert log.column("flag.fresh").all()
    for actuator, servo in zip(robot.names, robot.servos, strict=True):
        if servo.type.current is None:  # the load of an emulated one is its duty
            load, duty = (log.column(f"sensor.{kind}_{actuator}") for kind in ("load", "duty"))
            np.testing.assert_allclose(load, duty, atol=2e-3)
        assert (f"current.{actuator}" in log.columns) == (servo.type.current is not None)
        volts = log.column(f"voltage.{actuator}")
        np.testing.assert_allclose(volts, robot.supply.voltage, atol=0.06)
        assert (log.column(f"temperature.{actuator}") >= 25).all()
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    joints = [model.joint(i).name for i in range(model.njnt)]
    check_names(log, joints, robot.names, driven=joint_names(robot))
    back = read_log(write_log(tmp_path / "drive.csv", log))
    np.testing.assert_array_equal(back.column("time"), log.time)
    assert back.model is not None
    assert back.model.resolve() == robot.model.resolve()
    assert not Path(back.meta["model"]).is_absolute()
    for actuator, joint in zip(robot.names, joint_names(robot), strict=True):
        off = log.column(f"qpos.{joint}") - log.column(f"ctrl.{actuator}")
        assert np.abs(off).max() < 0.35


@pytest.mark.parametrize("name", ["bench1", "bench1_bam", "arm6"])
def test_nothing_hidden_is_no_gap(name):
    """With nothing hidden the nominal model replays the log within two counts RMS, each joint."""
    robot = load_robot(name)
    log = drive(name, steps=round(2 * robot.rate))
    replayed = replay(log, robot)
    for i, joint in enumerate(joint_names(robot)):
        error = replayed[:, i] - log.column(f"qpos.{joint}")
        assert np.sqrt(np.mean(error**2)) < 2 * 2 * np.pi / 4096, joint


def test_a_hidden_effect_is_a_gap():
    """Twice the mass of the ball shows as a gap of several counts."""
    robot = load_robot("bench1")
    payload = {"effect": "payload", "where": "arm", "value": 0.1}
    log = drive("bench1", effects=[payload])
    error = replay(log, robot)[:, 0] - log.column("qpos.hinge")
    assert np.sqrt(np.mean(error**2)) > 5 * 2 * np.pi / 4096


def test_swings_are_free():
    """Where a plan lets go, the log says so, nothing is driven, and the arm swings on."""
    robot = load_robot("bench1")
    world = EmulatedRobot(robot)
    driver = make_driver(robot, world)
    driver.connect()
    driver.configure()
    angles = np.full((150, 1), 1.0)
    torque = np.arange(150) < 75
    with Guard(driver) as guard:
        guard.arm()
        guard.move_to(np.array([1.0]), speed=2.0)
        log = record(guard, ExcitationPlan(angles, torque))
        with pytest.raises(SafetyError, match="limp"):
            guard.command(np.array([0.0]))
        guard.restore_torque()
        guard.move_to(np.array([0.0]))
        assert world.firmware.torque_on.all()
    np.testing.assert_array_equal(log.column("torque.hinge"), torque)
    free = log.column("qpos.hinge")[80:]
    assert free.min() < -0.3
    assert np.abs(log.column("current.hinge")[80:]).max() == 0
    assert not world.firmware.torque_on.any()


def test_quad_stands_up():
    """From where it collapsed without torque, the quadruped stands up and stays upright."""
    robot = load_robot("quad8")
    world = EmulatedRobot(robot)
    world.advance(2.0)
    assert world.mechanics.data.qpos[2] < 0.05
    driver = make_driver(robot, world)
    driver.clock.sleep_until(2.0)
    driver.connect()
    driver.configure()
    with Guard(driver) as guard:
        guard.arm()
        guard.move_to(home(robot), speed=1.5)
        record(guard, np.tile(home(robot), (25, 1)))
    assert world.mechanics.data.qpos[2] > 0.11
    assert abs(world.mechanics.data.qpos[3]) > 0.98
    imu = world.mechanics.sensors()
    assert abs(imu["orientation"][0]) > 0.98
    assert imu["accelerometer"][2] == pytest.approx(9.81, abs=1.0)
    assert np.abs(imu["gyro"]).max() < 0.5


@pytest.mark.parametrize("ending", [KeyboardInterrupt, SafetyError])
def test_rows_survive_what_ends_a_recording(ending):
    """Ctrl-C or the guard ends it at row 40: the 40 rows are a log that says why it ended."""
    robot = load_robot("bench1")
    driver = make_driver(robot)
    driver.connect()
    driver.configure()
    guard = Guard(driver)

    class Interrupted(Recording):
        def _step(self, wanted, torque, on):
            if len(self) == 40:
                raise ending("somebody pulled the plug")
            super()._step(wanted, torque, on)

    with pytest.raises(ending), guard:
        guard.arm()
        recording = Interrupted(guard)
        recording.drive(np.zeros((100, 1)))
    log = recording.log()
    assert len(log) == 40
    assert log.meta["stopped"].endswith("somebody pulled the plug")
    assert not driver.health(0).torque
    with pytest.raises(LogError, match="0 rows were recorded, but a log has at least 2"):
        Recording(guard).log()


def test_a_soft_servo_may_sag_without_being_stuck():
    """bench1_bam holds 0.49 kg at P 200: it sags by more than 0.5 rad, and is not stopped for it.

    At full duty its loop would be 885 * 256 / 200 counts or 1.74 rad from its goal.
    """
    robot = load_robot("bench1_bam")
    driver = make_driver(robot)
    assert full_duty_errors(driver.robot) == pytest.approx([885 * 256 / 200 * 2 * np.pi / 4096])
    driver.connect()
    driver.configure()
    with Guard(driver) as guard:
        guard.arm()
        log = record(guard, np.full((400, 1), 1.4))
    assert 0.5 < log.column("ctrl.hinge")[-1] - log.column("qpos.hinge")[-1] < 1.2


class _Cut:
    """An IMU whose cable comes out after a few reads."""

    names = ("orientation",)

    def __init__(self, reads: int) -> None:
        self.reads = reads

    def measure(self, now: float) -> dict[str, np.ndarray]:
        """Return an orientation, or raise as a reader does."""
        self.reads -= 1
        if self.reads < 0:
            raise SerialPortError("IMU at port: the cable is out")
        return {"orientation": np.array([1.0, 0.0, 0.0, 0.0])}

    def return_to_start(self, now: float) -> None:
        """Do nothing."""


def test_an_imu_is_written_beside_the_servos():
    """Its own columns, a row a step, not the tracker's; one that fails stops the robot."""
    robot = load_robot("quad8")
    plan = np.tile(home(robot), (20, 1))
    for sensors in (True, False):
        world = EmulatedRobot(robot)
        driver = make_driver(robot, world)
        driver.connect()
        driver.configure()
        with Guard(driver) as guard:
            guard.arm()
            imu = EmulatedBody(world) if sensors else _Cut(5)
            recording = Recording(guard, sensors=imu)
            if sensors:
                recording.drive(plan)
                log = recording.log()
                turn = np.column_stack([log.column(f"quat.imu.{axis}") for axis in "wxyz"])
                assert np.allclose(np.linalg.norm(turn, axis=1), 1.0)
                assert "gyro.imu.z" in log.columns
                assert not [n for n in log.columns if n.startswith("sensor.position")]
            else:
                with pytest.raises(SafetyError, match="the cable is out"):
                    recording.drive(plan)
                assert len(recording) == 5
