"""Logs that a diagnosis cannot use."""

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.runs.errors import Sim2RealError

WALKER = """
<mujoco><option timestep="0.002"/>
<worldbody><body name="torso" pos="0 0 1">{base}<geom type="box" size=".1 .1 .05" mass="1"/>
<body pos="0 0 .05"><joint name="hip" axis="0 1 0" armature="0.01" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass="0.2"/></body></body>
<body name="ball" pos="1 0 0"><freejoint name="toy"/><geom size=".1"/></body>
<geom type="plane" size="5 5 .1"/></worldbody>
<actuator><position name="hip" joint="hip" kp="5" kv="0.2"/></actuator></mujoco>
"""


def cut(folder: Path, base: str, **columns: float) -> Data:
    """Return the windows of a log of the hip, and of further columns."""
    path = folder / "walker.xml"
    path.write_text(WALKER.format(base=base), encoding="utf-8")
    time = np.arange(600) * 0.01
    own = {"episode": 0 * time, "time": time, "ctrl.hip": 0.5 * np.sin(5 * time)}
    more = {name.replace("__", "."): np.full(600, value) for name, value in columns.items()}
    return Data.of([Log({**own, "qpos.hip": 0.4 * np.sin(5 * time), **more})], path)


def test_a_free_base_without_its_pose_is_refused(tmp_path: Path) -> None:
    """By its name, or its body's; what is free and carries no joint does not matter."""
    with pytest.raises(Sim2RealError, match=r"base 'root' is free, and `qpos.root.0` is not"):
        cut(tmp_path, '<freejoint name="root"/>')
    with pytest.raises(Sim2RealError, match=r"`qpos.root.6` is not logged"):
        cut(tmp_path, '<freejoint name="root"/>', **{f"qpos__root__{k}": 0.5 for k in range(6)})
    pose = {f"qpos__root__{k}": 0.5 for k in range(7)}
    assert cut(tmp_path, '<freejoint name="root"/>', **pose).windows
    assert cut(tmp_path, "").windows
