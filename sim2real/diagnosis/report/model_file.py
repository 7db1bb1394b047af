"""`model.xml`: the model with the effects that a diagnosis found, where MJCF can say them.

    left_out = write(spec, load_effects("effects.yaml"), "model.xml")

A comment at its top lists the effects that are in the file, and those that only `effects.yaml` can
carry, each with the reason. Numbers have the six digits of MuJoCo's writer. What the effects did
not change stays as it was.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from envs.effects import Effect, FieldEffect
from envs.effects.layout import compile_structure
from envs.effects.structure import SeriesEffect
from envs.plant import Fixed, Plant
from sim2real.runs.files import write_text

Put = Callable[[Any, np.ndarray], None]  # writes a row of a model's field into an element of a spec


def write(spec: mujoco.MjSpec, effects: Sequence[Fixed], path: str | Path) -> dict[str, str]:
    """Write the model with the effects, whole or not at all.

    Args:
        spec: the model as given; it is copied, not changed.
        effects: each with its values, as `load_effects` returns them.
        path: the MJCF.

    Returns:
        The effects that are not in the file, by label, with the reason.

    Raises:
        EffectError: an effect that the robot cannot have.
        ParameterError: a value outside its range.
        OSError: the file cannot be written.
    """
    left_out = {e.label(): reason for e, _ in effects if (reason := mjcf_limitation(e)) is not None}
    said = [(e, values) for e, values in effects if mjcf_limitation(e) is None]
    changed = apply(spec, said)
    _absolute_folders(changed)
    changed.comment = _comment(said, left_out, spec.comment)
    write_text(path, changed.to_xml())
    return left_out


def mjcf_limitation(effect: Effect) -> str | None:
    """Return why MJCF cannot say an effect; None where it can."""
    reason = effect.mjcf_limitation()
    if reason is None and isinstance(effect, FieldEffect):
        known = effect.field in (*FIELDS, *INERTIA, GRAVITY)
        return None if known else f"no MJCF element is known that holds {effect.field}"
    return reason


def apply(spec: mujoco.MjSpec, effects: Sequence[Fixed]) -> mujoco.MjSpec:
    """Return a copy of the spec with effects that MJCF can say written into its elements."""
    # a play or spring of size 0 is absent, and its joint would be free
    effects = [(e, v) for e, v in effects if v[0] or not isinstance(e, SeriesEffect)]
    own = [(e, values) for e, values in effects if e.own_mjcf]
    plain = [(e, values) for e, values in effects if not e.own_mjcf]
    plant = Plant(spec, num_rows=1, fixed=plain)
    nominal, changed = spec.copy().compile(), spec.copy()
    for effect, _ in plain:
        effect.edit(changed)
    model, _ = compile_structure(changed, nominal)
    for name, (elements, put) in FIELDS.items():
        new = plant.batch.expanded(name)
        if new is not None:
            for element, row in zip(elements(changed), _rows(name, model), strict=True):
                if not np.array_equal(row[1], new[0][row[0]]):
                    put(element, new[0][row[0]])
    _inertias(changed, model, plant)
    tilt = plant.batch.expanded(GRAVITY)
    if tilt is not None:
        changed.option.gravity = tilt[0]
    if plant.layout.joints:
        _settle(changed, nominal, plant)
    for effect, values in own:
        effect.to_mjcf(changed, model, values)
    return changed


def _rows(name: str, model: mujoco.MjModel) -> list[tuple[Any, np.ndarray]]:
    """Return index and value of each element's part of a model's field, in the elements' order."""
    values = getattr(model, name)
    if name.startswith("dof_"):  # one row a dof: a joint's first speaks for all of them
        return [(int(i), values[i]) for i in model.jnt_dofadr]
    return list(enumerate(values))


def _joints(spec: mujoco.MjSpec) -> list[Any]:
    return sorted(spec.joints, key=lambda joint: joint.id)  # numbered by the compiler


def _actuators(spec: mujoco.MjSpec) -> list[Any]:
    return sorted(spec.actuators, key=lambda actuator: actuator.id)


def _geoms(spec: mujoco.MjSpec) -> list[Any]:
    return sorted(spec.geoms, key=lambda geom: geom.id)


def _bodies(spec: mujoco.MjSpec) -> list[Any]:
    return sorted(spec.bodies, key=lambda body: body.id)


def _set(attribute: str) -> Put:
    return lambda element, value: setattr(element, attribute, value)


