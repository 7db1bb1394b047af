"""A robot's model from its file: MJCF, or URDF with its actuators in a few lines of YAML.

    spec = load_spec(Path("arm.urdf"))      # and arm.actuators.yaml next to it

    # arm.actuators.yaml: position servos, as MJCF's <position> has them
    shoulder: {joint: shoulder_pan, kp: 20.0, kv: 0.6, forcerange: [-1.5, 1.5]}
    elbow: {kp: 12.0}                       # joint: of the same name
    wrist: {type: motor, forcerange: [-1, 1]}   # takes torques [N·m]

URDF says nothing of servos, so a URDF without that file is refused. Its meshes are optional: masses
and inertias come from `<inertial>`, and a mesh that is not there is left out; so is one of an MJCF
that is only looked at.
"""

import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from envs.errors import TaskError, did_you_mean

POSITION, MOTOR = TYPES = ("position", "motor")  # of actuators
WORLD = "world"
PART = "Unrecognized XML model type"  # what the engine says of a file whose root is not <mujoco>
KEYS = (
    "joint",
    "type",
    "kp",
    "kv",
    "forcerange",
    "ctrlrange",
    "armature",
    "frictionloss",
    "damping",
)
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
WIDTH = {FREE: (7, 6), BALL: (4, 3)}  # numbers in qpos and qvel of a joint; else 1 and 1
MARKER = 1e-5  # kg: a link that weighs less is a frame, whatever its inertia says
FLAT = 1e-4  # of a body's largest moment of inertia: the least, such as that of a rod about itself
NO_INERTIA = 1e-15  # kg·m²
PRODUCTS = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
COMPILER = {"fusestatic": "false", "discardvisual": "true", "balanceinertia": "true"}


def load_spec(path: str | Path) -> mujoco.MjSpec:
    """Read a model; see `named` for what has no name.

    Args:
        path: an MJCF or, by its ending, a URDF.

    Raises:
        TaskError: a file that is missing or damaged, or a URDF without actuators.
    """
    path = Path(path).expanduser()
    if not path.is_file():
        raise TaskError(f"{path}: no such model")
    try:
        if path.suffix.lower() == ".urdf":
            return _urdf(path)
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        if isinstance(error, TaskError):
            raise
        words = " ".join(str(error).split())
        part = PART in words and "; it is a part that other files include: give the whole model"
        raise TaskError(f"{path}: the model cannot be read: {words}{part or ''}") from None
    _leave_out_pictures(spec, path)
    return named(spec)


def _leave_out_pictures(spec: mujoco.MjSpec, path: Path) -> None:
    """Leave out meshes and textures that are not there, where they are only looked at.

    Raises:
        TaskError: a missing mesh that touches things, or gives a body its mass.
    """
    lost = {m.name or Path(m.file).stem: m for m in spec.meshes if _is_lost(m.file, spec, path)}
    for geom in spec.geoms if lost else ():
        if geom.meshname not in lost:
            continue
        body = geom.parent
        weighs = not body.explicitinertial and geom.mass != 0 and geom.density != 0
        weighs &= body.name != WORLD  # nothing moves it
        if geom.contype or geom.conaffinity or weighs:
            what = "gives the body its mass" if weighs else "touches other bodies"
            raise TaskError(
                f"{path}: the mesh {lost[geom.meshname].file!r} is missing, and its geom "
                f"{what} ({body.name!r}); put the file there, or give the geom another type"
            )
    for geom in [g for g in spec.geoms if g.meshname in lost]:
        spec.delete(geom)
    for mesh in lost.values():
        spec.delete(mesh)
    gone = [t for t in spec.textures if t.file and _is_lost(t.file, spec, path, spec.texturedir)]
    for texture in gone:
        for material in spec.materials:
            material.textures = ["" if t == texture.name else t for t in material.textures]
        spec.delete(texture)


def _is_lost(name: str, spec: mujoco.MjSpec, path: Path, folder: str | None = None) -> bool:
    """Return whether a model names a file that is not there."""
    file = Path(spec.meshdir if folder is None else folder) / name
    return bool(name) and not (path.parent / file).is_file()


def columns_of(model: mujoco.MjModel, joint: int) -> tuple[list[str], list[str]]:
    """Return how columns name the numbers of a joint, without `qpos.` and `qvel.`."""
    name, width = model.joint(joint).name, WIDTH.get(int(model.jnt_type[joint]))
    if width is None:
        return [name], [name]
    positions, speeds = ([f"{name}.{k}" for k in range(size)] for size in width)
    return positions, speeds


