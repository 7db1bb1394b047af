"""`model.xml`: the model with the effects that a diagnosis found, where MJCF can say them.

    left_out = write(spec, load_effects("effects.yaml"), "model.xml")

A comment at its top lists the effects that are in the file, and those that only `effects.yaml` can
carry, each with the reason. Numbers have the six digits of MuJoCo's writer. What the effects did
not change stays as it was.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from envs.effects import Effect, FieldEffect
from envs.effects.layout import compile_structure
from envs.effects.structure import SeriesEffect
from envs.plant import Fixed, Plant
from sim2real.runs.files import write_text


def write(spec: mujoco.MjSpec, effects: Sequence[Fixed], path: str | Path) -> dict[str, str]:
    """Write the model with the effects atomically.

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
    reasons = [(effect, mjcf_limitation(effect)) for effect, _ in effects]
    left_out = {effect.label(): reason for effect, reason in reasons if reason is not None}
    said = [one for one, (_, reason) in zip(effects, reasons, strict=True) if reason is None]
    changed = apply(spec, said)
    _absolute_folders(changed)
    changed.comment = _comment(said, left_out, spec.comment)
    write_text(path, changed.to_xml())
    return left_out


def mjcf_limitation(effect: Effect) -> str | None:
    """Return why MJCF cannot say an effect; None where it can."""
    reason = effect.mjcf_limitation()
    if isinstance(effect, FieldEffect) and effect.field not in (*FIELDS, *INERTIA, GRAVITY):
        return reason or f"no MJCF element is known that holds {effect.field}"
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
    for name, (kind, attribute) in FIELDS.items():
        new, old = plant.batch.expanded(name), getattr(model, name)
        if new is not None:
            # of dofs one row each: a joint's first speaks for all of them
            rows = model.jnt_dofadr if name.startswith("dof_") else range(len(old))
            for element, row in zip(_elements(changed, kind), rows, strict=True):
                if not np.array_equal(old[row], new[0][row]):
                    _put(element, attribute, new[0][row])
    _inertias(changed, model, plant)
    tilt = plant.batch.expanded(GRAVITY)
    if tilt is not None:
        changed.option.gravity = tilt[0]
    if plant.layout.joints:
        _settle(changed, nominal, plant)
    for effect, values in own:
        effect.to_mjcf(changed, model, values)
    return changed


def _elements(spec: mujoco.MjSpec, kind: str) -> list[Any]:
    return sorted(getattr(spec, kind), key=lambda element: element.id)  # numbered by the compiler


def _put(element: Any, attribute: str, value: np.ndarray) -> None:
    """Write a row of a model's field; an attribute may have further numbers, which stay."""
    own = np.array(getattr(element, attribute), dtype=np.float64)
    own.flat[: np.size(value)] = value
    setattr(element, attribute, own[()])
    if attribute == "ctrlrange":
        element.inheritrange = 0.0


# The fields that effects write, but those of inertia: whose they are, and where they belong there.
FIELDS = {
    "dof_frictionloss": ("joints", "frictionloss"),
    "dof_solimp": ("joints", "solimp_friction"),
    "dof_solref": ("joints", "solref_friction"),
    "dof_damping": ("joints", "damping"),
    "dof_armature": ("joints", "armature"),
    "jnt_range": ("joints", "range"),
    "jnt_stiffness": ("joints", "stiffness"),
    "actuator_gainprm": ("actuators", "gainprm"),
    "actuator_biasprm": ("actuators", "biasprm"),
    "actuator_forcerange": ("actuators", "forcerange"),
    "actuator_ctrlrange": ("actuators", "ctrlrange"),
    "actuator_damping": ("actuators", "damping"),
    "actuator_delay": ("actuators", "delay"),
    "geom_friction": ("geoms", "friction"),
    "geom_solref": ("geoms", "solref"),
    "geom_solmix": ("geoms", "solmix"),
}
GRAVITY = "opt.gravity"
INERTIA = ("body_mass", "body_ipos", "body_iquat", "body_inertia")


def _inertias(spec: mujoco.MjSpec, model: mujoco.MjModel, plant: Plant) -> None:
    """Write masses, their centres and inertias where they differ from the model's."""
    new = {name: plant.batch.expanded(name) for name in INERTIA}
    now = {n: getattr(model, n) if v is None else v[0] for n, v in new.items()}
    if all(np.array_equal(now[n], getattr(model, n)) for n in INERTIA):
        return
    for i, body in enumerate(_elements(spec, "bodies")):
        if i and now["body_mass"][i] > 0:
            body.explicitinertial = True
            for name, values in now.items():
                setattr(body, name.removeprefix("body_"), values[i])
    auto = 2  # inertiafromgeom: geoms count where a body says nothing
    spec.compiler.inertiafromgeom = auto  # else the compiler replaces or scales what is written
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
