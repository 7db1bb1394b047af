"""Effects as event terms of mjlab, which set the fields that they change.

    text = event_terms(spec, load_effects("effects.yaml"))     # a Python module
    cfg.events |= events("robot")                               # what mjlab does with it

A term of mjlab's `dr` changes a field of a model that is there: what adds a joint, acts between
steps or reads a sensor is refused by name, and so is a field for which there is no term. Values are
absolute, of the model that was diagnosed: ranges of zero width, to be widened at will.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS

from envs.effects import Effect, EncoderOffset
from envs.plant import Fixed, Plant
from sim2real.runs.errors import Sim2RealError

FIELDS = {  # of a model: the term that sets each, and what it is of
    "dof_frictionloss": ("joint_friction", "joint"),
    "dof_damping": ("joint_damping", "joint"),
    "dof_armature": ("joint_armature", "joint"),
    "jnt_stiffness": ("joint_stiffness", "joint"),
    "body_mass": ("body_mass", "body"),
    "body_ipos": ("body_com_offset", "body"),
    "geom_friction": ("geom_friction", "geom"),
}
LAW = ("actuator_gainprm", "actuator_biasprm")
LIMIT = "actuator_forcerange"
CREEP = ("dof_solimp", "dof_solref")  # how hard friction holds, which no term sets
PAGE = '''"""Effects that were found on {model}, as event terms of mjlab 1.6.

    cfg.events |= events("robot")       # the entity's name

{said}

Where a term names an actuator, the entity must have one XmlActuatorCfg(target_names_expr=(joint,))
for each of the model's actuators, in their order.{creep}
"""

from mjlab.envs.mdp import dr
from mjlab.managers.event_manager import EventTermCfg
from mjlab.managers.scene_entity_config import SceneEntityCfg


def events(entity):
    """Return the terms for the entity of that name."""
    return {{
{terms}
    }}
'''
CREEPS = """
The terms set how large dry friction is, not how hard it holds: at rest it creeps as MuJoCo's
default does, by 1.4 degrees in 10 s under three quarters of its torque. to=mjcf writes one that
sticks."""


class Term(NamedTuple):
    """One call of a function of mjlab's `dr`."""

    function: str  # its name
    kind: str  # what it is done to: `joint`, `body`, `geom` or `actuator`
    where: str  # its name
    arguments: dict[str, str]  # as text

    def text(self) -> str:
        """Return the entry of the dictionary of terms."""
        asset = f'SceneEntityCfg(entity, {self.kind}_names=("{re.escape(self.where)}",))'
        given = [*self.arguments.items(), ("asset_cfg", asset)]
        lines = [
            f'"{self.function}.{self.where}": EventTermCfg(',
            '    mode="startup",',
            f"    func=dr.{self.function},",
            "    params={",
            *(f'        "{name}": {value},' for name, value in given),
            "    },",
            "),",
        ]
        return "\n".join(" " * 8 + line for line in lines)


def event_terms(spec: mujoco.MjSpec, effects: Sequence[Fixed], model: str = "the model") -> str:
    """Return a Python module whose `events` gives the terms.

    Args:
        spec: the model as given.
        effects: each with its values, as `load_effects` returns them.
        model: its name, for people.

    Raises:
        Sim2RealError: effects that no term can say, all of them, each with the reason.
        EffectError: an effect that the robot cannot have.
        ParameterError: a value outside its range.
    """
    nominal = spec.copy().compile()
    refused = {e.label(): why for e, v in effects if (why := limitation(spec, nominal, e, v))}
    if refused:
        raise refusal("mjlab", refused)
    biases = [(e, values[0]) for e, values in effects if isinstance(e, EncoderOffset)]
    terms = [*_terms(nominal, Plant(spec, fixed=effects)), *_offsets(nominal, biases)]
    said = [f"{e.label()} = {', '.join(f'{v:.6g}' for v in vs)} {e.unit}" for e, vs in effects]
    creeps = any(t.function == "joint_friction" for t in terms)
    return PAGE.format(
        model=model,
        said="\n".join(line.rstrip() for line in said),
        creep=CREEPS if creeps else "",
        terms="\n".join(term.text() for term in terms),
    )


def refusal(target: str, refused: dict[str, str]) -> Sim2RealError:
    """Return the error for effects that a target cannot say, by label with the reason."""
    each = "; ".join(f"{label} ({reason})" for label, reason in refused.items())
    return Sim2RealError(
        f"to={target} cannot say {each}; take them out of the effects, which changes what the "
        "others are worth, or simulate here"
    )


