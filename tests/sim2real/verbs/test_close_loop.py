"""Recording a simulated robot whose state is all known, and restarting replays from it."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from envs import HopperPolito, MujocoEnv
from envs.effects import load_effects, make, write_effects
from envs.models import named
from envs.simulation import Simulation
from hardware.log import Log, read_logs
from sim2real.config.compose import compose, prepare
from sim2real.diagnosis.data.replay import measure
from sim2real.learning.environment import Environment
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.population.recording import record
from sim2real.learning.trained import of_module
from sim2real.loops.close_loop import compare, cut, noise
from sim2real.runs.errors import Sim2RealError


@pytest.fixture(scope="module")
def log() -> Log:
    """Return ten episodes of the target under random actions."""
    rng = np.random.default_rng(0)
    robot = Simulation(HopperPolito("target"), 10)
    return record(robot, noise(robot, rng), draw_seeds(rng, 10)).log


def test_a_log_replays_exactly_in_its_own_robot(log: Log) -> None:
    """State, velocities and commands are all there: nothing is left to guess."""
    gap = measure(log, named(HopperPolito("target").spec()))
    assert gap.joints == ("rootx", "rootz", "rooty", "thigh_joint", "leg_joint", "foot_joint")
    np.testing.assert_allclose(gap.simulated, gap.measured, atol=1e-9)


def test_a_kilogram_shows(log: Log) -> None:
    """In the source the log does not replay; with the kilogram that it lacks it does."""
    source = named(HopperPolito("source").spec())
    lacking = measure(log, source)
    heavier = measure(log, source, [(make("link_mass", where="torso"), (1.0,))])
    assert np.abs(lacking.simulated - lacking.measured).max() > 5e-3
    np.testing.assert_allclose(heavier.simulated, heavier.measured, atol=1e-9)


def test_pieces_restart_from_the_recorded_state(log: Log) -> None:
    """A piece begins where the recording was, and lasts about as long as asked."""
    pieces = list(cut(log, 0.1).episodes())
    assert len(pieces) > 10
    assert all(part.time[0] == 0 and 0.06 < part.time[-1] < 0.16 for part in pieces)
    whole = {
        tuple(row) for row in np.column_stack([log.column("qpos.rootx"), log.column("qvel.rootx")])
    }
    assert all((p.column("qpos.rootx")[0], p.column("qvel.rootx")[0]) in whole for p in pieces)
    gap = measure(cut(log, 0.1), named(HopperPolito("target").spec()))
    np.testing.assert_allclose(gap.simulated, gap.measured, atol=1e-9)


@pytest.mark.slow
def test_the_torsos_kilogram_is_named(tmp_path: Path) -> None:
    """From ten episodes of random actions: link_mass at the torso, within 5 %, and nothing else."""
    verb, arguments = prepare(compose(["+experiment=hopper_gap"]), tmp_path)
    report = verb(**arguments)
    assert report.verdict == "explained"
    (cause,) = report.causes
    assert (cause.effect, cause.extra["body"]) == ("link_mass", "torso")
    assert cause.value == pytest.approx(1.0, rel=0.05)
    assert cause.value_ci[0] <= 1.0 <= cause.value_ci[1]
    ((effect, values),) = load_effects(tmp_path / "effects.yaml")
    assert effect.label() == "link_mass.torso"
    assert values[0] == pytest.approx(cause.value)
    written = json.loads((tmp_path / "report.json").read_text())
    assert written["causes"][0]["effect"] == "link_mass"
    assert (tmp_path / "report.html").is_file() and (tmp_path / "model.xml").is_file()
    (log,) = read_logs(str(tmp_path / "log.csv"))
    assert log.model == tmp_path / "source.xml"


def test_a_policy_gets_in_the_corrected_simulator_what_it_gets_on_the_target(
    tmp_path: Path,
) -> None:
    """Returns differ before, and agree once the kilogram is in; all of it is written."""
    write_effects(tmp_path / "effects.yaml", [(make("link_mass", where="torso"), (1.0,))])
    torch.manual_seed(0)
    policy = torch.nn.Sequential(torch.nn.Linear(11, 3), torch.nn.Tanh())
    source, target = (
        Environment(partial(MujocoEnv, task=HopperPolito(d))) for d in ("source", "target")
    )
    table = compare(of_module(policy, source, 0), target, tmp_path, seed=0)
    given, found, wanted = (row[1] for row in table.rows)
    assert found == wanted
    assert given != wanted
    assert "target" in (tmp_path / "returns.md").read_text()


def test_without_a_target_it_says_where_to_start(tmp_path: Path) -> None:
    """The verb alone has no robot."""
    verb, arguments = prepare(compose(["run=close_loop"]), tmp_path)
    with pytest.raises(Sim2RealError, match=r"needs a target, .* \+experiment=hopper_gap"):
        verb(**arguments)