def _set_first(attribute: str) -> Put:
    def put(element: Any, value: np.ndarray) -> None:
        own = np.array(getattr(element, attribute), dtype=np.float64)
        own[: np.size(value)] = value
        setattr(element, attribute, own)

    return put


def _set_control_range(actuator: Any, value: np.ndarray) -> None:
    actuator.ctrlrange, actuator.inheritrange = value, 0.0


# The fields that effects write, but those of inertia: whose they are, and where they belong there.
FIELDS: dict[str, tuple[Callable[[mujoco.MjSpec], Iterable[Any]], Put]] = {
    "dof_frictionloss": (_joints, _set("frictionloss")),
    "dof_solimp": (_joints, _set("solimp_friction")),
    "dof_solref": (_joints, _set("solref_friction")),
    "dof_damping": (_joints, _set_first("damping")),
    "dof_armature": (_joints, _set("armature")),
    "jnt_range": (_joints, _set("range")),
    "jnt_stiffness": (_joints, _set_first("stiffness")),
    "actuator_gainprm": (_actuators, _set("gainprm")),
    "actuator_biasprm": (_actuators, _set("biasprm")),
    "actuator_forcerange": (_actuators, _set("forcerange")),
    "actuator_ctrlrange": (_actuators, _set_control_range),
    "actuator_damping": (_actuators, _set_first("damping")),
    "actuator_delay": (_actuators, _set("delay")),
    "geom_friction": (_geoms, _set("friction")),
    "geom_solref": (_geoms, _set("solref")),
    "geom_solmix": (_geoms, _set("solmix")),
}
GRAVITY = "opt.gravity"
INERTIA = {
    "body_mass": "mass",
    "body_ipos": "ipos",
    "body_iquat": "iquat",
    "body_inertia": "inertia",
}


def _inertias(spec: mujoco.MjSpec, model: mujoco.MjModel, plant: Plant) -> None:
    """Write masses, their centres and inertias where they differ from the model's."""
    new = {name: plant.batch.expanded(name) for name in INERTIA}
    now = {n: getattr(model, n) if v is None else v[0] for n, v in new.items()}
    if all(np.array_equal(now[n], getattr(model, n)) for n in INERTIA):
        return
    _free_inertias(spec)
    for i, body in enumerate(_bodies(spec)):
        if i and now["body_mass"][i] > 0:
            body.explicitinertial = True
            for name, attribute in INERTIA.items():
                setattr(body, attribute, now[name][i])


def _free_inertias(spec: mujoco.MjSpec) -> None:
    """Keep the compiler from replacing or scaling what is written."""
    auto = 2  # inertiafromgeom: geoms count where a body says nothing
    spec.compiler.inertiafromgeom = auto
    spec.compiler.settotalmass = -1.0
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    spec.compiler.balanceinertia = False


def _settle(spec: mujoco.MjSpec, nominal: mujoco.MjModel, plant: Plant) -> None:
    """Let keyframes begin with plays and springs where the load leaves them."""
    row, rest, seed = np.zeros(1, int), np.zeros((1, nominal.nv)), np.zeros(1, np.uint64)
    for number, key in enumerate(spec.keys):
        plant.reset(row, nominal.key_qpos[[number]], rest, seed, measured=True)
        key.qpos = plant.layout.raw_qpos[0]


def _absolute_folders(spec: mujoco.MjSpec) -> None:
    """Let the file find meshes and textures from wherever it is."""
    home = Path(spec.modelfiledir or ".").resolve()
    if spec.meshes or spec.hfields or spec.skins:
        spec.meshdir = str(home / (spec.meshdir or ""))
    if spec.textures:
        spec.texturedir = str(home / (spec.texturedir or ""))


def _comment(said: Sequence[Fixed], left_out: dict[str, str], former: str) -> str:
    """Return what the file says about itself, as text that may stand in an XML comment."""
    lines = ["The model with the effects that a diagnosis found."]
    for effect, values in said:
        numbers = ", ".join(f"{value:.6g}" for value in values)
        lines.append(f"In this file: {effect.label()} = {numbers} {effect.unit}".rstrip())
    for label, reason in left_out.items():
        lines.append(f"Only in effects.yaml: {label} ({reason})")
    if not left_out:
        lines.append("Nothing is left out; effects.yaml has the same content.")
    text = "\n".join(f"       {line}" for line in lines).strip()
    rest = f"\n\n      {former.strip()}" if former.strip() else ""
    return f" {text}{rest} ".replace("--", "- -")
