"""Models of many constructs, each diagnosed against its own log: there is no gap.

`SIM2REAL_MODELS` names a folder of further models (a zoo of MJCF and URDF files), which are asked
as well.
"""

import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.models import load_spec
from envs.plant import Plant
from hardware.log import read_log
from sim2real.diagnosis.data.replay import measure
from sim2real.diagnosis.diagnose import diagnose
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis.own_log import COUNT, own_log

ZOO = os.environ.get("SIM2REAL_MODELS")
SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
PART = 0.1  # of a range that commands of a zoo's models go to either side
ARM = """<mujoco>{options}<worldbody>
<body name="upper"><joint name="a" axis="0 1 0" armature="0.01" damping="0.1" {joint}/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass="0.3"/>{more}</body>
</worldbody>{rest}<actuator>{actuators}</actuator></mujoco>"""
LOWER = """<body name="lower" pos="0 0 -.2"><joint name="b" axis="0 1 0" armature="0.01"
damping="0.1"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass="0.2"/></body>"""
SERVO = '<position joint="a" kp="8" kv="0.3" forcerange="-3 3"/>'
FINE = '<option timestep="0.002" integrator="implicitfast"/>'
FILTER = 'gainprm="8" biastype="affine" biasprm="0 -8 -0.3"'
MODELS: dict[str, tuple[dict[str, str], float]] = {  # parts of the arm, size of the commands
    "unnamed position servo": ({}, 0.8),
    "motor with a gear": ({"actuators": '<motor joint="a" gear="2"/>'}, 0.3),
    "integrated velocity": (
        {"actuators": '<intvelocity joint="a" kp="8" kv="0.3" actrange="-1.5 1.5"/>'},
        2.0,
    ),
    "slow exact filter": (
        {"actuators": f'<general joint="a" dyntype="filterexact" dynprm="0.3" {FILTER}/>'},
        0.8,
    ),
    "filter": ({"actuators": f'<general joint="a" dyntype="filter" dynprm="0.1" {FILTER}/>'}, 0.8),
    "servo with a time constant": (
        {"actuators": '<position joint="a" kp="8" kv="0.3" timeconst="0.05"/>'},
        0.8,
    ),
    "servo with a damping ratio": (
        {"actuators": '<position joint="a" kp="8" dampratio="1"/>'},
        0.8,
    ),
    "velocity servo": ({"actuators": '<velocity joint="a" kv="0.5"/>'}, 2.0),
    "dry friction": ({"joint": 'frictionloss="0.05"'}, 0.8),
    "spring": ({"joint": 'stiffness="2" springref="20"'}, 0.8),
    "range in degrees": ({"joint": 'range="-30 30" limited="true"'}, 0.9),
    "two joints": (
        {"more": LOWER, "actuators": SERVO + '<position joint="b" kp="6" kv="0.2"/>'},
        0.6,
    ),
    "joint that nothing drives": ({"more": LOWER.replace('"0.1"', '"0.02"')}, 0.4),
    "two links that swing freely": (  # half a count at a start is a radian within a second
        {
            "options": '<option timestep="0.005" integrator="RK4"/>',
            "more": LOWER.replace('"0.1"', '"0"').replace('"0.01"', '"0"'),
            "joint": 'ref="0"',
            "actuators": '<motor joint="a" gear="2"/>',
        },
        0.5,
    ),
    "coupled joints": (
        {
            "more": LOWER,
            "rest": '<equality><joint joint1="b" joint2="a" polycoef="0 1 0 0 0"/></equality>',
        },
        0.4,
    ),
    "slide": ({"joint": 'type="slide"', "actuators": '<position joint="a" kp="50" kv="5"/>'}, 0.3),
    "wheel": (
        {"more": '<geom type="cylinder" size=".05 .02" euler="90 0 0" mass="0.5"/>'},
        0.8,
    ),
    "explicit Euler": ({"options": '<option timestep="0.001"/>'}, 0.8),
    "motor in coarse steps": (
        {"options": '<option timestep="0.02"/>', "actuators": '<motor joint="a"/>'},
        0.5,
    ),
    "push at a site": (  # whose number is that of no joint
        {
            "more": '<site name="s"/><site name="m"/><site name="tip" pos="0 0 -.2"/>',
            "actuators": '<general site="tip" gear="1 0 0 0 0 0"/>',
        },
        0.2,
    ),
    "slide that stays, among hinges": (
        {
            "rest": '<worldbody><body pos="1 0 0"><joint name="b" type="slide" axis="1 0 0" '
            'damping="500"/><geom size=".05" mass="5"/></body></worldbody>',
            "actuators": f'{SERVO}<motor name="b" joint="b" gear="0.1"/>',
        },
        0.5,
    ),
    "keyframe": ({"rest": '<keyframe><key name="home" qpos="0.4" ctrl="0.4"/></keyframe>'}, 0.6),
    "mesh that is not there": (
        {
            "options": f'{FINE}<asset><mesh name="shell" file="shell.stl"/></asset>',
            "more": '<geom type="mesh" mesh="shell" contype="0" conaffinity="0" mass="0"/>',
        },
        0.8,
    ),
}


