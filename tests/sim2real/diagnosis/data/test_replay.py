"""The verb's replay and a diagnosis's are one: the same start, commands and effects, to the bit."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import measure
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.windows import cut_one

ASSETS = Path("envs/assets")
ROWS = 50  # of an episode
EFFECTS = {
    "nothing": (),
    "command delay": (("command_delay", {}, 0.013),),
    "observation delay": (("observation_delay", {}, 0.017),),
    "heat": (("thermal_derating", {}, 0.5),),
    "friction, play and a late encoder": (
        ("stribeck_friction", {}, 0.05),
        ("backlash", {"side": "link"}, 0.02),
        ("observation_delay", {}, 0.011),
    ),
}


def wander(model: mujoco.MjModel, seed: int) -> Log:
    """Return two episodes of random commands with irregular rows, stamps and torque that goes off.

    What was measured is random, too, and large: a replay looks at its start alone, and the
    simulator bounds errors by the spread of what was measured.
    """
    rng, columns = np.random.default_rng(seed), {}
    steps = rng.uniform(0.006, 0.03, (2, ROWS))
    time = np.cumsum(steps, axis=1) - steps[:, :1] + np.array([[0.0], [3.5]])
    columns["episode"], columns["time"] = np.repeat([0, 1], ROWS), time.ravel()
    starts = np.arange(2 * ROWS) % ROWS == 0
    for i in range(model.nu):
        name, joint = model.actuator(i).name, model.joint(int(model.actuator_trnid[i, 0])).name
        goals = rng.uniform(-0.4, 0.4, 2 * ROWS // 5).repeat(5)
        columns[f"ctrl.{name}"] = goals
        columns[f"qpos.{joint}"] = rng.normal(size=2 * ROWS) * np.where(starts, 0.1, 1.0)
        columns[f"qvel.{joint}"] = 0.3 * rng.normal(size=2 * ROWS)
        columns[f"stamp.{joint}"] = columns["time"] - rng.uniform(0.001, 0.004, 2 * ROWS)
        columns[f"torque.{name}"] = np.repeat(rng.uniform(size=2 * ROWS // 10) < 0.7, 10) * 1.0
    return Log(columns, {"command_delay": 0.0045})


def whole(data: Data) -> Data:
    """Return the data of a log with each episode, all as long, as one window."""
    [log], [model] = data.logs, data.models
    ends = np.append(np.flatnonzero(np.diff(log.episode)) + 1, len(log))
    windows = tuple(
        cut_one(log, 0, 0, model, data.joints, (start, start, end))
        for start, end in pairwise([0, *ends.tolist()])
    )
    mask = np.array([window.usable for window in windows])
    measured = np.array([window.measured for window in windows])
    return replace(data, windows=windows, mask=mask, measured=measured)


def cases() -> Iterator[Any]:
    """Yield every robot with each of the effects; heat takes seconds where joints are many."""
    for robot, name in product(("bench1", "hopper2", "arm6"), EFFECTS):
        marks = [pytest.mark.slow] if name == "heat" and robot != "bench1" else []
        yield pytest.param(robot, EFFECTS[name], id=f"{robot}-{name}", marks=marks)


@pytest.mark.parametrize(("robot", "effects"), list(cases()))
def test_both_verbs_replay_a_log_alike(robot: str, effects) -> None:
    """Whole episodes in a diagnosis's simulator are what run=replay makes of the log."""
    path = ASSETS / f"{robot}.xml"
    model = mujoco.MjModel.from_xml_path(str(path))
    joint = model.joint(int(model.actuator_trnid[0, 0])).name
    places = {"stribeck_friction": joint, "backlash": joint}
    fixed: list[Fixed] = [
        (make(name, where=places.get(name), **more), (value,)) for name, more, value in effects
    ]
    log = wander(model, seed=len(effects))
    gap = measure(log, load_model(log, path), fixed)
    data = whole(Data.of([log], path))
    found = Simulator(data, fixed).run((), np.arange(2), np.zeros((2, 0)))
    columns = [gap.joints.index(joint.name) for joint in data.joints]
    apart = (gap.simulated - gap.measured)[:, columns].reshape(2, ROWS, -1)
    assert np.array_equal(found.error, np.where(data.mask[..., None], apart, 0.0))
    assert np.ptp(gap.simulated[:, columns], axis=0).min() > 0.05
