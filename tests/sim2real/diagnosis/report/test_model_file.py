"""model.xml: it moves as the model with effects.yaml does, and says what it leaves out."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import EFFECTS, Effect, FieldEffect, make
from envs.plant import Plant
from envs.replay import Recording, replay, switchable
from sim2real.diagnosis.report import model_file

ASSETS = Path(model_file.__file__).parents[3] / "envs" / "assets"
CASES: list[tuple[str, dict[str, Any], tuple[float, ...]]] = [
    ("coulomb_friction", {"where": "hinge"}, (0.03,)),
    ("viscous_friction", {"where": "hinge"}, (0.01,)), ("armature", {"where": "hinge"}, (0.002,)),
    ("backlash", {"where": "hinge", "side": "motor"}, (0.05,)),
    ("joint_compliance", {"where": "hinge", "side": "motor", "damping": 0.002}, (0.3,)),
    ("position_gain", {"where": "hinge"}, (0.5,)), ("motor_strength", {}, (0.7,)),
    ("torque_limit", {"where": "hinge"}, (0.2,)), ("supply_voltage", {}, (0.8,)),
    ("command_delay", {}, (0.0213,)), ("encoder_offset", {"where": "hinge"}, (0.1,)),
    ("link_mass", {"where": "arm"}, (0.05,)), ("center_of_mass", {"where": "arm"}, (-0.02,)),
    ("payload", {"where": "arm"}, (0.08,)), ("gravity_tilt", {}, (0.1, 0.2)),
]  # fmt: skip


def swing(model: mujoco.MjModel) -> Recording:
    """Return 2 s of steps and a sine for one joint, from rest at 0."""
    time = np.arange(0, 2.0, 0.02)
    goal = np.where(time < 1, 0.6, 0.4 * np.sin(2 * np.pi * 2 * time))
    goal[0] = 0.0
    return Recording(time, goal[:, None], np.zeros(model.nq), np.zeros(model.nv))


def moved(spec: mujoco.MjSpec, effects: Any = ()) -> np.ndarray:
    """Return where the joint goes, (T,) rad."""
    plant = Plant(switchable(spec), fixed=effects)
    return replay(plant, [swing(plant.nominal)])[0][:, 0]


@pytest.mark.parametrize(("name", "arguments", "values"), CASES, ids=[c[0] for c in CASES])
def test_replay_of_the_file_equals_replay_with_the_effect(
    name: str, arguments: dict[str, Any], values: tuple[float, ...], tmp_path: Path
) -> None:
    """The model as given with the effect, and the file alone, move alike; the effect is felt."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / "bench1.xml"))
    effects = [(make(name, **arguments), values)]
    left_out = model_file.write(spec, effects, tmp_path / "model.xml")
    alone = moved(mujoco.MjSpec.from_file(str(tmp_path / "model.xml")))
    expected = moved(spec, effects)
    assert left_out == {}
    assert np.abs(expected - moved(spec)).max() > 5e-3
    np.testing.assert_allclose(alone, expected, atol=2e-5)


def test_several_effects_compose(tmp_path: Path) -> None:
    """Effects on the same fields and on a joint's structure are in the file together."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / "bench1.xml"))
    effects = [
        (make("position_gain", where="hinge"), (0.8,)),
        (make("motor_strength"), (0.9,)),
        (make("coulomb_friction", where="hinge"), (0.02,)),
        (make("backlash", where="hinge", side="motor"), (0.03,)),
        (make("link_mass", where="arm"), (0.03,)),
    ]
    model_file.write(spec, effects, tmp_path / "model.xml")
    alone = moved(mujoco.MjSpec.from_file(str(tmp_path / "model.xml")))
    np.testing.assert_allclose(alone, moved(spec, effects), atol=5e-5)


@pytest.mark.parametrize("name", ["backlash", "joint_compliance"])
def test_a_joint_without_play_stays_one_joint(name: str) -> None:
    """A play or spring of size 0, damped or not, adds nothing to the file."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / "bench1.xml"))
    free = ("damping",) if name == "joint_compliance" else ()
    changed = model_file.apply(spec, [(make(name, free=free), (0.0, 0.1)[: 1 + len(free)])])
    assert changed.to_xml() == spec.copy().to_xml()