def write(folder: Path, parts: dict[str, str]) -> Path:
    """Write the arm with some of its parts changed."""
    usual = {"options": FINE, "joint": "", "more": "", "rest": "", "actuators": SERVO}
    path = folder / "model.xml"
    path.write_text(ARM.format(**(usual | parts)), encoding="utf-8")
    return path


SOONER = "push at a site"  # each diagnosis takes about 10 s


def at_leisure(name: str) -> Any:
    """Return a model as a parameter; all but one wait for the long suite."""
    return pytest.param(name, marks=() if name == SOONER else pytest.mark.slow)


@pytest.mark.parametrize("name", [at_leisure(name) for name in MODELS])
def test_a_models_own_log_has_no_gap(name: str, tmp_path: Path) -> None:
    """Replayed whole it is off by a count; in windows that start anywhere nothing is missing."""
    parts, size = MODELS[name]
    path = write(tmp_path, parts)
    log = own_log(path, size)
    errors = measure(log, load_spec(path)).errors()
    assert max(error["rmse"] for error in errors.values()) < COUNT
    assert diagnose(log, path).verdict == "no_gap"


@pytest.mark.slow
@pytest.mark.parametrize("every", [2, 3])
def test_readings_that_come_less_often_than_commands_have_no_gap(every: int, tmp_path) -> None:
    """Rows between them count in no comparison, and nothing between readings is taken for one."""
    path = write(tmp_path, {})
    log = own_log(path, 0.8)
    lines = ["episode,time,ctrl.a,qpos.a"]
    for row, (time, sent, read) in enumerate(
        zip(log.time, log.column("ctrl.a"), log.column("qpos.a"), strict=True)
    ):
        lines.append(f"0,{time},{sent},{read if row % every == 0 else ''}")
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    assert diagnose(read_log(tmp_path / "log.csv"), path).verdict == "no_gap"


@pytest.mark.parametrize(
    ("actuator", "kind"),
    [('<muscle joint="a" lengthrange="0.1 1"/>', "muscle")],
)
def test_a_state_that_no_log_tells_is_refused(actuator: str, kind: str, tmp_path: Path) -> None:
    """By the actuator's name, with what to give instead."""
    path = write(tmp_path, {"actuators": actuator})
    log = own_log(path, 0.5)
    with pytest.raises(Sim2RealError, match=rf"actuator 'a' has a state \({kind}\).*<position>"):
        diagnose(log, path)


def test_a_body_centred_on_its_joint_can_be_loaded(tmp_path: Path) -> None:
    """The engine's short cut for such bodies is not taken where an effect moves their mass."""
    disc = ARM.replace('type="capsule" fromto="0 0 0 0 0 -.2" size=".02"', 'size=".05"')
    text = disc.format(
        options=FINE, joint="", more='<site pos="0 0 -.1"/>', rest="", actuators=SERVO
    )
    spec = mujoco.MjSpec.from_string(text)
    assert spec.copy().compile().body_simple[1]
    for effect, value in (("payload", 0.3), ("center_of_mass", 0.05), ("link_length", 1.2)):
        plant = Plant(spec, [make(effect, where="upper")], num_rows=1)
        row, rest = np.zeros(1, int), np.zeros((1, 1))
        plant.set_params(row, np.array([[value]]))
        plant.reset(row, rest + 0.3, rest, np.zeros(1, np.uint64))
        assert not plant.step(None, rest, 100).any()


def zoo() -> list[Path]:
    """Return the models of the zoo, and what else is written as they are."""
    return sorted(p for end in ("xml", "urdf") for p in Path(ZOO).rglob(f"*.{end}")) if ZOO else []


def sizes(model: mujoco.MjModel) -> np.ndarray:
    """Return how far each actuator's command goes from its middle, (nu,): a part of its range."""
    span = np.ptp(model.actuator_ctrlrange, axis=1)
    return PART * np.where(model.actuator_ctrllimited, span, 1.0)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.skipif(not ZOO, reason="SIM2REAL_MODELS names no folder of models")
@pytest.mark.parametrize("path", zoo(), ids=str)
def test_every_model_of_a_zoo_agrees_with_its_own_log(path: Path) -> None:
    """Or is refused in a sentence, which `pytest -rs` shows: parts of models, and loose bases."""
    try:
        model = load_spec(path).compile()
        if not model.nu or not np.isin(model.jnt_type, SCALAR).any():
            pytest.skip("no actuator, or no hinge and no slide")
        found = diagnose(own_log(path, sizes(model)), path)
    except (ValueError, Sim2RealError) as refused:
        pytest.skip(" ".join(str(refused).split()))
    assert found.verdict == "no_gap"
