"""Every hidden effect does to the emulated robot what its number says."""

import struct

import mujoco
import numpy as np
import pytest

from hardware.config import load_robot
from hardware.emulator.bus import Bus
from hardware.emulator.faults import Fault
from hardware.emulator.hidden import EFFECTS, IMU_EFFECTS, make_hidden, read_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from hardware.protocol import READ, WRITE, Parser, instruction_packet
from tests.hardware.emulator.host import put

STEP = 2 * np.pi / 4096
K, R = 0.386, 3.40  # of an XL330-M288
MOMENT = 9.81 * (0.015 * 0.06 + 0.1 * 0.12)  # N·m of bench1's pendulum held level
KP = 800 / 256 / 885 / STEP * 5.0 * K / R


def world_with(robot=None, faults=(), on: bool = True, **effect) -> EmulatedRobot:
    """Return a world of bench1 (or another robot) that hides one effect and holds its position."""
    robot = robot or load_robot("bench1")
    names = ("speed", "damping", "count", "phase", "decay", "bristle", "ratio", "external")
    extra = {k: effect.pop(k) for k in names if k in effect}
    entries = [{"extra": extra, **effect}] if effect else []
    world = EmulatedRobot(robot, make_hidden(entries, robot), faults=faults)
    put(world, position_p_gain=800, torque_enable=int(on))
    return world


def settle(world: EmulatedRobot, goal: float, seconds: float = 1.0) -> float:
    """Command an angle [rad] and return where the joint is after a while."""
    put(world, goal_position=2048 + round(goal / STEP))
    world.advance(world.time + seconds)
    return float(world.mechanics.joint_angle[0])


@pytest.fixture
def floating(chain):
    """Return one servo without gravity."""
    return chain(1, option='gravity="0 0 0"')


def test_coulomb_friction_holds_within_its_band():
    """Let go where m g l sin q is below the friction, the pendulum stays; above it, it falls."""
    for start, stays in ((0.40, True), (0.65, False)):
        world = world_with(effect="coulomb_friction", value=0.06)
        world.mechanics.data.qpos[world.mechanics.qpos] = start
        put(world, torque_enable=0)
        world.advance(0.5)
        assert (abs(world.mechanics.angle[0] - start) < 0.01) == stays


def test_stribeck_friction_holds_more_than_it_slows():
    """The static excess holds the joint at rest, and is gone well above its speed."""
    world = world_with(effect="stribeck_friction", value=0.05, speed=0.05)
    settle(world, 0.3, 1.5)
    put(world, torque_enable=0)
    world.advance(world.time + 1)
    held = float(world.mechanics.angle[0])
    assert abs(held) > 0.1
    drop = world.mechanics._friction(np.array([1.0]))[0]
    assert drop < 1e-3


def test_viscous_friction_sets_the_speed(floating):
    """At full voltage the speed is (K V / R) / (K^2 / R + value)."""
    world = EmulatedRobot(
        floating, make_hidden([{"effect": "viscous_friction", "value": 0.03}], floating)
    )
    put(world, operating_mode=16, pwm_slope=255, torque_enable=1, goal_pwm=885)
    world.advance(2.0)
    assert world.mechanics.speed[0] == pytest.approx(5 * K / R / (K**2 / R + 0.03), rel=1e-3)


def test_load_dependent_friction_grows_with_the_torque():
    """Friction is the coefficient times the motor's torque."""
    world = world_with(effect="load_dependent_friction", value=0.2)
    settle(world, 1.0)
    load = abs(world.mechanics.torque[0])
    for _ in range(20):
        drag = world.mechanics._friction(np.array([5.0]))[0]
    assert drag == pytest.approx(0.2 * load, rel=0.05)


@pytest.mark.parametrize("side", ["motor", "link"])
def test_backlash_leaves_the_link_free(side):
    """Pushed both ways, the link turns by the play while the motor stands."""
    world = world_with(effect="backlash", where="hinge", side=side, value=0.06)
    settle(world, 0.0)
    data, mechanics = world.mechanics.data, world.mechanics
    ends = []
    for push in (0.05, -0.05):
        ends.append([])
        for _ in range(600):
            data.xfrc_applied[mechanics.model.body("arm").id, 4] = -push
            world.advance(world.time + 0.001)
        ends[-1] = [mechanics.data.qpos[mechanics.qpos][0], mechanics.joint_angle[0]]
    (motor_a, link_a), (motor_b, link_b) = ends
    assert (link_a - link_b) - (motor_a - motor_b) == pytest.approx(0.06, abs=2e-3)
    measured = mechanics.angle[0]
    assert measured == pytest.approx(link_b if side == "link" else motor_b, abs=1e-9)


