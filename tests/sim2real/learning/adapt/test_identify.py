"""Identification as an adaptation: ask and tell, with logs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hardware.log import Log
from sim2real.config.compose import compose, instantiate
from sim2real.config.targets import build as build_part
from sim2real.learning.adapt import Identify, IdentifySession
from sim2real.learning.algorithms.base import build
from sim2real.learning.environment import environment_of
from sim2real.learning.population.identification import score_identification
from sim2real.runs.errors import Sim2RealError

WORDS = ["env=hopper", "params=mass_friction", "policy=mlp", "env.task.max_steps=40"]
TOLD = [*WORDS, "transforms=with_params"]
SMALL = ["algorithm.num_rows=4", "algorithm.shards=1", "algorithm.pairs=2"]
THETA = np.arange(4, dtype=np.float32)


class Averages:
    """Finds the means of two columns over all logs that it is given."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int]] = []

    def __call__(self, environment: Any, logs: Sequence[Log], seed: int) -> np.ndarray:
        """Return them."""
        self.seen.append((len(logs), seed))
        columns = [np.concatenate([log.column(n) for log in logs]) for n in ("ctrl.a", "qpos.a")]
        return np.array([column.mean() for column in columns])


def log(ctrl: float, qpos: float) -> Log:
    """Return an episode in which nothing changes."""
    both = {"ctrl.a": np.full(3, ctrl), "qpos.a": np.full(3, qpos)}
    return Log({"episode": np.zeros(3), "time": np.arange(3.0), **both}, {"robot": "a"})


def started(find: Any, seed: int = 0) -> IdentifySession:
    """Return a session of three episodes that looks at the last two logs."""
    operator = Identify(episodes=3, last=2, find=find).bind_environment(
        environment_of(compose(TOLD))
    )
    return operator.start(THETA, np.random.default_rng(seed))


def test_each_episode_runs_with_what_the_logs_before_it_say() -> None:
    """It begins with the middle of the ranges; then the newest logs decide, returns never."""
    find = Averages()
    session = started(find)
    asked = []
    for value, one in zip((5.0, -3.0, 1.0), (log(9, 2.5), log(5, 1.5), log(1, 1.5)), strict=True):
        asked.append(session.ask())
        session.tell(value, log=one)
    np.testing.assert_allclose([a[:4] for a in asked], [THETA] * 3)  # type: ignore[index]
    np.testing.assert_allclose([a[4:] for a in asked], [[0, 0], [1, 1], [0.5, 0]])  # type: ignore[index]
    np.testing.assert_allclose(session.found, [3.0, 1.5])
    np.testing.assert_allclose(session.result[4:], [-0.5, -1.0])
    assert [count for count, _ in find.seen] == [1, 2, 2] and session.ask() is None
    with pytest.raises(Sim2RealError, match="all 3 episodes have been reported"):
        session.tell(0.0, log=log(1, 1))


def test_a_session_goes_on_where_it_was_saved() -> None:
    """Another process needs the state alone: same seed, same logs, same answer."""
    first, other = started(Averages(), 4), started(Averages(), 9)
    first.tell(1.0, log=log(9, 2.5))
    first.tell(2.0, log=log(4, 2.0))
    other.load_state_dict(first.state_dict())
    assert other.episodes_left == 1
    for session in (first, other):
        session.tell(3.0, log=log(2, 1.5))
    np.testing.assert_array_equal(first.result, other.result)
    np.testing.assert_array_equal(first.history, other.history)
    seeds = [find.seen[-1] for find in (first._recipe._find, other._recipe._find)]  # type: ignore[attr-defined]
    assert seeds[0] == seeds[1]


def test_an_episode_without_a_log_is_refused() -> None:
    """A return alone says nothing of the robot, and the session stays as it was."""
    session = started(Averages())
    with pytest.raises(Sim2RealError, match="came without a log"):
        session.tell(1.0)
    assert session.episodes_left == 3
    with pytest.raises(Sim2RealError, match="finite"):
        session.tell(float("nan"), log=log(1, 1))


def test_a_policy_that_is_told_nothing_is_refused() -> None:
    """Neither it nor a training can identify, and a truth that is told is not adapted."""
    operator = Identify(episodes=1, last=1, find=Averages())
    with pytest.raises(Sim2RealError, match="trained without them"):
        operator.bind_environment(environment_of(compose(WORDS)))
    for words, sentence in (
        ([*TOLD, *SMALL, "adapt=identify"], "cannot train with identification"),
        ([*TOLD, *SMALL, "adapt=hillclimb"], "already receives the true values of"),
    ):
        _, given = instantiate(compose([*words, "eval=grid_hopper"]), Path())
        with pytest.raises(Sim2RealError, match=sentence):
            given["eval"].check(build(given["algorithm"], given["parts"]))


@pytest.mark.slow
def test_on_a_simulated_robot_it_finds_the_truth() -> None:
    """From one short episode to mass and friction; the policy then acts as the oracle does."""
    _, given = instantiate(compose([*TOLD, *SMALL, "seed=1"]), Path())
    learner = build(given["algorithm"], given["parts"])
    trained = learner.trained()
    adapt = build_part(compose(["adapt=identify", "adapt.episodes=1"])["adapt"], "adapt")
    adapt = adapt.bind_environment(trained.environment)
    robots, seeds = np.array([[2.0, 1.8], [8.0, 2.3]]), np.array([3, 4], np.uint64)
    scores = score_identification(trained, adapt, robots, seeds, episodes=2)
    again = score_identification(trained, adapt, robots, seeds, episodes=2)
    np.testing.assert_array_equal(scores.after, again.after)
    luck = np.concatenate([_fresh(adapt, trained.theta, seed) for seed in seeds])
    oracle = trained.run_episodes(luck, values=np.repeat(robots, 2, axis=0)).returns
    np.testing.assert_allclose(scores.after.ravel(), oracle, rtol=0.02)
    assert np.abs(scores.before - scores.after).max() > 0.02 * np.abs(oracle).max()


def _fresh(adapt: Identify, theta: np.ndarray, seed: int) -> np.ndarray:
    """Return the seeds of the two episodes that score a robot."""
    rng = np.random.default_rng(int(seed))
    adapt.start(theta, rng)
    return rng.integers(0, 2**63, size=3, dtype=np.uint64)[1:]


@pytest.mark.slow
def test_the_grid_is_scored_before_and_after(tmp_path: Path) -> None:
    """`run=evaluate adapt=identify` tells the middle before, and what was found after."""
    axes = "eval.grid.axes=[{parameter: link_mass.torso, low: 2.0, high: 8.0, count: 2}]"
    words = [*TOLD, *SMALL, "eval=grid_hopper", axes, "eval.adaptations=1", "eval.episodes=1"]
    _, given = instantiate(compose([*words, "run=evaluate", "adapt=identify"]), tmp_path)
    learner = build(given["algorithm"], given["parts"], adapts=False)
    scores = given["eval"].assess(learner, 0, "run")
    assert scores.adaptation_episodes == 3 and scores.after.shape == (1, 2, 1)
    assert not np.array_equal(scores.before, scores.after)
