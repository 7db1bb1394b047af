"""The null test tells the simulator's own faults from the robot's."""

import re

import mujoco
import numpy as np
import pytest

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.data.recording import to_recording
from sim2real.diagnosis.data.trial import trial
from sim2real.diagnosis.numerics import _words, better, is_numerics, null_test
from sim2real.diagnosis.settings import DEFAULT

ARM = """
<mujoco><option timestep="{dt}" integrator="implicitfast"/>
<worldbody><body><joint name="hinge" axis="0 1 0" armature="0.005" damping="0.02"
 frictionloss="{friction}" solimpfriction="{solimp}"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size=".01" mass="0.2"/></body></worldbody>
<actuator><position name="a" joint="hinge" kp="2" kv="0.1"/></actuator></mujoco>
"""
SOFT, STIFF = "0.9 0.95 0.001", "0.9999 0.9999 0.001"


def arm(friction: float = 0.0, solimp: str = SOFT, dt: float = 0.002) -> mujoco.MjSpec:
    """Return an arm that hangs out sideways."""
    return mujoco.MjSpec.from_string(ARM.format(friction=friction, solimp=solimp, dt=dt))


def log_of(spec: mujoco.MjSpec, effects: list) -> Log:
    """Return 10 s of steps that are held, as the model with the effects makes them."""
    time = np.arange(0, 10, 0.02)
    ctrl = 0.5 * np.sign(np.sin(2 * np.pi * time / 5)) * (time > 0.5)
    columns = {"episode": 0 * time, "time": time, "ctrl.a": ctrl, "qpos.hinge": 0 * time}
    recording = to_recording(Log(columns), spec.copy().compile())
    (path,) = trial(spec, [recording], fixed=effects)
    return Log({**columns, "qpos.hinge": path[:, 0]})


@pytest.mark.parametrize("changed", [0.5, 0.501, 0.499])
def test_a_gap_that_stays_is_not_called_larger(changed: float) -> None:
    """Numerics move the replay and leave the gap: no advice to put them into the model."""
    text = _words("a shorter time step", 0.5, changed, 0.8, DEFAULT.numerics)
    assert "the gap stays at 0.5" in text and "put that into the model" not in text
    assert "% larger" in _words("a shorter time step", 0.5, 0.9, 0.8, DEFAULT.numerics)


def test_a_gap_of_physics_is_ok() -> None:
    """A gain that is half the model's leaves the same gap under every change."""
    log = log_of(arm(), [(make("position_gain", where="a"), [0.5])])
    assert set(null_test([log], [arm()]).values()) == {"ok"}


def test_creeping_friction_is_numerics() -> None:
    """A robot whose friction holds against a model whose friction creeps: said, and mended."""
    log = log_of(arm(0.5, STIFF), [])
    words = null_test([log], [arm(0.5)])
    assert re.search(r'solimpfriction="[^"]*" the gap is (9\d|100)% smaller', words["friction"])
    friction = [(make("coulomb_friction", where="hinge"), [0.01])]  # and makes all of it stick
    word = is_numerics([log], [arm(0.5)], friction, words)
    assert word is not None
    assert "numerics, not the robot" in word


def test_a_real_cause_is_not_numerics() -> None:
    """A gain that is truly missing keeps its share when the friction no longer creeps."""
    gain = [(make("position_gain", where="a"), [0.5])]
    log = log_of(arm(0.1, STIFF), gain)
    words = null_test([log], [arm(0.1)])
    assert is_numerics([log], [arm(0.1)], gain, words) is None


def test_a_step_too_coarse_is_told() -> None:
    """A model whose timestep is far too large moves when it is halved."""
    log = log_of(arm(dt=0.001), [])
    assert null_test([log], [arm(dt=0.02)])["timestep"] != "ok"


@pytest.mark.parametrize("name", ["timestep", "solver", "friction"])
def test_changes_leave_the_model_as_given(name: str) -> None:
    """A changed copy compiles, and the original stays what it was."""
    spec = arm(0.1)
    spec.actuators[0].delay, spec.actuators[0].nsample = 0.004, 3
    text = spec.to_xml()
    better(spec, (name,)).compile()
    assert spec.to_xml() == text


def test_armature_is_only_numerics_where_the_step_is_too_long_without_it() -> None:
    """A light link without armature is told apart from one whose inertia is right."""
    bare = mujoco.MjSpec.from_string(ARM.format(friction=0, solimp=SOFT, dt=0.002))
    bare.joints[0].armature = 0.0
    log = log_of(bare, [(make("position_gain", where="a"), [0.8])])
    assert null_test([log], [bare])["armature"] == "ok"


def test_a_log_at_rest_has_no_numerics() -> None:
    """Nothing moves, nothing is divided by."""
    time = np.arange(0, 5, 0.02)
    columns = {"episode": 0 * time, "time": time, "ctrl.a": 0 * time, "qpos.hinge": 0 * time}
    weightless = arm()
    weightless.option.gravity = np.zeros(3)
    assert set(null_test([Log(columns)], [weightless]).values()) == {"ok"}
