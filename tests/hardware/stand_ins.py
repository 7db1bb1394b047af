"""Models that stand in for public ones: their joints, servos and gearings, on bodies of our own.

path = public_model("koch", folder)     # the public one, where SIM2REAL_MODELS has it
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco

from hardware.config import Robot, load_robot

NEAR = 0.25  # of a joint's range: home is its middle if zero is nearer to an end than this
AXES = ([0, 0, 1], [0, 1, 0], [1, 0, 0])
RATIOS = {"neck_yaw": -0.909, "left_hip_yaw": -0.857, "right_hip_yaw": -0.857}  # of gears, else -1
DIFFERENTIAL = ("waist_act_1", "waist_act_2")  # two shafts turn the waist's yaw and roll


class Shape(NamedTuple):
    """What a stand-in looks like.

    Args:
        public: the public model's file.
        link: length [m] and mass [kg] of a link.
        chains: how many joints hang one after the other in each limb, in the order of the file.
        free: whether its base floats.
        suffix: of the actuators' names, where their joints have none.
    """

    public: str
    link: tuple[float, float]
    chains: Sequence[int]
    free: bool = False
    suffix: str = ""


ARM, DUCK = Shape("so101_new_calib.xml", (0.1, 0.08), (6,)), (5, 4, 5)
SHAPES: Mapping[str, Shape] = {
    "koch": Shape("low_cost_robot_arm.xml", (0.09, 0.05), (6,)),
    "so101": ARM,
    "so101_12v": ARM,
    "so101_leader": ARM,
    "leap_hand": Shape("right_hand.xml", (0.04, 0.03), (4, 4, 4, 4), suffix="_act"),
    "open_duck_mini": Shape("scene_flat_terrain.xml", (0.07, 0.08), DUCK, free=True),
    "toddlerbot": Shape("scene_pos.xml", (0.07, 0.09), (2, 2, 6, 6, 7, 7), free=True),
    "microduck": Shape("robot_walk.xml", (0.04, 0.03), DUCK, free=True),
}


def public_model(name: str, folder: Path) -> Path:
    """Return the robot's public model below SIM2REAL_MODELS, else a stand-in in the folder."""
    zoo = os.environ.get("SIM2REAL_MODELS")
    for path in sorted(Path(zoo).rglob(SHAPES[name].public)) if zoo else []:
        spec = mujoco.MjSpec.from_file(str(path))
        if {a.name for a in spec.actuators} == set(load_robot(name, needs_model=False).names):
            return path
    path = folder / f"{name}.xml"
    path.write_text(stand_in(load_robot(name, needs_model=False)).to_xml(), encoding="utf-8")
    return path


def stand_in(robot: Robot) -> mujoco.MjSpec:
    """Return the model of a robot."""
    shape, spec = SHAPES[robot.name], mujoco.MjSpec()
    spec.modelname, spec.compiler.degree = robot.name, False
    spec.option.timestep = 0.004
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    base = spec.worldbody.add_body(name="base", pos=[0, 0, 1.0])
    _link(base, 0.05, 0.6)
    if shape.free:
        base.add_freejoint(name="floating_base")
    servos, home = list(robot.servos), {}
    for limb, count in enumerate(shape.chains):
        chain = [servos.pop(0) for _ in range(count)]
        home |= _limb(spec, base, shape, limb, [(s.name, s.position) for s in chain])
    for servo in robot.servos:
        joint = servo.name.removesuffix(shape.suffix)
        actuator = spec.add_actuator(name=servo.name, target=joint)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.set_to_position(kp=10.0)  # as public models have it: of no servo
    model = spec.copy().compile()
    qpos, names = model.qpos0.copy(), [model.joint(i).name for i in range(model.njnt)]
    for name, angle in home.items():
        qpos[model.jnt_qposadr[names.index(name)]] = angle
    ctrl = [home[model.joint(int(model.actuator_trnid[i, 0])).name] for i in range(model.nu)]
    spec.add_key(name="home", qpos=qpos, ctrl=ctrl)
    return spec


def _link(body: mujoco.MjsBody, length: float, mass: float) -> None:
    fromto = [0, 0, 0, 0.3 * length, 0.2 * length, -length]
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    body.add_geom(type=kind, fromto=fromto, size=[0.012, 0, 0], mass=mass, contype=0, conaffinity=0)


def _limb(
    spec: mujoco.MjSpec,
    base: mujoco.MjsBody,
    shape: Shape,
    limb: int,
    servos: Sequence[tuple[str, tuple[float, float]]],
) -> dict[str, float]:
    """Hang a limb on the base, gears included, and return its joints' angles at home."""
    length, mass = shape.link
    home: dict[str, float] = {}
    parent, place = base, [0.03 * limb, 0.05 * (limb % 2), 0.0]
    for depth, (name, (low, high)) in enumerate(servos):
        joint, middle = name.removesuffix(shape.suffix), (low + high) / 2
        home[joint] = 0.0 if min(-low, high) > NEAR * (high - low) else middle
        turned, axis = joint, AXES[(depth + limb) % 3]
        if name in DIFFERENTIAL:
            turned = ("waist_yaw", "waist_roll")[depth]
            home[turned] = 0.0
        elif name.endswith("_drive"):
            turned = joint.removesuffix("_drive") + "_driven"
            home[turned] = RATIOS.get(joint.removesuffix("_drive"), -1.0) * home[joint]
        if turned != joint:
            gear = parent.add_body(name=f"{joint}_gear", pos=[place[0], place[1] + 0.02, place[2]])
            gear.add_joint(name=joint, axis=[0, 0, 1], range=[low - 0.1, high + 0.1])
            gear.add_geom(size=[0.01, 0, 0], mass=0.003, contype=0, conaffinity=0)
        parent = parent.add_body(name=f"{turned}_link", pos=place)
        reach = [-3.1, 3.1] if turned != joint else [low - 0.1, high + 0.1]
        parent.add_joint(name=turned, axis=axis, range=reach)
        _link(parent, length, mass)
        place = [0.3 * length, 0.2 * length, -length]
        if turned.endswith("_driven"):
            ratio = RATIOS.get(joint.removesuffix("_drive"), -1.0)
            coupling = spec.add_equality(name1=turned, name2=joint)
            coupling.type = mujoco.mjtEq.mjEQ_JOINT
            coupling.data[:5] = [0, ratio, 0, 0, 0]
    if servos[0][0] in DIFFERENTIAL:
        _differential(spec)
    return home


def _differential(spec: mujoco.MjSpec) -> None:
    """Couple the waist: roll = 7/24 (b - a), yaw = 5/24 (a + b) of its shafts, as ToddlerBot's."""
    for name, signs, ratio in (("waist_roll", (-1, 1), 7 / 24), ("waist_yaw", (1, 1), 5 / 24)):
        tendon = spec.add_tendon(name=f"{name}_coupling")
        tendon.wrap_joint(name, 1.0)
        for shaft, sign in zip(DIFFERENTIAL, signs, strict=True):
            tendon.wrap_joint(shaft, -sign * ratio)
        coupling = spec.add_equality(name1=tendon.name)
        coupling.type = mujoco.mjtEq.mjEQ_TENDON