def limitation(
    spec: mujoco.MjSpec, nominal: mujoco.MjModel, effect: Effect, values: Sequence[float]
) -> str | None:
    """Return why no term can say an effect; None where one can."""
    if (reason := effect.mjcf_limitation()) is not None or isinstance(effect, EncoderOffset):
        return reason
    plant = Plant(spec, fixed=[(effect, values)])
    if plant.model.nq != nominal.nq:
        return "it adds a joint, which to=mjcf does"
    known = {*FIELDS, *LAW, LIMIT, *CREEP}
    changed = [n for n in MODEL_FIELDS if plant.is_field_written(n) and n not in known]
    if changed:
        return f"no term sets {' or '.join(changed)}"
    if not nominal.actuator_forcelimited[_changed(LIMIT, nominal, plant)].all():
        return "the model's actuator has no forcerange that a term could set"
    try:
        _terms(nominal, plant)
    except ValueError as error:
        return str(error)
    return None


def _changed(name: str, nominal: mujoco.MjModel, plant: Plant) -> np.ndarray:
    """Return the elements in which a field of the plant is not the model's own, (k,)."""
    own, now = getattr(nominal, name), plant.field_values(name, np.zeros(1, int))[0]
    return np.flatnonzero((own != now).reshape(len(own), -1).any(axis=1))


def _terms(nominal: mujoco.MjModel, plant: Plant) -> list[Term]:
    """Return the terms that set what the plant's model has otherwise.

    Raises:
        ValueError: a value that no term can set.
    """
    return [*_fields(nominal, plant), *_laws(nominal, plant)]


def _fields(nominal: mujoco.MjModel, plant: Plant) -> Iterator[Term]:
    """Yield a term for each element of a plain field that changed."""
    for field, (function, kind) in FIELDS.items():
        now = plant.field_values(field, np.zeros(1, int))[0]
        for i in _changed(field, nominal, plant):
            element = int(nominal.dof_jntid[i]) if field.startswith("dof_") else int(i)
            where = _name(nominal, kind, element)
            yield Term(function, kind, where, {"ranges": _ranges(now[i]), "operation": '"abs"'})


def _laws(nominal: mujoco.MjModel, plant: Plant) -> Iterator[Term]:
    """Yield the terms of actuators: gains and limits of position servos."""
    row = np.zeros(1, int)
    gain, bias, ends = (plant.field_values(n, row)[0] for n in (*LAW, LIMIT))
    changed = np.union1d(*(_changed(n, nominal, plant) for n in LAW))
    limited = _changed(LIMIT, nominal, plant)
    for i in np.union1d(changed, limited).astype(int):
        where = _name(nominal, "actuator", i)
        if nominal.actuator_biasprm[i, 1] >= 0:
            raise ValueError("mjlab's terms support position servos only")
        if i in changed:
            if bias[i, 0] or not np.isclose(gain[i, 0], -bias[i, 1]):
                raise ValueError("no term can set a servo with different gain and position bias")
            given = {"kp_range": _range(gain[i, 0]), "kd_range": _range(-bias[i, 2])}
            yield Term("pd_gains", "actuator", where, {**given, "operation": '"abs"'})
        if i in limited:
            if not np.isclose(ends[i, 0], -ends[i, 1]):
                raise ValueError("no term can set a limit that differs between directions")
            given = {"effort_limit_range": _range(ends[i, 1]), "operation": '"abs"'}
            yield Term("effort_limits", "actuator", where, given)


def _offsets(nominal: mujoco.MjModel, biases: Sequence[tuple[Effect, float]]) -> Iterator[Term]:
    """Yield the terms of encoders' zeros: mjlab's readings and goals have the same one, too."""
    driven = [nominal.joint(int(j)).name for j in np.unique(nominal.actuator_trnid[:, 0])]
    for effect, value in biases:
        for where in [effect.where] if effect.where else driven:
            yield Term("encoder_bias", "joint", where, {"bias_range": _range(value)})


def _name(model: mujoco.MjModel, kind: str, element: int) -> str:
    name = getattr(model, kind)(element).name
    if not name:
        raise ValueError(f"terms find a {kind} by name, but number {element} has none")
    return name


def _range(value: float) -> str:
    return f"({value + 0.0:.9g}, {value + 0.0:.9g})"  # + 0.0: no minus before a zero


def _ranges(value: Any) -> str:
    """Return one value, or those of a vector by their axes, as ranges of zero width."""
    if np.ndim(value) == 0:
        return _range(float(value))
    return "{" + ", ".join(f"{axis}: {_range(one)}" for axis, one in enumerate(value)) + "}"