@pytest.mark.parametrize(("name", "value"), [("backlash", 0.04), ("joint_compliance", 0.02)])
def test_a_loaded_joint_starts_where_its_load_leaves_it(name: str, value: float, tmp_path) -> None:
    """From home on, where gravity pulls, the file moves as the model with the effect does."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / "arm6.xml"))
    effects = [(make(name, where="shoulder", side="motor"), (value,))]
    model_file.write(spec, effects, tmp_path / "model.xml")
    written = mujoco.MjSpec.from_file(str(tmp_path / "model.xml"))

    def moved_from_home(one: mujoco.MjSpec, fixed: Any) -> np.ndarray:
        plant = Plant(switchable(one), fixed=fixed)
        key, time = plant.nominal.key("home"), np.arange(0, 1.0, 0.02)
        goal = np.array(key.ctrl) + 0.3 * np.sin(2 * np.pi * time)[:, None]
        start = Recording(time, goal, np.array(key.qpos), np.zeros(plant.nominal.nv))
        path = replay(plant, [start])[0]
        joints = ("base", "shoulder", "elbow", "wrist")
        return path[:, [int(plant.nominal.joint(name).qposadr[0]) for name in joints]]

    given, alone = moved_from_home(spec, effects), moved_from_home(written, [])
    assert np.abs(given - moved_from_home(spec, [])).max() > 2e-3
    np.testing.assert_allclose(alone, given, atol=2e-4)


def test_what_mjcf_cannot_say_is_listed_with_its_reason(tmp_path: Path) -> None:
    """Such effects are returned and stand in a comment; the rest is still written."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / "bench1.xml"))
    effects = [
        (make("stribeck_friction", where="hinge"), (0.02,)),
        (make("backlash", where="hinge", side="link"), (0.03,)),
        (make("viscous_friction", where="hinge"), (0.01,)),
    ]
    left_out = model_file.write(spec, effects, tmp_path / "model.xml")
    text = (tmp_path / "model.xml").read_text()
    assert set(left_out) == {"stribeck_friction.hinge", "backlash.hinge"}
    assert all(f"Only in effects.yaml: {label} (" in text for label in left_out)
    assert "In this file: viscous_friction.hinge = 0.01 N·m·s/rad" in text
    alone = moved(mujoco.MjSpec.from_file(str(tmp_path / "model.xml")))
    np.testing.assert_allclose(alone, moved(spec, effects[2:]), atol=2e-5)


def test_a_body_keeps_its_inertia_where_geoms_would_say_otherwise(tmp_path: Path) -> None:
    """Hopper's model takes inertia from geoms; the written mass counts nevertheless."""
    from envs import HopperPolito

    spec = HopperPolito(domain="source").spec()
    effect = make("link_mass", where="torso")
    model_file.write(spec, [(effect, (1.0,))], tmp_path / "model.xml")
    nominal = spec.copy().compile()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    change = model.body_mass - nominal.body_mass
    torso = model.body("torso").id
    assert change[torso] == pytest.approx(1.0, abs=1e-5)
    assert np.delete(change, torso) == pytest.approx(0.0, abs=1e-5)
    np.testing.assert_allclose(model.body_inertia, nominal.body_inertia, rtol=1e-4)


def test_contacts_are_written(tmp_path: Path) -> None:
    """Friction and stiffness of the contact reach foot and floor."""
    from envs import HopperPolito

    spec = HopperPolito(domain="source").spec()
    effects = [(make("ground_friction"), (0.7,)), (make("contact_stiffness"), (0.25,))]
    model_file.write(spec, effects, tmp_path / "model.xml")
    nominal = spec.copy().compile()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    for geom in ("foot_geom", "floor"):
        assert model.geom(geom).friction[0] == pytest.approx(0.7)
        expected = nominal.geom(geom).solref[0] * 2
        assert model.geom(geom).solref[0] == pytest.approx(expected, rel=1e-5)


def test_every_effect_is_said_or_has_a_reason() -> None:
    """No class leaves open whether MJCF can say it, and every plain field has its element."""
    known = (*model_file.FIELDS, *model_file.INERTIA)
    for kind in EFFECTS.values():
        assert kind.no_mjcf != Effect.no_mjcf
        assert not issubclass(kind, FieldEffect) or kind.field in known


def test_meshes_are_found_from_another_folder(tmp_path: Path) -> None:
    """A model that reads files of its folder is written elsewhere and still loads."""
    home, away = tmp_path / "home" / "shapes", tmp_path / "away"
    home.mkdir(parents=True)
    away.mkdir()
    corners = ["0 0 0", "0.1 0 0", "0 0.1 0", "0 0 0.1"]
    faces = ["1 3 2", "1 2 4", "1 4 3", "2 3 4"]
    lines = [*(f"v {c}" for c in corners), *(f"f {f}" for f in faces)]
    (home / "part.obj").write_text("\n".join(lines))
    (tmp_path / "home" / "arm.xml").write_text(
        '<mujoco><compiler meshdir="shapes"/><asset><mesh name="part" file="part.obj"/></asset>'
        '<worldbody><body name="arm"><joint name="hinge"/><geom type="mesh" mesh="part"/></body>'
        "</worldbody></mujoco>"
    )
    spec = mujoco.MjSpec.from_file(str(tmp_path / "home" / "arm.xml"))
    effects = [(make("viscous_friction", where="hinge"), (0.01,))]
    model_file.write(spec, effects, away / "model.xml")
    model = mujoco.MjModel.from_xml_path(str(away / "model.xml"))
    assert model.dof_damping[0] == pytest.approx(0.01)
