"""The emulated robot's MuJoCo model: its MJCF with voltage motors for actuators, and hidden edits.

    model, plays = build_model(robot, hidden, timestep=0.0005)

The nominal actuators go; each servo becomes a `dcmotor` driven by voltage, in a separate group so
that it can be switched off (a motor at 0 V brakes, a servo without torque does not). A servo with
play or a spring gets a second joint in addition to its own, between gear and link. The nominal
joint then is the motor's side.
"""

import mujoco
import numpy as np

from hardware.config import Robot
from hardware.emulator.hidden import HiddenEffects
from hardware.errors import RobotError, format_names
from hardware.parts import Imu
from hardware.ranges import check_ranges

IMU_SENSORS = {  # of the emulated IMU, in addition to the model's own sensors
    "orientation": ("imu orientation", mujoco.mjtSensor.mjSENS_FRAMEQUAT),
    "gyro": ("imu gyro", mujoco.mjtSensor.mjSENS_GYRO),
    "acceleration": ("imu acceleration", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
}
MOST_SERVOS = 30  # MuJoCo can switch 31 groups of actuators


def build_model(
    robot: Robot, hidden: HiddenEffects, timestep: float
) -> tuple[mujoco.MjModel, dict[int, str]]:
    """Return the emulated robot's model and the names of its added joints by servo.

    Args:
        robot: the robot.
        hidden: its hidden effects.
        timestep: the timestep of the physics [s].

    Raises:
        RobotError: the model cannot be read, servos and actuators do not go together, or limits
            lead far out of a joint's range.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(robot.model))
        base = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise RobotError(f"{robot.model}: this model does not compile: {error}") from None
    _check(robot, base)
    spec.option.timestep = timestep
    spec.option.gravity = _tilted(base.opt.gravity, *hidden.tilt)
    for key in list(spec.keys):
        spec.delete(key)
    plays = {}
    for i, servo in enumerate(robot.servos):
        actuator = spec.actuator(servo.name)
        _make_motor(actuator, servo.type.torque_constant, servo.type.resistance, i)
        joint = spec.joint(actuator.target)
        joint.armature += hidden["armature"][i]
        if hidden["backlash"][i] > 0 or hidden["joint_compliance"][i] > 0:
            plays[i] = f"{joint.name}.play"
            joint.parent.add_joint(
                name=plays[i], type=joint.type, axis=joint.axis, pos=joint.pos, armature=1e-6
            )
    if robot.imu is not None:
        _add_imu(spec, robot, robot.imu)
    _edit_bodies(spec, base, hidden)
    _edit_contacts(spec, base, hidden)
    return spec.compile(), plays


def _add_imu(spec: mujoco.MjSpec, robot: Robot, imu: Imu) -> None:
    """Let the model tell what is measured at the IMU's site."""
    sites = [site.name for site in spec.sites]
    if imu.site not in sites:
        raise RobotError(f"{robot.model}: imu: no site {imu.site!r}; it has {format_names(sites)}")
    for name, kind in IMU_SENSORS.values():
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=imu.site)


