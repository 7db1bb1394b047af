"""The models of the zoo: Gymnasium's, Drake's, this project's, and one for each part of MJCF.

for model in models(): model.write(folder)      # folder/NAME.xml, or .urdf with its servos
"""

import shutil
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import mujoco

from envs.models import load_spec

ASSETS = Path(__file__).parents[2] / "envs" / "assets"
GYMNASIUM = (
    *("ant", "half_cheetah", "hopper", "humanoid", "humanoidstandup"),
    *("inverted_double_pendulum", "inverted_pendulum", "pusher_v5", "reacher", "swimmer"),
    *("walker2d_v5",),
)
OURS = (
    *("arm2", "arm6", "bench1", "hopper2", "pair2", "quad8"),
    *("exam/arm3", "exam/leg2", "exam/pendulum"),
)
DRAKE = {  # of its examples: file, and the position servos that it is given
    "pendulum/Pendulum": "theta: {kp: 8.0, kv: 0.5}",
    "acrobot/Acrobot": "shoulder: {kp: 60.0, kv: 4.0}\nelbow: {kp: 40.0, kv: 3.0}",
}


class Model(NamedTuple):
    """One model of the zoo."""

    source: str
    name: str
    write: Callable[[Path], Path]  # into a folder; returns the file


def models() -> list[Model]:
    """Return all that can be had here: those of libraries that are not installed are left out."""
    return [*_gymnasium(), *_ours(), *_drake(), *_made()]


def _gymnasium() -> Iterator[Model]:
    place = find_spec("gymnasium")
    if place and place.origin:
        folder = Path(place.origin).parent / "envs" / "mujoco" / "assets"
        for name in GYMNASIUM:
            yield Model("Gymnasium", name, _copied(folder / f"{name}.xml"))


def _ours() -> Iterator[Model]:
    for name in OURS:
        yield Model("sim2real", Path(name).name, _copied(ASSETS / f"{name}.xml"))


def _drake() -> Iterator[Model]:
    place = find_spec("pydrake")
    if place and place.origin:
        folder = Path(place.origin).parent / "share" / "drake" / "examples"
        for name, servos in DRAKE.items():
            if (file := folder / f"{name}.urdf").is_file():
                yield Model("Drake", Path(name).name, _with_servos(file, servos))


def _made() -> Iterator[Model]:
    for name, (joints, actuators, rest) in PARTS.items():
        yield Model("hand-made", name, _written(name, joints, actuators, rest))


def _copied(file: Path) -> Callable[[Path], Path]:
    """Return what writes a model whose actuators have names, as logs need them."""

    def write(folder: Path) -> Path:
        spec = load_spec(file)
        for number, actuator in enumerate(spec.actuators):
            actuator.name = actuator.name or actuator.target or f"actuator{number}"
        spec.compile()
        path = folder / file.name
        path.write_text(spec.to_xml(), encoding="utf-8")
        return path

    return write


