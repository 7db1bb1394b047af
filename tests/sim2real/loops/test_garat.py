"""GARAT: what is added to actions makes a simulator move as the robot does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.rows import Rows, Step
from envs.simulation import Simulation
from envs.tasks import CartPole
from sim2real.config.compose import compose, prepare
from sim2real.identification.providers.rollout import roll
from sim2real.identification.scores.critic import Critic
from sim2real.learning.grounding import read, write
from sim2real.loops.garat import REACH, ActedRows, Judge, ground
from sim2real.runs.errors import Sim2RealError

SHARE = 0.4  # of an action, that the robot's drive makes of it


class Weak(Simulation):
    """A cart-pole whose drive goes so far alone."""

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Step with a share of the action."""
        return super().step(ids, SHARE * action)


def swinging(seed: int) -> Any:
    """Return a policy that says anything, as in a first exploration."""
    rng = np.random.default_rng(seed)
    return lambda seen: np.clip(-4.0 * seen[:, :1] + rng.normal(0.0, 0.7, (len(seen), 1)), -1, 1)


def rows(count: int) -> Rows:
    """Return the simulator."""
    return Simulation(CartPole(), count, threads=1)


def seen(robot: Rows, count: int) -> np.ndarray:
    """Return transitions of the policy on a robot, (N, 2 O + A)."""
    found = roll(robot, swinging(1), np.zeros((count, 0)), 100, np.random.default_rng(2))
    return found.reshape(-1, found.shape[-1])


@pytest.mark.slow
def test_the_simulator_learns_that_the_robots_drive_is_weak(tmp_path: Path) -> None:
    """What the simulator makes of changed actions is nearer to the robot than that of plain ones.

    The change is never shown: what is right, -0.6 of the action, follows from transitions alone.
    """
    real = seen(Weak(CartPole(), 40, threads=1), 40)
    words = ["+experiment=garat", "checkpoint=RUN", "log=x", "algorithm.num_rows=32"]
    made = prepare(compose([w for w in words if "RUN" not in w]), tmp_path)[1]
    gaps: list[float] = []
    module = ground(
        rows,
        lambda count: swinging(3),
        real,
        made["parts"],
        made["algorithm"],
        Critic(updates=20, batch=2000),
        60_000,
        lambda found, done: gaps.append(found["train/critic_gap"]),
    )
    write(tmp_path / "grounding.npz", module)
    change = read(tmp_path / "grounding.npz")
    states, said = real[:, :4], real[:, 4:5]
    wrong = (SHARE - 1) * said
    left = np.abs(change(states, said) - wrong).mean() / np.abs(wrong).mean()
    assert left < 0.5
    assert min(gaps[-5:]) < 0.5 * max(gaps)


def test_rows_in_which_a_policy_acts() -> None:
    """They show state and action; nothing added is the simulator itself, the pay is as given."""
    paid: list[np.ndarray] = []

    def pay(transitions: np.ndarray) -> np.ndarray:
        paid.append(transitions)
        return transitions[:, 4]

    acted = ActedRows(rows(3), lambda seen: 0.1 + seen[:, :1], pay)
    plain, every, seeds = rows(3), np.arange(3), np.arange(3, dtype=np.uint64)
    now = acted.reset(every, np.zeros((3, 0)), seeds).copy()
    state = np.array(plain.reset(every, np.zeros((3, 0)), seeds))
    np.testing.assert_allclose(now, np.hstack([state, 0.1 + state[:, :1]]))
    np.testing.assert_allclose(acted.action_high, REACH * 2.0)
    step = acted.step(None, np.zeros((3, 1)))
    moved = plain.step(None, now[:, 4:]).observation
    np.testing.assert_allclose(step.observation[:, :4], moved)
    np.testing.assert_allclose(paid[0], np.hstack([now, moved - state]))
    np.testing.assert_allclose(step.reward, now[:, 4])
    some = acted.reset(np.array([1]), np.zeros((1, 0)), seeds[:1])
    assert some.shape == (1, 5)
    again = acted.step(None, np.full((3, 1), 5.0)).observation  # cut at the action's limits
    after = plain.step(None, np.ones((3, 1))).observation
    np.testing.assert_allclose(again[0, :4], after[0])


def test_the_judge_pays_for_being_like_the_robot() -> None:
    """Nothing before it has learned; then less for what is unlike, and about 0 in the mean."""
    rng = np.random.default_rng(0)
    real = rng.normal(0.0, 1.0, (4000, 9))
    judge = Judge(Critic(updates=60, batch=500), real, 4, seed=0)
    unlike = rng.normal(0.0, 1.0, (200, 9)) + np.eye(9)[4] * 3.0
    assert (judge.pay(unlike) == 0).all()
    assert judge.learn() > 0
    like, other = judge.pay(real[:200]).mean(), judge.pay(unlike).mean()
    assert like > other and abs(other) < 0.2 * (like - other)


def test_a_network_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    """Layers of other kinds; and a file that is none is a sentence."""
    from torch import nn

    from sim2real.learning.modules.acting import Actor

    ends = (np.zeros(5), np.ones(5), -np.ones(1), np.ones(1))
    odd = Actor(nn.Sequential(nn.Linear(5, 4), nn.ELU(), nn.Linear(4, 1)), *ends)
    with pytest.raises(Sim2RealError, match="ELU cannot ground actions"):
        write(tmp_path / "grounding.npz", odd)
    (tmp_path / "grounding.npz").write_text("no arrays")
    with pytest.raises(Sim2RealError, match="run=garat writes one"):
        read(tmp_path / "grounding.npz")
