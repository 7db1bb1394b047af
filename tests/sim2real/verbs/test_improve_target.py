"""A task that stands for the robot in `improve`: its episodes, their replays, and a round."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from envs import HopperPolito, MujocoEnv
from envs.effects import make
from envs.models import named
from envs.simulation import Simulation
from hardware.log import Log, read_logs
from sim2real.config.compose import compose, instantiate
from sim2real.deployment.trained import load_policy
from sim2real.diagnosis.data.replay import measure
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.population.recording import record
from sim2real.loops.improve.improve import Improvement
from sim2real.loops.improve.story import ImprovementHistory
from sim2real.loops.improve.target import Target, cut
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs.improve import run
from tests.sim2real.trained import train

HOPPER = ["env=hopper_polito", "env.task.masses=legacy", "params=none"]
QUICK = ["trials=10", "rollouts=2", "rounds=1"]


@pytest.fixture(scope="module")
def log() -> Log:
    """Return ten episodes of the target under random actions."""
    rng = np.random.default_rng(0)
    robot = Simulation(HopperPolito("target"), 10)
    low, high = robot.action_low, robot.action_high
    return record(
        robot, lambda seen: rng.uniform(low, high, (10, len(low))), draw_seeds(rng, 10)
    ).log


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


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run of a policy of the source that has hardly learned."""
    words = [*HOPPER, "policy=linear", "adapt=none", "iterations=1", "algorithm.pairs=2"]
    return train(tmp_path_factory.mktemp("target") / "run", words)


def go(policy: Path, out: Path, *words: str) -> Improvement:
    """Improve the policy on the target."""
    line = ["run=improve", f"checkpoint={policy}", "+env@target=hopper_polito", *QUICK, *words]
    line += ["target.task.masses=legacy", "target.task.domain=target"]
    (out / ".hydra").mkdir(parents=True, exist_ok=True)
    given = yaml.safe_load((policy / ".hydra" / "overrides.yaml").read_text())
    (out / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump([*given, *line]))
    done = run(**instantiate(compose(line), out)[1])
    assert isinstance(done, Improvement)
    return done


@pytest.mark.slow
def test_the_torsos_kilogram_is_named_and_trained_with(policy: Path, tmp_path, monkeypatch) -> None:
    """link_mass at the torso, within 5 %, and nothing else; the simulator then pays as the target.

    A loop that is started again does nothing twice.
    """
    monkeypatch.setattr(
        ImprovementHistory, "end", lambda story: None
    )  # so poor a policy loses nothing there
    done = go(policy, tmp_path, "iterations=1")
    assert [len(one.causes) for one in done.story.rounds] == [0, 1]
    first, second = done.story.rounds
    (cause,) = second.causes
    assert cause["label"] == "link_mass.torso"
    assert cause["value"] == pytest.approx(1.0, rel=0.05)
    assert cause["ci"][0] <= 1.0 <= cause["ci"][1]
    assert first.robot is not None and second.robot is not None
    apart = [np.abs(np.subtract(one.robot or [], one.simulator)).max() for one in (first, second)]
    assert apart[1] < apart[0] / 5
    (log,) = read_logs(str(tmp_path / "round_0" / "deploy" / "logs"))
    assert log.model is not None and log.model.resolve() == (
        tmp_path / "round_0" / "deploy" / "model.xml"
    )
    assert load_policy(tmp_path / "round_1" / "policy").environment.name == "HopperPolito"
    again = go(policy, tmp_path / "other", "iterations=1", f"resume={tmp_path}")
    assert again.story.rounds == done.story.rounds


def test_a_policy_gets_in_the_corrected_simulator_what_it_gets_on_the_target(
    policy: Path, tmp_path: Path
) -> None:
    """Returns differ before, and agree to the bit once the kilogram is in."""
    trained = load_policy(policy)
    heavy = HopperPolito("target", masses="legacy")
    world = EnvironmentFactory(partial(MujocoEnv, task=heavy))
    target = Target(world, trained.environment, trials=5, seed=0)
    earned = target.deploy(trained, tmp_path / "round_0" / "deploy")
    assert target.score(trained) != earned
    assert target.score(trained, [(make("link_mass", where="torso"), (1.0,))]) == earned
    assert target.deploy(trained, tmp_path / "round_0" / "deploy") == earned
    pieces = target.record(tmp_path / "round_1", 1)
    assert all(part.time[-1] < 0.4 for part in pieces[0].episodes())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("trials=1",), "trials=1: at least 2 episodes"),
        (("by=luck",), "by=luck is none of diagnosis, returns"),
        (("log=x.csv",), "remove log=, target= or by=returns"),
        (("port=/dev/x",), "remove port= or target="),
    ],
)
def test_what_cannot_be_is_refused(policy: Path, tmp_path, words: tuple[str, ...], message) -> None:
    """With one sentence, before anything is played."""
    with pytest.raises(Sim2RealError, match=message):
        go(policy, tmp_path, *words)
    assert not (tmp_path / "round_0").exists()


def test_a_target_without_a_robot_is_refused(policy: Path, tmp_path: Path) -> None:
    """A toy has nothing to diagnose."""
    line = ["run=improve", f"checkpoint={policy}", "+env@target=nav2d"]
    with pytest.raises(Sim2RealError, match="no robot to diagnose"):
        run(**instantiate(compose(line), tmp_path)[1])


@pytest.mark.parametrize("name", ["hopper_gap", "hopper2_gap"])
def test_the_experiments_ask_for_a_policy(name: str, tmp_path: Path) -> None:
    """Both improve one."""
    verb, arguments = instantiate(compose([f"+experiment={name}"]), tmp_path)
    assert verb is run
    with pytest.raises(Sim2RealError, match="give checkpoint=PATH"):
        run(**arguments)
