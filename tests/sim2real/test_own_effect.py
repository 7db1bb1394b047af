"""An effect of a user's own, in a folder outside the repository, in every place that knows effects.

The module below is all that the user writes.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import EFFECTS, Effect, load_effects, make, write_effects
from envs.effects.bound import BoundEffect
from envs.effects.extras import Extra
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.plant import Plant
from envs.simulation import Simulation
from envs.tasks import Hopper
from hardware.log import Log
from sim2real.config import extensions
from sim2real.config.compose import compose
from sim2real.config.targets import build
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from sim2real.diagnosis.report import model_file, text
from sim2real.evaluation.grid import Grid
from tests.sim2real.diagnosis import arm

MODULE = '''
import numpy as np
from envs.effects import FieldEffect, register


@register
class ReturnSpring(FieldEffect):
    """A spring that pulls a joint to its rest angle, such as a cable or a gas strut."""

    name, place, unit, hows = "return_spring", "joint", "N·m/rad", ("add", "scale", "set")
    field = "jnt_stiffness"
    display_name = "spring to the rest angle"
    symptom = "the joint is pulled to its rest angle, the more the farther it is away"
    source = "MuJoCo XML reference, joint/stiffness"
    experiment = "let go of the joint from several angles"

    def probes(self, scale):
        return np.array([0.05, 0.2, 0.8]) * scale.torque_at(self.where)
'''
STIFFNESS = 0.8  # N·m/rad


DRAWN = """
# how hard the spring at the ankle pulls
_target_: envs.randomization.Randomization
draws:
  - {effect: return_spring, where: leg_joint, low: 1.0, high: 5.0}
"""


@pytest.fixture(autouse=True)
def own(tmp_path: Path) -> Iterator[None]:
    """Name the user's folder as `--config-dir` does, and import its modules as a verb does."""
    assert len(MODULE.strip().splitlines()) <= 20
    folder = tmp_path / "mine"
    (folder / "params").mkdir(parents=True)
    (folder / "my_springs.py").write_text(MODULE, encoding="utf-8")
    (folder / "params" / "springs.yaml").write_text(DRAWN, encoding="utf-8")
    extensions.activate(folder)
    extensions.load()
    yield
    EFFECTS.pop("return_spring", None)


def sprung() -> mujoco.MjSpec:
    """Return the arm with a spring in its second joint, written into its model."""
    spec = arm.spec()
    spec.joint("b").stiffness = [STIFFNESS, 0.0, 0.0]
    return spec


def log() -> Log:
    """Return a log of that arm, moved by its servos."""
    model = sprung().compile()
    plant = Plant(sprung(), num_rows=1, threads=1)
    time = np.arange(300) / arm.RATE
    goals = 0.5 * np.sin(2 * np.pi * np.outer(time, (0.4, 0.7)) + (0.3, 1.1))
    first = np.zeros(1, int)
    plant.reset(first, np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1, np.uint64), goals[:1])
    path = []
    for goal in goals:
        path.append(plant.qpos[0].copy())
        plant.step(None, goal[None], round(1 / arm.RATE / model.opt.timestep))
    columns = {"episode": np.zeros(len(time)), "time": time}
    columns |= {f"ctrl.{n}": goals[:, i] for i, n in enumerate("ab")}
    columns |= {f"qpos.{n}": np.array(path)[:, i] for i, n in enumerate("ab")}
    return Log(columns)


@pytest.mark.slow
def test_a_diagnosis_finds_it_and_a_report_says_it(tmp_path: Path) -> None:
    """Of all changes it explains the log, and its fit has the true stiffness."""
    data = Data.of([log()], arm.model(tmp_path))
    judgement = Judge(data).judge(Vocabulary(data))
    assert judgement.best.label == "return_spring.b"
    assert judgement.best.mean[0] == pytest.approx(STIFFNESS, rel=0.02)
    assert text.format_effect("return_spring", "b") == "spring to the rest angle at b"
    without = Vocabulary(data, ["return_spring"])
    assert "return_spring" not in {c.name for c in without.effects}
    assert "return_spring" in {c.name for c in without.excluded}


class RestBound(BoundEffect):
    """Writes a spring's stiffness and its rest angle."""

    def __init__(self, plant: PlantView, effect: Effect, stiffness: BoundEffect) -> None:
        self.effect, self.stiffness, self.rest = effect, stiffness, plant.field("qpos_spring")
        self.place = plant.model.jnt_qposadr[joints(plant.model, effect.where)]

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Write values (n, k) into the rows ids, (n,)."""
        self.stiffness.write(ids, values)
        self.rest[ids[:, None], self.place] = self.effect.scalar("rest", values)[:, None]


@pytest.mark.slow
def test_a_further_value_is_fitted_once_it_is_a_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rest angle of a spring, in addition to its stiffness."""
    base: Any = EFFECTS["return_spring"]

    class RestSpring(base):  # type: ignore[valid-type, misc]
        name = "rest_spring"
        extras = (Extra("rest", "rad", 0.0, -1.5, 1.5, "rest", fit=(-1.0, 1.0), later=True),)

        def bind(self, plant: PlantView) -> BoundEffect:
            return RestBound(plant, self, super().bind(plant))

    monkeypatch.setitem(EFFECTS, "rest_spring", RestSpring)
    made = arm.make_log(("rest_spring", {"where": "b", "rest": 0.4}, STIFFNESS), noise=3e-4)
    data = arm.data_of(made, tmp_path)
    best = Judge(data).judge(Vocabulary(data, only=["rest_spring.b"])).best
    assert best.label == "rest_spring.b (rest)"
    np.testing.assert_allclose(best.mean, [STIFFNESS, 0.4], rtol=0.02)


def test_files_hold_it(tmp_path: Path) -> None:
    """effects.yaml gives it back, and model.xml has the spring."""
    write_effects(tmp_path / "effects.yaml", [(make("return_spring", where="b"), (STIFFNESS,))])
    effects = load_effects(tmp_path / "effects.yaml")
    assert model_file.write(arm.spec(), effects, tmp_path / "model.xml") == {}
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    np.testing.assert_array_equal(written.jnt_stiffness, sprung().compile().jnt_stiffness)


def test_training_draws_it_and_an_evaluation_sweeps_it() -> None:
    """It is a parameter of the task's space, in its row and its cell."""
    tasks = build(compose(["env=hopper", "params=springs"])["params"], "params")
    simulation = Simulation(Hopper(), num_rows=3, effects=tasks.effects, threads=1)
    tasks.check(simulation.space)
    values = tasks.sample(np.random.default_rng(0), 3)
    assert ((values >= 1) & (values <= 5)).all()

    plant = Plant(arm.spec(), [make("return_spring", where="b")], 3, 1)
    grid = Grid([{"parameter": "return_spring.b", "values": [0.0, 2.0, 4.0]}])
    plant.set_params(np.arange(3), grid.values(plant.space))
    assert plant.field("jnt_stiffness")[:, 1].tolist() == [0.0, 2.0, 4.0]