def test_compliance_bends_by_the_load():
    """A spring of compliance c between gear and link bends by c times the torque through it."""
    world = world_with(effect="joint_compliance", side="motor", value=0.2, damping=0.01)
    q = settle(world, 1.0, 2.0)
    bend = world.mechanics.angle[0] - q
    assert bend == pytest.approx(0.2 * MOMENT * np.sin(q), rel=0.02)


def test_cogging_shifts_the_rest(floating):
    """At rest the P law carries the cogging torque: kp error = -amplitude sin(n q)."""
    entry = {"effect": "cogging", "value": 0.05, "extra": {"count": 3, "phase": 0.2}}
    world = EmulatedRobot(floating, make_hidden([entry], floating))
    put(world, position_p_gain=800, torque_enable=1)
    q = settle(world, 0.5)
    assert KP * (0.5 - q) == pytest.approx(-0.05 * np.sin(3 * q + 0.2), abs=3 * KP * STEP)


def test_armature_slows_the_start(floating):
    """The first speed of a step is torque over inertia, the armature added."""
    speeds = []
    for value in (0.0, 0.01):
        entry = {"effect": "armature", "value": value}
        world = EmulatedRobot(floating, make_hidden([entry], floating))
        put(world, operating_mode=16, pwm_slope=255, torque_enable=1, goal_pwm=200)
        world.advance(0.02)
        speeds.append(float(world.mechanics.speed[0]))
    inertia = 0.1 * (0.12**2 + 0.4 * 0.012**2) + 0.0018
    damping = K**2 / R
    assert speeds[0] / speeds[1] == pytest.approx(
        (1 - np.exp(-damping * 0.021 / inertia))
        / (1 - np.exp(-damping * 0.021 / (inertia + 0.01))),
        rel=0.02,
    )


def test_encoder_offset_moves_the_robot_not_the_reading(floating):
    """Measured = true + value: the servo regulates what it measures."""
    world = world_with(floating, effect="encoder_offset", value=0.1)
    q = settle(world, 0.5)
    assert q == pytest.approx(0.4, abs=3 * STEP)
    assert (world.firmware.count[0] - 2048) * STEP == pytest.approx(0.5, abs=3 * STEP)


def test_velocity_filter_lags(floating):
    """The reported speed follows a step with the time constant."""
    world = world_with(floating, on=False, effect="velocity_filter", value=0.1)
    world.mechanics.data.qvel[world.mechanics.dof] = 3.0
    world.advance(0.1)
    assert world.firmware.velocity[0] == pytest.approx(3 * (1 - np.exp(-0.95)), rel=0.05)
    assert world.firmware.velocity[0] < 0.7 * world.mechanics.speed[0]


def test_noise_and_quantization():
    """Readings scatter by the noise, and lie on the grid of the resolution."""
    world = world_with(effect="sensor_noise", value=0.01, on=False)
    readings = []
    for _ in range(1000):
        world.advance(world.time + 0.001)
        readings.append((world.firmware.count[0] - 2048) * STEP)
    assert np.std(readings) == pytest.approx(0.01, rel=0.1)
    world = world_with(effect="quantization", value=0.05)
    settle(world, 0.52)
    angle = (world.firmware.count[0] - 2048) * STEP
    assert abs(angle / 0.05 - round(angle / 0.05)) < 0.02


def test_gains_and_strength_and_limits():
    """The sag at rest grows as gain, strength and supply fall; a torque limit caps the torque."""

    def sag(**effect) -> float:
        q = settle(world_with(**effect), 1.0, 1.5)
        return (1.0 - q) / np.sin(q)

    usual = sag()
    assert sag(effect="position_gain", value=0.5) / usual == pytest.approx(2, rel=0.06)
    assert sag(effect="motor_strength", value=0.5) / usual == pytest.approx(2, rel=0.06)
    assert sag(effect="supply_voltage", value=0.8) / usual == pytest.approx(1.25, rel=0.06)
    world = world_with(effect="torque_limit", value=0.2, faults=[Fault("stuck")])
    settle(world, 1.5, 0.5)
    assert world.mechanics.torque[0] == pytest.approx(0.2, rel=1e-2)
    world = world_with(effect="motor_strength", value=0.5, faults=[Fault("stuck")])
    settle(world, 1.5, 0.5)
    assert world.mechanics.torque[0] == pytest.approx(0.5 * 5 * K / R, rel=1e-2)


def test_derivative_gain_scales_the_register():
    """The D register's effect is multiplied; a neutral factor changes nothing."""
    world = world_with(effect="derivative_gain", value=0.5)
    put(world, position_d_gain=1600)
    assert world.firmware.control.kd[0] == pytest.approx(50.0)


