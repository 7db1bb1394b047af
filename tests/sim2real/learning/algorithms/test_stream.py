"""Episodes that restart by themselves, saved and loaded in mid-air."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
import torch

from envs import Simulation
from envs.effects import make
from envs.randomization import Draw, Randomization
from envs.rows import Rows
from envs.tasks import Hopper
from envs.torch_env import RowsEnv
from envs.toys import Nav2D, NavGoals
from sim2real.learning.algorithms.stream import EpisodeStream


def robots(per: Literal["reset", "row"] = "reset") -> Randomization:
    """Return masses and a delay: a parameter that the model holds, and an effect with a memory."""
    delay = Draw(make("command_delay"), low=0.0, high=0.02)
    return Randomization([Draw(make("link_mass", where="torso"), low=-1.0, high=1.0), delay], per)


def hopper(tasks: Randomization) -> Rows:
    """Return five short Hoppers."""
    return Simulation(Hopper(max_steps=30), num_rows=5, effects=tasks.effects)


def play(stream: EpisodeStream, steps: int, seed: int) -> list[np.ndarray]:
    """Take random steps; return all that is seen."""
    rng = np.random.default_rng(seed)
    seen = []
    for _ in range(steps):
        size = (stream.rows.num_rows, stream.rows.action_size)
        step = stream.step(rng.uniform(-1, 1, size).astype(np.float32))
        seen += [step.observation.copy(), step.reward, stream.observation.copy()]
    return seen


@pytest.mark.parametrize(
    "world", [lambda: (hopper(robots()), robots()), lambda: (Nav2D(7, 20), NavGoals())]
)
def test_a_loaded_stream_goes_on_to_the_last_bit(world: Callable[[], tuple[Any, Any]]) -> None:
    """A stream that is loaded elsewhere sees what the saved one does, through ends of episodes."""
    first = EpisodeStream(*world(), np.random.default_rng(0))
    play(first, 47, 1)
    state = first.state_dict()
    second = EpisodeStream(*world(), np.random.default_rng(9))
    second.load_state_dict(state)
    np.testing.assert_array_equal(second.observation, first.observation)
    for seed in range(2, 12):  # what is saved later is the same too, whatever older episodes left
        for one, other in zip(play(first, 7, seed), play(second, 7, seed), strict=True):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(first.state_dict()["actions"], second.state_dict()["actions"])
    assert first.summary() == second.summary() and first.frames == second.frames


def test_episodes_are_those_of_the_torchrl_environment() -> None:
    """The same generator gives `RowsEnv` and the stream the same robots, starts and steps."""
    tasks = robots()
    stream = EpisodeStream(hopper(tasks), tasks, np.random.default_rng(3))
    env = RowsEnv(hopper(tasks), seed=3, tasks=robots())
    now, rng = env.reset(), np.random.default_rng(4)
    for _ in range(60):
        np.testing.assert_array_equal(now["observation"], stream.observation.astype(np.float32))
        action = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
        step = stream.step(action)
        done, now = env.step_and_maybe_reset(now.set("action", torch.from_numpy(action)))
        np.testing.assert_array_equal(done["next", "terminated"][:, 0], step.terminated)
        np.testing.assert_array_equal(done["next", "reward"][:, 0], step.reward.astype(np.float32))


def test_returns_and_lengths_are_those_of_whole_episodes() -> None:
    """Nav-2D's episodes of 20 steps: the summary is the mean over those that ended."""
    stream = EpisodeStream(Nav2D(3, 20), NavGoals(), np.random.default_rng(0))
    assert np.isnan(stream.summary()["train/return"])
    rewards = np.stack([stream.step(np.zeros((3, 2), np.float32)).reward for _ in range(20)])
    assert stream.summary() == {
        "train/return": pytest.approx(rewards.sum(axis=0).mean()),
        "train/episode_length": 20.0,
    }


def test_a_row_keeps_its_robot_if_told_so() -> None:
    """`per: row` draws once, `per: reset` for each episode."""
    for per, same in (("row", True), ("reset", False)):
        tasks = robots(per)  # type: ignore[arg-type]
        stream = EpisodeStream(hopper(tasks), tasks, np.random.default_rng(0))
        before = stream.state_dict()["values"]
        play(stream, 60, 0)
        assert bool((stream.state_dict()["values"] == before).all()) is same
