"""Joints that move and that a log does not hold."""

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.preflight.checks import check_unlogged
from tests.sim2real.diagnosis import arm

CART = """
<mujoco><option timestep="0.002"/>
<worldbody><body pos="0 0 {height}">{base}<geom type="box" size=".1 .1 .05" mass="1"/>
<body pos="0 0 .05"><joint name="hip" axis="0 1 0" armature="0.01" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass="0.2"/></body></body>
<geom type="plane" size="5 5 .1"/></worldbody>
<actuator><position name="hip" joint="hip" kp="5" kv="0.2"/></actuator></mujoco>
"""


def checked(base: str, height: float, **columns: float) -> list[tuple[str, str | None, str]]:
    """Return what is found on a log of the hip alone, but for further columns."""
    time = np.arange(300) * 0.01
    own = {"episode": 0 * time, "time": time, "ctrl.hip": 0.5 * np.sin(5 * time)}
    more = {name.replace("__", "."): np.full(300, value) for name, value in columns.items()}
    log = Log({**own, "qpos.hip": 0.4 * np.sin(5 * time), **more})
    spec = mujoco.MjSpec.from_string(CART.format(base=base, height=height))
    pairs = 2 * [(log, spec.copy().compile())]
    return [(f.check, f.where, f.finding) for f in check_unlogged(pairs, [spec, spec])]


def test_a_base_that_falls_and_is_not_logged_is_named_once() -> None:
    """With its columns, for all logs together."""
    ((check, where, text),) = checked('<freejoint name="root"/>', 1.0)
    assert (check, where) == ("unlogged", "root")
    assert "`qpos.root.0` to `qpos.root.6` are not logged" in text
    assert "moves root by 0.9" in text


def test_a_pose_of_which_a_part_is_missing_is_named() -> None:
    """An IMU says how a base is turned, and not where it is."""
    quaternion = {f"qpos__root__{k}": float(k == 3) for k in range(3, 7)}
    ((_, _, text),) = checked('<freejoint name="root"/>', 1.0, **quaternion)
    assert "`qpos.root.0` to `qpos.root.2` are not logged" in text


@pytest.mark.parametrize(
    ("base", "height", "columns"),
    [
        ("", 1.0, {}),
        ('<joint name="lift" type="slide" axis="0 0 1"/>', 0.05, {}),
        ('<joint name="lift" type="slide" axis="0 0 1"/>', 1.0, {"qpos__lift": 0.0}),
    ],
    ids=["fixed base", "rests on the ground", "is logged"],
)
def test_nothing_is_said_of_what_rests_or_is_logged(base: str, height: float, columns) -> None:
    """A joint without a motor is none of the log's business until it moves."""
    assert checked(base, height, **columns) == []


def test_a_slide_that_falls_is_named() -> None:
    """Any joint, not bases alone."""
    ((_, where, text),) = checked('<joint name="lift" type="slide" axis="0 0 1"/>', 1.0)
    assert where == "lift"
    assert "`qpos.lift` is not logged" in text


def test_a_joint_that_a_coupling_leads_needs_no_encoder() -> None:
    """Its position follows from the logged ones; a joint that moves by itself is still named."""
    led, free = (
        f'<body pos="0 {y} 1"><joint name="{name}" axis="0 1 0" damping="0.01"/>'
        '<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass="0.2"/></body>'
        for y, name in ((1, "led"), (2, "free"))
    )
    gear = '<equality><joint joint1="led" joint2="hip" polycoef="0 -2 0 0 0"/></equality>'
    text = CART.format(base="", height=1.0).replace(
        '<geom type="plane"', f'{led}{free}<geom type="plane"', 1
    )
    spec = mujoco.MjSpec.from_string(text.replace("<actuator>", f"{gear}<actuator>"))
    time = np.arange(300) * 0.01
    own = {"episode": 0 * time, "time": time, "ctrl.hip": 0.5 * np.sin(5 * time)}
    log = Log({**own, "qpos.hip": 0.4 * np.sin(5 * time)})
    assert [f.where for f in check_unlogged([(log, spec.copy().compile())], [spec])] == ["free"]


def test_the_arm_is_whole() -> None:
    """Every joint of it is logged."""
    pairs = [(arm.make_log(seconds=4.0), arm.spec().compile())]
    assert check_unlogged(pairs, [arm.spec()]) == []