def home_pose(robot: Robot) -> dict[str, np.ndarray]:
    """Return each joint's position in the keyframe `home`, else in the model's reference pose."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    keys = [model.key(i).name for i in range(model.nkey)]
    qpos = model.key("home").qpos if "home" in keys else model.qpos0
    sizes = {0: 7, 1: 4, 2: 1, 3: 1}
    pose = {}
    for i in range(model.njnt):
        start = model.jnt_qposadr[i]
        pose[model.joint(i).name] = qpos[start : start + sizes[int(model.jnt_type[i])]].copy()
    return pose


def _check(robot: Robot, model: mujoco.MjModel) -> None:
    actuators = [model.actuator(i).name for i in range(model.nu)]
    if sorted(actuators) != sorted(robot.names):
        raise RobotError(
            f"{robot.model} has the actuators {format_names(actuators)}, the robot {robot.name} "
            f"the "
            f"servos {format_names(robot.names)}; each actuator needs one servo of its name"
        )
    if len(actuators) > MOST_SERVOS:
        raise RobotError(f"{robot.name} has {len(actuators)} servos; at most {MOST_SERVOS}")
    check_ranges(robot, model)


def _make_motor(actuator: mujoco.MjsActuator, constant: float, resistance: float, i: int) -> None:
    actuator.set_to_dcmotor(motorconst=[constant, constant], resistance=resistance)
    actuator.group = i
    actuator.damping[:] = 0
    actuator.forcelimited = 0
    actuator.ctrllimited = 0
    actuator.nsample = 0
    actuator.delay = 0


def _tilted(gravity: np.ndarray, a: float, b: float) -> np.ndarray:
    """Gravity seen from a base turned about its x axis by a, then about its new y axis by b."""
    ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    return (about_x @ about_y).T @ gravity


def _edit_bodies(spec: mujoco.MjSpec, base: mujoco.MjModel, hidden: HiddenEffects) -> None:
    state: dict[str, tuple[float, np.ndarray, np.ndarray]] = {}
    for effect, name, value in hidden.body:
        index = base.body(name).id
        mass, centre, inertia = state.get(name) or _inertial(base, index)
        if effect == "link_mass":
            mass = mass + value
        else:
            end = _far_end(base, index)
            if effect == "center_of_mass":
                centre = centre + value * end / np.linalg.norm(end)
            else:
                mass, centre, inertia = _with_point(mass, centre, inertia, value, end)
        if mass <= 0:
            raise RobotError(f"hidden {effect} of {name!r}: {value} kg leaves a mass of {mass} kg")
        state[name] = (mass, centre, inertia)
    for name, (mass, centre, inertia) in state.items():
        body = spec.body(name)
        body.explicitinertial = True
        body.mass, body.ipos = mass, centre
        i = inertia
        body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
        body.iquat = [1, 0, 0, 0]
        body.inertia = [0, 0, 0]


def _inertial(model: mujoco.MjModel, body: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre and inertia about the centre, along the body's axes, (3, 3)."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
    return float(model.body_mass[body]), model.body_ipos[body].copy(), inertia


def _with_point(
    mass: float, centre: np.ndarray, inertia: np.ndarray, more: float, point: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Add a point mass: the parallel axis theorem for both parts about the new centre."""
    total = mass + more
    new = (mass * centre + more * point) / total
    for m, p in ((mass, centre), (more, point)):
        r = p - new
        inertia = inertia + m * (r @ r * np.eye(3) - np.outer(r, r))
    return total, new, inertia


def _far_end(model: mujoco.MjModel, body: int) -> np.ndarray:
    """The joint of the next body, for a leaf its farthest site or geom: (3,), body's frame."""
    points = []
    for child in range(1, model.nbody):
        if model.body_parentid[child] == body:
            point = model.body_pos[child].copy()
            if model.body_jntnum[child]:
                turned = np.zeros(3)
                anchor = model.jnt_pos[model.body_jntadr[child]]
                mujoco.mju_rotVecQuat(turned, anchor, model.body_quat[child])
                point += turned
            points.append(point)
    if not points:
        points = [model.site_pos[i] for i in range(model.nsite) if model.site_bodyid[i] == body]
        points += [model.geom_pos[i] for i in range(model.ngeom) if model.geom_bodyid[i] == body]
    far = max(points, key=np.linalg.norm, default=np.zeros(3))
    if not np.linalg.norm(far) > 0:
        raise RobotError(
            f"body {model.body(body).name!r} has no child, site or geom at its far end; add a "
            f"site there"
        )
    return far


def _edit_contacts(spec: mujoco.MjSpec, base: mujoco.MjModel, hidden: HiddenEffects) -> None:
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    ground = [base.geom(i).name for i in range(base.ngeom) if base.geom_type[i] == plane]
    feet = [base.geom(i).name for i in range(base.ngeom) if "foot" in base.geom(i).name]
    for effect, geom, value in hidden.contact:
        names = ground + ([geom] if geom else feet)
        if not ground or len(names) == len(ground):
            raise RobotError(f"hidden {effect}: the model has no ground, or no geom named foot")
        for name in names:
            part = spec.geom(name)
            if effect == "ground_friction":
                part.friction[0] = value
            else:
                part.solref[0] /= np.sqrt(value)
