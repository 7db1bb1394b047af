"""A trained policy plays in its simulator: with the robot's effect it does what the robot does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.log import Log
from sim2real.deployment.deploy import servo_task
from sim2real.deployment.export import export
from sim2real.deployment.robot_env import on_robot, play, robot_of
from sim2real.deployment.trained import load_policy
from sim2real.diagnosis.closed_loop.check import Drawn, check_closed_loop
from sim2real.diagnosis.settings import DEFAULT, ClosedLoopSettings
from sim2real.learning.trained import TrainedPolicy
from sim2real.loops.player import PolicySimulator, load_player
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import SMALL_ES, train

FEW = replace(DEFAULT, closed_loop=ClosedLoopSettings(episodes=6))
HIDDEN = {"effect": "motor_strength", "where": "hinge", "value": 0.4}
WEAK = [Drawn(make("motor_strength", where="hinge"), (0.4,), (0.38, 0.42))]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a policy that follows a motion with a pendulum."""
    return train(tmp_path_factory.mktemp("es") / "run", SMALL_ES)


@pytest.fixture(scope="module")
def trained(run: Path) -> TrainedPolicy:
    """The policy with parameters 0, which commands the motion itself."""
    found = load_policy(run)
    return replace(found, theta=np.zeros_like(found.theta))


def deployed(trained: TrainedPolicy, *hidden: dict) -> list[Log]:
    """Return the logs of four episodes on an emulated robot."""
    robot = load_robot("bench1")
    world = EmulatedRobot(robot, hidden=make_hidden(list(hidden), robot), seed=1)
    backend = ServoBackend(robot, 0.2, world, seed=1)
    env = on_robot(trained, servo_task(trained.environment), backend)
    actor, found = trained.acting(env), []
    for seed in range(4):
        play(env, actor, 100 + seed)
        found.append(robot_of(env).log.last)
    env.close()
    assert None not in found
    return found


@pytest.mark.slow
def test_the_corrected_simulator_is_nearer_to_an_emulated_robot(trained: TrainedPolicy) -> None:
    """The emulator's laws are its own: a weak motor closes most of the distance and the return's.

    Without anything hidden the simulator as given is within the floor, and nearer than that.
    """
    player = PolicySimulator(trained)
    loop = check_closed_loop(deployed(trained, HIDDEN), player, WEAK, 0, FEW)
    one, paid = loop.distances[0], loop.returns
    assert one.corrected is not None and paid is not None and paid.corrected is not None
    floor = one.floor.value
    assert one.corrected.value - floor < (one.nominal.value - floor) / 2
    assert loop.channels == ("qpos.hinge",)
    gap = abs(paid.nominal.value - paid.robot.value)
    assert abs(paid.corrected.value - paid.robot.value) < gap / 2
    sound = check_closed_loop(deployed(trained), player, WEAK, 0, FEW)
    assert sound.distances[0].nearer is not None and sound.distances[0].nearer.value < 0
    assert sound.distances[0].nominal.value <= sound.distances[0].floor.ci[1]


def test_episodes_start_alike_and_values_are_drawn(trained: TrainedPolicy) -> None:
    """One seed gives the same starts in all simulators; an interval makes episodes differ."""
    player = PolicySimulator(trained)
    plain, weak = player((), 3, 5), player(WEAK, 3, 5)
    again = player((), 3, 5)
    for one, other, same in zip(plain, weak, again, strict=True):
        np.testing.assert_array_equal(one.columns["qpos.hinge"], same.columns["qpos.hinge"])
        assert one.columns["qpos.hinge"][0] == other.columns["qpos.hinge"][0]
        assert not np.array_equal(one.columns["qpos.hinge"], other.columns["qpos.hinge"])
    assert len(plain[0].columns["qpos.hinge"]) == servo_task(trained.environment).max_steps


def exported(run: Path, folder: Path) -> Path:
    """Return the folder of a run's policy as files."""
    found = load_policy(run)
    return export(found, servo_task(found.environment), folder, np.random.default_rng(0))


def test_an_export_plays_as_the_run_that_it_is_of(run: Path, tmp_path: Path) -> None:
    """A file of numbers and its task do the same, to the rounding of its numbers."""
    own = load_player(run)
    other = load_player(exported(run, tmp_path / "export") / "policy.npz")
    other.trained = replace(  # an export does not say how long episodes are
        other.trained, environment=other.trained.environment.with_task(own.task)
    )
    first, second = own((), 2, 0), other((), 2, 0)
    np.testing.assert_allclose(
        first[0].columns["qpos.hinge"], second[0].columns["qpos.hinge"], atol=2e-3
    )


def test_a_file_of_an_unknown_task_is_refused(run: Path, tmp_path: Path) -> None:
    """A policy without a task has no simulator to play in."""
    folder = exported(run, tmp_path / "export")
    facts = (folder / "policy.json").read_text(encoding="utf-8")
    (folder / "policy.json").write_text(facts.replace('"Bench1"', '"Somewhere"'), encoding="utf-8")
    with pytest.raises(Sim2RealError, match="Somewhere"):
        load_player(folder)
