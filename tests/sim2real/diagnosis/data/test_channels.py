"""Channels beside the positions, as witnesses that nothing was fitted to."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.data.channels import channel_gaps, contradicting
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.evidence import ChannelGap
from tests.sim2real.diagnosis import arm

TEXT = arm.XML.replace(
    "</body>\n    </body>", '<site name="imu" pos="0 0 -.1" euler="20 0 30"/></body></body>'
).replace(
    "</mujoco>",
    '<sensor><gyro name="g" site="imu"/><accelerometer name="a" site="imu"/></sensor></mujoco>',
)
FRICTION, NOISES = 0.15, {"qvel": 0.01, "gyro": 0.02, "accelerometer": 0.1, "current": 0.01}


def recorded(folder: Path) -> Data:
    """Return the windows of a log with every channel, made by a loop over `mj_step`.

    The second joint has friction that the model lacks; a motor's current is its torque over 0.5.
    """
    (folder / "arm.xml").write_text(TEXT, encoding="utf-8")
    spec = mujoco.MjSpec.from_string(TEXT)
    spec.joint("b").frictionloss = FRICTION
    spec.joint("b").solimp_friction = (0.9999, 0.9999, 0.001, 0.5, 2.0)
    spec.joint("b").solref_friction = [2 * arm.STEP, 1.0]
    model, rng = spec.compile(), np.random.default_rng(0)
    data, time = mujoco.MjData(model), np.arange(500) * 0.02
    goals = 0.5 * np.sin(2 * np.pi * np.outer(time, (0.4, 0.7)) + (0.3, 1.0))
    rows = []
    for goal in goals:
        data.ctrl[:] = goal
        mujoco.mj_forward(model, data)
        torque = data.actuator_force - model.actuator_damping * data.qvel
        rows.append((*goal, *data.qpos, *data.qvel, *(torque / 0.5), *data.sensordata))
        mujoco.mj_step(model, data, 10)
    names = [f"{kind}.{n}" for kind in ("ctrl", "qpos", "qvel", "current") for n in "ab"]
    names += [f"{kind}.imu.{axis}" for kind in ("gyro", "accelerometer") for axis in "xyz"]
    columns = dict(zip(names, np.array(rows).T, strict=True))
    for name, values in columns.items():
        columns[name] = values + NOISES.get(name.partition(".")[0], 0.0) * rng.normal(size=500)
    log = Log({"episode": np.zeros(500), "time": time, **columns})
    return Data.of([log], folder / "arm.xml")


def test_every_channel_of_a_log_is_a_witness(tmp_path: Path) -> None:
    """With the hidden friction each is as far off as its noise; without it, further."""
    data = recorded(tmp_path)
    hidden = [(make("coulomb_friction", where="b"), (FRICTION,))]
    torque = {"a": "current.a", "b": "current.b"}
    gaps = {gap.column: gap for gap in channel_gaps(data, [], hidden, torque)}
    kinds = [name.partition(".")[0] for name in gaps]
    assert [kinds.count(kind) for kind in NOISES] == [2, 3, 3, 2]
    for name, gap in gaps.items():
        noise = NOISES[name.partition(".")[0]]
        assert gap.noise == pytest.approx(noise, rel=0.5), name
        assert gap.after < 4 * noise, name
    for name in ("qvel.b", "gyro.imu.y", "current.b"):
        assert gaps[name].before > 2 * gaps[name].after
    assert gaps["qvel.b"].unit == gaps["gyro.imu.x"].unit == "rad/s"
    assert list(contradicting(list(gaps.values()))) == []


def test_positions_alone_have_no_witness(tmp_path: Path) -> None:
    """Nothing is simulated for them."""
    assert channel_gaps(arm.data_of(arm.make_log(seconds=4.0), tmp_path), [], [], {}) == ()


def test_a_channel_that_gets_worse_contradicts() -> None:
    """By more than its noise."""
    worse = ChannelGap("qvel.b", "rad/s", 0.01, 0.1, 0.2)
    (found,) = contradicting([worse])
    assert (found.check, found.where) == ("witness", "b")
    assert "0.2 rad/s with them, 0.1 without" in found.finding
    assert list(contradicting([ChannelGap("qvel.b", "rad/s", 0.1, 0.1, 0.2)])) == []
