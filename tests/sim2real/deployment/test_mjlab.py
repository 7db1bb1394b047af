"""Effects as terms of mjlab: they set what the plant has, and the rest is refused by name."""

import ast
import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.models import load_spec
from envs.plant import Fixed, Plant
from envs.tasks.servo.base import ASSETS
from sim2real.deployment.mjlab import event_terms
from sim2real.runs.errors import Sim2RealError

BENCH = ASSETS / "bench1.xml"
SAID: list[Fixed] = [
    (make("coulomb_friction", where="hinge"), (0.03,)),
    (make("viscous_friction", where="hinge"), (0.01,)),
    (make("armature", where="hinge"), (0.002,)),
    (make("position_gain", where="hinge"), (0.8,)),
    (make("torque_limit", where="hinge"), (0.3,)),
    (make("link_mass", where="arm"), (0.05,)),
    (make("encoder_offset", where="hinge"), (0.02,)),
]
FREE = (int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL))
FIELDS = {
    "joint_friction": "dof_frictionloss",
    "joint_damping": "dof_damping",
    "joint_armature": "dof_armature",
    "body_mass": "body_mass",
}


def terms(text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return what a module of terms says, read with stand-ins for mjlab's classes."""
    for name in ("envs", "envs.mdp", "managers", "managers.event_manager"):
        monkeypatch.setitem(sys.modules, f"mjlab.{name}", ModuleType(name))
    mdp, manager = (sys.modules[f"mjlab.{n}"] for n in ("envs.mdp", "managers.event_manager"))
    config = ModuleType("config")
    monkeypatch.setitem(sys.modules, "mjlab", ModuleType("mjlab"))
    monkeypatch.setitem(sys.modules, "mjlab.managers.scene_entity_config", config)
    mdp.dr = SimpleNamespace(  # type: ignore[attr-defined]
        **{n: n for n in (*FIELDS, "pd_gains", "effort_limits", "encoder_bias")}
    )
    manager.EventTermCfg = SimpleNamespace  # type: ignore[attr-defined]
    config.SceneEntityCfg = lambda name, **chosen: (name, chosen)  # type: ignore[attr-defined]
    (folder / "events.py").write_text(text)
    return runpy.run_path(str(folder / "events.py"))["events"]("robot")


def test_terms_set_what_the_plant_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each value is the one of the plant's field, at its place."""
    spec = load_spec(BENCH)
    found = terms(event_terms(spec, SAID, "bench1.xml"), tmp_path, monkeypatch)
    plant = Plant(spec, fixed=SAID)
    row = np.zeros(1, int)
    for function, field in FIELDS.items():
        term = found[f"{function}.{'arm' if field == 'body_mass' else 'hinge'}"]
        place = plant.nominal.body("arm").id if field == "body_mass" else 0
        value = plant.field_values(field, row)[0][place]
        assert term.params["ranges"] == pytest.approx((value, value), rel=1e-8)
        assert term.params["operation"] == "abs" and term.mode == "startup"
    gains, limit = found["pd_gains.hinge"].params, found["effort_limits.hinge"].params
    assert gains["kp_range"][0] == pytest.approx(0.8 * plant.nominal.actuator_gainprm[0, 0])
    assert gains["kd_range"][0] == pytest.approx(-plant.nominal.actuator_biasprm[0, 2])
    assert limit["effort_limit_range"] == (0.3, 0.3)
    assert found["encoder_bias.hinge"].params["bias_range"] == (0.02, 0.02)
    assert found["body_mass.arm"].params["asset_cfg"] == ("robot", {"body_names": ("arm",)})
    assert len(found) == len(SAID)


def test_vectors_name_their_axes() -> None:
    """A sliding friction leaves torsion and rolling as they are."""
    spec = load_spec(ASSETS / "quad8.xml")
    text = event_terms(spec, [(make("ground_friction"), (0.7,))])
    model = spec.copy().compile()
    found = [t for t in re.findall(r'"ranges": ({.*})', text)]
    assert found and len(found) == len(re.findall("geom_friction", text)) / 2
    for one in found:
        axes = ast.literal_eval(one)
        assert axes[0] == (0.7, 0.7)
        assert any(axes[1][0] == pytest.approx(f) for f in model.geom_friction[:, 1])


@pytest.mark.parametrize(
    ("name", "where", "value", "reason"),
    [
        ("backlash", "hinge", 0.03, "it adds a joint, which to=mjcf does"),
        ("stribeck_friction", "hinge", 0.02, "MJCF has no friction that depends on the speed"),
        ("command_delay", None, 0.01, "no term sets actuator_delay"),
        ("payload", "arm", 0.1, "no term sets .*body_inertia"),
        ("sensor_noise", "hinge", 0.01, "it changes what is read"),
    ],
)
def test_what_no_term_says_is_refused_by_name(name: str, where: str | None, value, reason) -> None:
    """All of the refused are named, with the reason."""
    effects = [*SAID, (make(name, where=where), (value,)), (make("gravity_tilt"), (0.1, 0.0))]
    label = name if where is None else rf"{name}\.{where}"
    with pytest.raises(Sim2RealError, match=rf"mjlab cannot say {label} \({reason}.*gravity_tilt"):
        event_terms(load_spec(BENCH), effects)


def test_an_actuator_without_a_limit_is_refused() -> None:
    """A range that the engine ignores is no limit."""
    spec = load_spec(BENCH)
    for actuator in spec.actuators:
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE
    with pytest.raises(Sim2RealError, match="no forcerange that a term could set"):
        event_terms(spec, [(make("torque_limit", where="hinge"), (0.3,))])


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("robot", "effects"),
    [
        (
            "arm2",
            [
                *[("coulomb_friction", "elbow", 0.03), ("viscous_friction", "shoulder", 0.002)],
                *[("position_gain", "elbow", 0.8), ("torque_limit", "shoulder", 0.3)],
                *[("link_mass", "forearm", 0.02), ("encoder_offset", "elbow", 0.02)],
            ],
        ),
        ("quad8", [("ground_friction", None, 0.7), ("armature", "knee_fr", 0.001)]),
    ],
)
def test_mjlab_has_what_the_plant_has(robot: str, effects, tmp_path) -> None:
    """In mjlab's own environment, on its MuJoCo: every field of every element, by its name."""
    own = Path(os.environ.get("SIM2REAL_MJLAB", Path(sys.prefix, "mjlab", "bin", "python")))
    if not own.is_file():
        pytest.skip("mjlab has no environment here: make test-long makes one")
    spec = load_spec(ASSETS / f"{robot}.xml")
    fixed = [(make(name, where=where), (value,)) for name, where, value in effects]
    (tmp_path / "events.py").write_text(event_terms(spec, fixed))
    script = Path(__file__).with_name("mjlab_fields.py")
    command = [str(own), str(script), str(ASSETS / f"{robot}.xml"), str(tmp_path / "events.py")]
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, env=clean, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    there = json.loads(done.stdout.splitlines()[-1])
    plant = Plant(spec, fixed=fixed)
    biases = {str(e.where): values[0] for e, values in fixed if e.name == "encoder_offset"}
    counts = {"joint": "njnt", "body": "nbody", "geom": "ngeom", "actuator": "nactuator"}
    for field, values in there.items():
        kind = "joint" if field.startswith(("dof", "encoder")) else field.split("_")[0]
        for number in range(getattr(plant.nominal, counts[kind])):
            element = getattr(plant.nominal, kind)(number)
            free = kind == "joint" and plant.nominal.jnt_type[number] in FREE
            if free or not element.name or element.name == "world":
                continue
            place = element.dofadr[0] if field.startswith("dof") else number
            if field == "encoder_bias":
                wanted = biases.get(element.name, 0.0)
            else:
                wanted = plant.field_values(field, np.zeros(1, int))[0][place]
            assert values[element.name] == pytest.approx(wanted, rel=1e-6), (field, element.name)