def test_thermal_derating_weakens():
    """Under constant torque the strength falls by value * torque^2 * time."""
    world = world_with(effect="thermal_derating", value=0.5, faults=[Fault("stuck")])
    settle(world, 1.5, 1.0)
    tau0, energy, dt = 5 * K / R, 0.0, 0.01
    for _ in range(100):
        energy += dt * (tau0 * (1 - 0.5 * energy)) ** 2
    assert world.mechanics.torque[0] == pytest.approx(tau0 * (1 - 0.5 * energy), rel=0.02)


def test_heat_counts_every_tick(floating):
    """Commands in step with the looks at the heat make spikes, which heat as much as they work."""
    world = world_with(floating, effect="thermal_derating", value=1e-6)
    work = 0.0
    for tick in range(400):
        if tick % 10 == 0:
            put(world, goal_position=2048 + 20 * (tick // 10 % 2))
        world.firmware.tick()
        work += 1e-3 * float(world.mechanics.torque[0] ** 2)
    assert work > 0
    assert world.firmware._energy[0] == pytest.approx(work, rel=1e-6)


def test_dead_zone_ignores_small_errors(floating):
    """Errors below the zone drive nothing; larger ones drive in full."""
    world = world_with(floating, effect="dead_zone", value=0.05)
    settle(world, 0.04)
    assert world.mechanics.angle[0] == pytest.approx(0.0, abs=1e-6)
    assert abs(settle(world, 0.5) - 0.5) <= 0.05 + STEP


def test_profiles_limit_the_goal():
    """The hidden limits act like the registers, in rad/s and rad/s^2."""
    world = world_with(effect="profile_velocity", value=1.0)
    settle(world, 1.5, 0.5)
    assert (world.firmware.trajectory[0][0] - 2048) * STEP == pytest.approx(0.5, abs=0.01)
    world = world_with(effect="profile_acceleration", value=4.0)
    settle(world, 1.5, 0.5)
    assert (world.firmware.trajectory[0][0] - 2048) * STEP == pytest.approx(0.5, abs=0.02)


def test_delays():
    """A goal acts `command_delay` later, and a reading is `observation_delay` old."""
    robot = load_robot("bench1")
    world = world_with(effect="command_delay", value=0.05)
    goal = instruction_packet(1, WRITE, struct.pack("<Hi", 116, 3000))
    Bus(world).feed(goal, 0.1, robot.bus.baud)
    world.advance(0.149)
    assert world.firmware.goal[0] == 2048
    assert world.servos[0].memory["goal_position"] == 3000
    world.advance(0.152)
    assert world.firmware.goal[0] == 3000
    world = world_with(effect="observation_delay", value=0.03)
    put(world, goal_position=3000)
    track = []
    for k in range(200):
        world.advance(0.1 + 0.001 * k)
        track.append((float(world.firmware.count[0]), float(world.firmware.present()[0][0])))
    now, seen = np.array(track).T
    np.testing.assert_array_equal(seen[30:], now[:-30])


def test_packet_loss():
    """A read is answered with probability (1 - p)^2: each way can lose it."""
    world = world_with(effect="packet_loss", value=0.3)
    request = instruction_packet(1, READ, struct.pack("<HH", 132, 4))
    answered, bus = 0, Bus(world)
    for k in range(1000):
        arrivals = bus.feed(request, 0.001 * k, 1_000_000)
        answered += len(Parser().feed(b"".join(data for _, data in arrivals)))
    assert answered / 1000 == pytest.approx(0.49, abs=0.04)


def test_masses():
    """Mass, centre, payload and tilt change the holding torque as statics says."""

    def torque(goal: float = 1.0, **effect) -> tuple[float, float]:
        world = world_with(**effect)
        q = settle(world, goal, 1.5)
        return float(world.mechanics.torque[0]), q

    centre = (0.015 * 0.06 + 0.1 * 0.12) / 0.115
    hold, q = torque(effect="link_mass", where="arm", value=0.05)
    assert hold == pytest.approx(9.81 * 0.165 * centre * np.sin(q), rel=0.02)
    hold, q = torque(effect="center_of_mass", where="arm", value=-0.02)
    assert hold == pytest.approx(9.81 * 0.115 * (centre - 0.02) * np.sin(q), rel=0.02)
    hold, q = torque(effect="payload", where="arm", value=0.05)
    assert hold == pytest.approx(MOMENT * np.sin(q) + 9.81 * 0.05 * 0.12 * np.sin(q), rel=0.02)
    hold, q = torque(effect="gravity_tilt", value=[0.0, 0.2])
    assert hold == pytest.approx(MOMENT * np.sin(q - 0.2), rel=0.02)


def test_payload_adds_inertia_about_the_joint():
    """A payload adds m l^2 to the inertia about the hinge."""
    world = world_with(effect="payload", where="arm", value=0.05)
    plain = world_with()
    more = world.mechanics.model.dof_M0[0] - plain.mechanics.model.dof_M0[0]
    assert more == pytest.approx(0.05 * 0.12**2, rel=1e-3)


def test_contacts(tmp_path):
    """Friction is written to foot and ground; stiffness shortens the contact's time constant."""
    text = load_robot("bench1").model.read_text(encoding="utf-8")
    text = text.replace(
        '<body name="mount"', '<geom name="floor" type="plane" size="1 1 1"/>\n<body name="mount"'
    )
    text = text.replace('name="ball"', 'name="foot"')
    path = tmp_path / "foot.xml"
    path.write_text(text)
    robot = load_robot("bench1")
    robot = type(robot)(**{**robot.__dict__, "model": path})
    entries = [
        {"effect": "ground_friction", "value": 0.3},
        {"effect": "contact_stiffness", "where": "foot", "value": 4.0},
    ]
    model = EmulatedRobot(robot, make_hidden(entries, robot)).mechanics.model
    before = mujoco.MjModel.from_xml_path(str(path))
    for name in ("foot", "floor"):
        assert model.geom(name).friction[0] == 0.3
        assert model.geom(name).solref[0] == pytest.approx(before.geom(name).solref[0] / 2)


def test_nothing_hidden_is_neutral():
    """Every effect's neutral value leaves the emulated robot as it is, bit for bit."""
    neutral = {"position_gain", "derivative_gain", "motor_strength", "supply_voltage"}

    def track(**effect) -> bytes:
        world = world_with(**effect)
        settle(world, 0.7, 0.2)
        return world.mechanics.data.qpos.tobytes()

    plain = track()
    skipped = ("ground_friction", "contact_stiffness", "torque_limit", "gravity_tilt")
    skipped += tuple(IMU_EFFECTS)  # test_hidden_imu.py
    for name in EFFECTS:
        if name in skipped or name.startswith("profile"):
            continue
        where = "arm" if name in ("link_mass", "center_of_mass", "payload") else None
        assert track(effect=name, where=where, value=1.0 if name in neutral else 0.0) == plain


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"effect": "goal", "value": 1}, r"entry 1 \(goal\): a goal belongs to a task"),
        (
            {"effect": "backlsh", "value": 1},
            r"entry 1 \(backlsh\): unknown effect \(did you mean 'b",
        ),
        ({"effect": "backlash", "where": "hing", "value": 1}, r"no servo or joint 'hing'.*'hinge'"),
        ({"effect": "payload", "where": "arms", "value": 1}, r"no body 'arms' \(did you mean 'arm"),
        ({"effect": "backlash", "value": -1}, r"-1 is not a finite number of at least 0"),
        ({"effect": "backlash", "value": "x"}, r"'x' is not a finite number"),
        ({"effect": "backlash", "value": 1, "side": "left"}, r"side 'left'; expected 'motor'"),
        ({"effect": "packet_loss", "where": "hinge", "value": 0.1}, r"leave out where: 'hinge'"),
        ({"effect": "cogging", "value": 1, "extra": {"counts": 1}}, r"extra 'counts' \(did you"),
        ({"effect": "gravity_tilt", "value": 1}, r"1 is not a list of two angles"),
        ({"efect": "backlash"}, r"unknown key 'efect' \(did you mean 'effect'"),
        ("backlash", r"'backlash' is not a table"),
    ],
)
def test_refuses(entry, message):
    """A wrong entry is refused with its number, its effect and what is allowed."""
    with pytest.raises(RobotError, match=message):
        make_hidden([entry], load_robot("bench1"))


def test_files(tmp_path):
    """A file of effects is read; one that is missing or no list is refused."""
    robot = load_robot("bench1")
    path = tmp_path / "effects.yaml"
    path.write_text("- {effect: backlash, where: hinge, side: link, value: 0.05, ci: null}\n")
    hidden = read_hidden(path, robot)
    assert hidden["backlash"][0] == 0.05
    assert hidden.link_side[0]
    path.write_text("effect: backlash\n")
    with pytest.raises(RobotError, match=r"is a list, but this is .*begin each entry with a dash"):
        read_hidden(path, robot)
    with pytest.raises(RobotError, match="No such file"):
        read_hidden(tmp_path / "nothing.yaml", robot)
