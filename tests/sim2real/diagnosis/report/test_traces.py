"""Traces are what the gap's numbers are made of; signals are what was logged beside positions."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.report.traces import signals, traces

MODEL = """<mujoco><worldbody><body><joint name="hinge" range="-2 2"/>
<geom size="0.02" fromto="0 0 0 0.1 0 0" type="capsule"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="5" kv="0.1"/>
<motor name="torque" joint="hinge"/></actuator></mujoco>"""


@pytest.fixture
def data(tmp_path: Path) -> Data:
    """Return two episodes of a hinge, of which some rows were not fresh."""
    path = tmp_path / "arm.xml"
    path.write_text(MODEL)
    time, episode = np.tile(np.arange(0, 9, 0.02), 2), np.repeat([0, 1], 450)
    q = 0.5 * np.sin(2 * time) + 0.2 * episode
    columns = {
        "episode": episode, "time": time, "ctrl.servo": q, "ctrl.torque": 0 * q, "qpos.hinge": q,
        "current.servo": 0.1 * q, "flag.fresh": (np.arange(900) % 100 != 7).astype(float),
    }  # fmt: skip
    return Data.of([Log(columns)], path)


def test_lines_are_the_errors_that_are_scored(data: Data) -> None:
    """Simulated is measured plus the error, in the joint's unit; what is not compared is NaN."""
    rng = np.random.default_rng(0)
    shape = (len(data.windows), data.mask.shape[1], 1)
    names = (frozenset(), frozenset({0}))
    errors = {some: rng.normal(size=shape) * data.mask[..., None] for some in names}
    found = traces(data, errors, np.array([0.01]))
    assert [(one.log, one.episode, one.joint, one.unit) for one in found] == [
        ("log 1", 0, "hinge", "rad"),
        ("log 1", 1, "hinge", "rad"),
    ]
    for line, key in (("nominal", frozenset()), ("corrected", frozenset({0}))):
        squares = np.concatenate([(getattr(t, line) - t.measured) ** 2 for t in found])
        mean = data.scale[0] ** 2 * data.mean_squares(errors[key])[0]
        assert np.nanmean(squares) == pytest.approx(mean)
        assert np.isfinite(squares).sum() == data.mask.sum()
    assert (
        np.isnan(found[0].nominal[7])
        and found[0].measured[7] == data.logs[0].columns["qpos.hinge"][7]
    )
    assert sum(len(one.starts) for one in found) == len(data.windows)
    assert set(found[0].subsets) == {frozenset(), frozenset({0})}


def test_subsets_that_were_not_all_tried_are_left_out(data: Data) -> None:
    """Of two causes with one subset missing none can be switched."""
    shape = (len(data.windows), data.mask.shape[1], 1)
    names = (frozenset(), frozenset({0}), frozenset({0, 1}))
    [one, _] = traces(data, {some: np.zeros(shape) for some in names}, np.array([0.01]))
    assert one.subsets == {}


def test_commands_say_which_joint_they_are_for(data: Data) -> None:
    """A servo's command is a position of its joint; a motor's is not."""
    models: list[mujoco.MjModel] = list(data.models)
    found = [s for s in signals(data.logs, models) if s.episode == 1]
    assert [(s.kind, s.actuator, s.unit, s.joint) for s in found] == [
        ("command", "servo", "rad", "hinge"),
        ("command", "torque", "", None),
        ("current", "servo", "A", None),
    ]
    assert len(found[0].time) == len(found[0].values) == 450
