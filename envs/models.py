"""A robot's model from its file: MJCF, or URDF with its actuators in a few lines of YAML.

    spec = load_spec(Path("arm.urdf"))      # and arm.actuators.yaml beside it

    # arm.actuators.yaml: position servos, as MJCF's <position> has them
    shoulder: {joint: shoulder_pan, kp: 20.0, kv: 0.6, forcerange: [-1.5, 1.5]}
    elbow: {kp: 12.0}                       # joint: of the same name

URDF says nothing of servos, so a URDF without that file is refused. Its meshes are optional: masses
and inertias come from `<inertial>`, and a mesh that is not there is left out.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import mujoco
import yaml

from envs.errors import TaskError, did_you_mean

KEYS = ("joint", "kp", "kv", "forcerange", "ctrlrange", "armature", "frictionloss", "damping")
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
WIDTH = {FREE: (7, 6), BALL: (4, 3)}  # numbers in qpos and qvel of a joint; else 1 and 1
COMPILER = {"fusestatic": "false", "discardvisual": "true", "balanceinertia": "true"}


def load_spec(path: str | Path) -> mujoco.MjSpec:
    """Read a model.

    Args:
        path: an MJCF or, by its ending, a URDF.

    Raises:
        TaskError: a file that is missing or damaged, or a URDF without actuators.
    """
    path = Path(path).expanduser()
    if not path.is_file():
        raise TaskError(f"{path}: there is no such model")
    try:
        if path.suffix.lower() == ".urdf":
            return _urdf(path)
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        if isinstance(error, TaskError):
            raise
        raise TaskError(f"{path}: the model cannot be read: {error}") from None


def columns_of(model: mujoco.MjModel, joint: int) -> tuple[list[str], list[str]]:
    """Return how columns name the numbers of a joint, without `qpos.` and `qvel.`."""
    name, width = model.joint(joint).name, WIDTH.get(int(model.jnt_type[joint]))
    if width is None:
        return [name], [name]
    positions, speeds = ([f"{name}.{k}" for k in range(size)] for size in width)
    return positions, speeds


def named(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return the spec, its unnamed actuators called as what they drive: a log needs names."""
    for actuator in spec.actuators:
        actuator.name = actuator.name or actuator.target
    return spec


def _urdf(path: Path) -> mujoco.MjSpec:
    try:
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    except ElementTree.ParseError as error:
        raise TaskError(f"{path}: this cannot be read as XML: {error}") from None
    if root.tag != "robot":
        raise TaskError(f"{path}: a URDF's root is <robot>, this file's is <{root.tag}>")
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if shape.tag == "visual" or (mesh is not None and not _mesh(path, mesh)):
                link.remove(shape)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(extension, "compiler", {**COMPILER, "meshdir": str(path.parent)})
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    _add_actuators(spec, path)
    return spec


def _mesh(path: Path, mesh: ElementTree.Element) -> bool:
    """Point a mesh at its file, relative to the URDF; return whether the file is there."""
    name = mesh.get("filename", "")
    for prefix in ("package://", "file://"):
        name = name.removeprefix(prefix)
    places = [path.parent / name, *(p / name for p in path.resolve().parents[:3])]
    found = next((place for place in places if place.is_file()), None)
    if found is not None:
        mesh.set("filename", str(found.resolve()))
    return found is not None and found.suffix.lower() in (".stl", ".obj")


def _add_actuators(spec: mujoco.MjSpec, path: Path) -> None:
    file = path.with_name(f"{path.stem}.actuators.yaml")
    if not file.is_file():
        raise TaskError(
            f"{path}: a URDF has no actuators; write {file.name} beside it, a line for each servo: "
            "`elbow: {kp: 12.0, forcerange: [-1.5, 1.5]}`"
        )
    try:
        table: Any = yaml.safe_load(file.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise TaskError(f"{file}: this cannot be read as YAML: {error}") from None
    if not isinstance(table, dict) or not table:
        raise TaskError(f"{file}: a table of actuators is needed, by name")
    joints = {joint.name: joint for joint in spec.joints}
    for name, given in table.items():
        _add_servo(spec, joints, str(name), {} if given is None else given, file)


def _add_servo(
    spec: mujoco.MjSpec, joints: dict[str, Any], name: str, given: Any, file: Path
) -> None:
    place = f"{file}, {name!r}"
    if not isinstance(given, dict):
        raise TaskError(f"{place}: {given!r} must be a table, such as {{kp: 12.0}}")
    wrong = [key for key in given if key not in KEYS]
    if wrong:
        hint = did_you_mean(wrong[0], KEYS)
        raise TaskError(f"{place}: there is no key {wrong[0]!r}{hint}")
    joint = str(given.get("joint", name))
    if joint not in joints:
        hint = did_you_mean(joint, joints)
        there = ", ".join(joints)
        raise TaskError(f"{place}: no joint {joint!r}{hint}; there are: {there}")
    if "kp" not in given:
        raise TaskError(f"{place}: `kp` is needed [N·m/rad]")
    for field in ("armature", "frictionloss", "damping"):
        if field in given:
            setattr(joints[joint], field, _number(given[field], place, field))
    actuator = spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    kp, kv = (_number(given.get(field, 0.0), place, field) for field in ("kp", "kv"))
    actuator.set_to_position(kp=kp, kv=kv)
    for field in ("forcerange", "ctrlrange"):
        if field in given:
            setattr(actuator, field, _range(given[field], place, field))


def _number(value: Any, place: str, field: str) -> float:
    """Return a finite number of 0 or more, or raise TaskError."""
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not 0.0 <= value < math.inf:
        raise TaskError(f"{place}: {field}={value!r} must be a number of 0 or more")
    return float(value)


def _range(value: Any, place: str, field: str) -> list[float]:
    """Return two numbers, the smaller first, or raise TaskError."""
    pair = value if isinstance(value, list) and len(value) == 2 else []
    if not all(isinstance(end, int | float) and math.isfinite(end) for end in pair) or not (
        pair and pair[0] < pair[1]
    ):
        raise TaskError(
            f"{place}: {field}={value!r} must be two numbers, the smaller first: [-2.0, 2.0]"
        )
    return [float(end) for end in pair]