def named(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Name unnamed joints after their bodies and actuators after what they drive; return the spec.

    Logs need names. A joint of an unnamed body is named by its number.
    """
    joints = {joint.name for joint in spec.joints}
    for number, joint in enumerate(spec.joints):
        name = joint.parent.name or f"joint{number}"
        if not joint.name and name not in joints:
            joint.name = name
            joints.add(name)
    taken = {actuator.name for actuator in spec.actuators}
    for actuator in spec.actuators:
        if not actuator.name and actuator.target not in taken:
            actuator.name = actuator.target
            taken.add(actuator.target)
    return spec


def _urdf(path: Path) -> mujoco.MjSpec:
    text = path.read_text(encoding="utf-8")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise TaskError(f"{path}: cannot be read as XML: {error}") from None
    if root.tag != "robot":
        raise TaskError(f"{path}: expected the root <robot> of a URDF, got <{root.tag}>")
    _check_links(root, path, text)
    for link in root.iter("link"):
        _round_inertia(link, path, text)
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if shape.tag == "visual" or (mesh is not None and not _mesh(path, mesh)):
                link.remove(shape)
    extension = root.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    compiler.attrib.update({**COMPILER, **compiler.attrib, "meshdir": str(path.parent)})
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    _add_actuators(spec, path)
    return spec


def _check_links(root: ElementTree.Element, path: Path, text: str) -> None:
    """Declare the link `world` if joints hang on it; refuse other undeclared links."""
    links = [link.get("name", "") for link in root.iter("link")]
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            element = joint.find(end)
            name = "" if element is None else element.get("link", "")
            if end == "parent" and name == WORLD and WORLD not in links:
                ElementTree.SubElement(root, "link", {"name": WORLD})
                links.append(WORLD)
            if name not in links:
                line = _line(text, rf"<{end}\s[^>]*link\s*=\s*[\"']{re.escape(name)}[\"']")
                raise TaskError(
                    f"{path}{line}: the joint {joint.get('name')!r} has the {end} {name!r}, which "
                    f"is not a link{did_you_mean(name, links)}; add <link name={name!r}/>"
                )


def _round_inertia(link: ElementTree.Element, path: Path, text: str) -> None:
    """Give a link's inertia moments that are positive, where rounding or a placeholder left none.

    Raises:
        TaskError: the inertia of something heavier that no body can have.
    """
    inertia, mass = link.find("inertial/inertia"), link.find("inertial/mass")
    if inertia is None or mass is None:
        return
    matrix = np.zeros((3, 3))
    try:
        for axes, (row, column) in PRODUCTS.items():
            matrix[row, column] = matrix[column, row] = float(inertia.get(f"i{axes}", 0))
        weight = float(mass.get("value", 0))
    except ValueError:
        return  # the engine says which
    moments, turned = np.linalg.eigh(matrix)
    least = FLAT * float(np.abs(moments).max())
    if moments[0] > 0:
        return
    none = float(np.abs(moments).max()) < NO_INERTIA
    if moments[0] < -least and weight > MARKER and not none:
        name = link.get("name", "")
        line = _line(text, rf"<link\s[^>]*name\s*=\s*[\"']{re.escape(name)}[\"']")
        raise TaskError(
            f"{path}{line}: no body has the inertia of the link {name!r}: its principal moments "
            f"are {', '.join(f'{m:.3g}' for m in moments)} kg·m², and all must be positive; look "
            "for a wrong sign, or for products (ixy, ixz, iyz) about another point"
        )
    own = turned @ np.diag(np.maximum(moments, least) * (not none)) @ turned.T
    for axes, place in PRODUCTS.items():
        inertia.set(f"i{axes}", repr(float(own[place])))


def _line(text: str, pattern: str) -> str:
    """Return ", line 7": the first one of a text that a pattern fits; "" where there is none."""
    found = re.search(pattern, text)
    return f", line {text.count(chr(10), 0, found.start()) + 1}" if found else ""


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
            f"{path}: a URDF has no actuators; write {file.name} next to it, a line for each "
            "servo: `elbow: {kp: 12.0, forcerange: [-1.5, 1.5]}`"
        )
    text = file.read_text(encoding="utf-8")
    try:
        table: Any = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise TaskError(f"{file}: cannot be read as YAML: {error}") from None
    if not isinstance(table, dict) or not table:
        raise TaskError(f"{file}: expected a table of actuators by name")
    joints = {joint.name: joint for joint in spec.joints}
    for name, given in table.items():
        line = _line(text, rf"(?m)^\s*[\"']?{re.escape(str(name))}[\"']?\s*:")
        _add_servo(spec, joints, str(name), {} if given is None else given, f"{file}{line}")


def _add_servo(
    spec: mujoco.MjSpec, joints: dict[str, Any], name: str, given: Any, file: str
) -> None:
    place = f"{file}, {name!r}"
    if not isinstance(given, dict):
        raise TaskError(f"{place}: {given!r} must be a table, such as {{kp: 12.0}}")
    wrong = [key for key in given if key not in KEYS]
    if wrong:
        hint = did_you_mean(wrong[0], KEYS)
        raise TaskError(f"{place}: unknown key {wrong[0]!r}{hint}")
    joint = str(given.get("joint", name))
    if joint not in joints:
        hint = did_you_mean(joint, joints)
        there = ", ".join(joints)
        raise TaskError(f"{place}: no joint {joint!r}{hint}; choose one of: {there}")
    kind = given.get("type", POSITION)
    if kind not in TYPES:
        raise TaskError(f"{place}: type={kind!r}{did_you_mean(str(kind), TYPES)}; {TYPES}")
    if kind == MOTOR and ("kp" in given or "kv" in given):
        raise TaskError(f"{place}: a motor takes torques and has no gains; remove kp and kv")
    if kind == POSITION and "kp" not in given:
        raise TaskError(
            f"{place}: `kp` [N·m/rad] is missing; for a torque motor, give `type: motor`"
        )
    for field in ("armature", "frictionloss", "damping"):
        if field in given:
            value = _number(given[field], place, field)
            # damping has coefficients of three powers of the speed
            setattr(joints[joint], field, [value, 0.0, 0.0] if field == "damping" else value)
    actuator = spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    if kind == MOTOR:
        actuator.set_to_motor()
    else:
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