def _with_servos(file: Path, servos: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = Path(shutil.copy(file, folder / file.name))
        path.with_name(f"{path.stem}.actuators.yaml").write_text(servos, encoding="utf-8")
        return path

    return write


HEAD = """
<mujoco model="{name}">
  <option timestep="0.002" integrator="implicitfast"/>
  <default><geom type="capsule" size="0.02" contype="0" conaffinity="0"/></default>
  <worldbody>{bodies}</worldbody>
  {rest}
  <actuator>{actuators}</actuator>
</mujoco>"""
LINK = '<body name="{name}" pos="{place}">{joint}<geom {geom}/>{inside}</body>'
BAR = 'fromto="0 0 0 0 0 -0.3"'


def hinge(name: str, more: str = "") -> str:
    """Return a hinge about y."""
    return f'<joint name="{name}" axis="0 1 0" damping="0.05" armature="0.01" {more}/>'


def chain(first: str, second: str, geoms: tuple[str, str] = (BAR, BAR), inside: str = "") -> str:
    """Return two bodies, one hanging from the other."""
    low = LINK.format(name="low", place="0 0 -0.3", joint=second, geom=geoms[1], inside=inside)
    return LINK.format(name="high", place="0 0 1", joint=first, geom=geoms[0], inside=low)


TWO = chain(hinge("a"), hinge("b"))
SECOND = '<position name="b" joint="b" kp="12" kv="0.6"/>'
FIRST = '<position name="a" joint="a" kp="20" kv="1"/>'
SERVOS = FIRST + SECOND
MOTORS = '<motor name="a" joint="a"/><motor name="b" joint="b"/>'
SLIDE = '<joint name="b" type="slide" axis="0 0 1" damping="4" range="-0.2 0.2"/>'
BALL = LINK.format(
    name="tail",
    place="0 0 -0.3",
    joint='<joint name="c" type="ball" damping="0.05"/>',
    geom=BAR,
    inside="",
)
SITE, POST = '<site name="tip" pos="0 0 -0.3"/>', '<site name="post" pos="0.3 0 0.5"/>'
LOOP = """<body name="rod" pos="0.2 0 0.7"><joint name="c" axis="0 1 0" damping="0.05"/>
  <geom fromto="0 0 0 -0.2 0 0"/></body>"""
LOOSE = """<body name="loose" pos="0 0 0.3"><freejoint name="root"/>
  <geom type="sphere" size="0.05"/></body>"""
FIXED = """<tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="-0.5"/></fixed>
  </tendon>"""
SPATIAL = """<tendon><spatial name="t" stiffness="20" damping="1"><site site="post"/>
  <site site="tip"/></spatial></tendon>"""
MESH = """<asset><mesh name="wedge"
  vertex="0 0 0  0.04 0 0  0 0.04 0  0 0 -0.3  0.03 0 -0.3  0 0.03 -0.3"/></asset>"""
SPEEDS = '<velocity name="a" joint="a" kv="4"/><velocity name="b" joint="b" kv="3"/>'
INTEGRATED = '<intvelocity name="a" joint="a" kp="20" kv="1" actrange="-1 1"/>'
MUSCLE = '<muscle name="a" joint="a" lengthrange="-1 1"/>'
DAMPER = '<damper name="d" joint="b" kv="0.5" ctrlrange="0 1"/>'
PUSH = '<general name="push" site="tip" gear="1 0 0 0 0 0"/>'
COUPLED = '<equality><joint joint1="b" joint2="a" polycoef="0 0.5 0 0 0"/></equality>'
CLOSED = '<equality><connect body1="low" body2="rod" anchor="0 0 0"/></equality>'
WELDED = '<equality><weld body1="low" body2="tail"/></equality>'
BLOCK = 'size="0.03 0.02 0.15" pos="0 0 -0.15"'


def two(more: str = "", geom: str = BAR, inside: str = "") -> str:
    """Return two hinges, the second with attributes of its own."""
    return chain(hinge("a"), hinge("b", more), (geom, geom), inside)


PARTS: dict[str, tuple[str, str, str]] = {  # name: bodies, actuators, the rest
    "joint_slide": (chain(hinge("a"), SLIDE), FIRST + SECOND.replace("12", "400"), ""),
    "joint_ball": (two(inside=BALL), SERVOS, ""),
    "joint_free": (TWO + LOOSE, SERVOS, ""),
    "joint_limited": (two('range="-20 20" limited="true"'), SERVOS, ""),
    "joint_spring": (two('stiffness="3" springref="20"'), SERVOS, ""),
    "geom_box": (two(geom=f'type="box" {BLOCK}'), SERVOS, ""),
    "geom_cylinder": (two(geom=f'type="cylinder" {BAR}'), SERVOS, ""),
    "geom_ellipsoid": (two(geom=f'type="ellipsoid" {BLOCK}'), SERVOS, ""),
    "geom_mesh": (two(geom='type="mesh" mesh="wedge"'), SERVOS, MESH),
    "actuator_motor": (TWO, MOTORS, ""),
    "actuator_velocity": (TWO, SPEEDS, ""),
    "actuator_intvelocity": (TWO, INTEGRATED + SECOND, ""),
    "actuator_filtered": (TWO, SERVOS.replace("/>", ' timeconst="0.03"/>'), ""),
    "actuator_geared": (TWO, SERVOS.replace('joint="a"', 'joint="a" gear="2"'), ""),
    "actuator_muscle": (TWO, MUSCLE + SECOND, ""),
    "actuator_damper": (TWO, SERVOS + DAMPER, ""),
    "actuator_site": (two(inside=SITE), SERVOS + PUSH, ""),
    "equality_joint": (TWO, FIRST, COUPLED),
    "equality_connect": (TWO + LOOP, SERVOS, CLOSED),
    "equality_weld": (two(inside=BALL), SERVOS, WELDED),
    "tendon_fixed": (TWO, SERVOS + '<motor name="t" tendon="t"/>', FIXED),
    "tendon_spatial": (POST + two(inside=SITE), SERVOS, SPATIAL),
}


def _written(name: str, bodies: str, actuators: str, rest: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / f"{name}.xml"
        text = HEAD.format(name=name, bodies=bodies, rest=rest, actuators=actuators)
        mujoco.MjModel.from_xml_string(text)
        path.write_text(text, encoding="utf-8")
        return path

    return write
