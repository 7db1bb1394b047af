"""Tasks with a goal: the reward asks for it, the policy does not see it, no robot has it."""

from __future__ import annotations

import numpy as np
import pytest

from envs.effects import Goal
from envs.errors import EffectError
from envs.params import ParamSpace
from envs.randomization import Draw, Randomization
from envs.simulation import Simulation
from envs.tasks import HalfCheetah, HalfCheetahDirection, HalfCheetahVelocity, Hopper
from sim2real.diagnosis.attribution.candidates import EFFECTS

GOALS = np.array([-1.0, 0.5, 1.0])
IDS = np.arange(3)
SEEDS = np.full(3, 7, np.uint64)


def episode(task: HalfCheetah, goals: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return observations (T, 3, O) and rewards (T, 3) of one start and the same actions."""
    effects = [] if goals is None else [Goal()]
    simulation = Simulation(task, 3, effects, threads=1)
    values = np.zeros((3, 0)) if goals is None else goals[:, None]
    seen, paid = [simulation.reset(IDS, values, SEEDS)], []
    rng = np.random.default_rng(0)
    for _ in range(20):
        step = simulation.step(None, np.tile(rng.uniform(-1, 1, 6), (3, 1)))
        seen.append(step.observation)
        paid.append(step.reward)
    return np.stack(seen), np.stack(paid)


def test_the_goal_is_in_the_reward_alone() -> None:
    """Observations are HalfCheetah's to the bit; rewards differ by what the goals ask for."""
    plain, paid = episode(HalfCheetah(), None)
    rng = np.random.default_rng(0)
    effort = np.stack([np.full(3, (rng.uniform(-1, 1, 6) ** 2).sum()) for _ in range(20)])
    velocity = paid + 0.1 * effort
    assert np.abs(velocity).max() > 0.5
    for task, ideal in (
        (HalfCheetahDirection(), GOALS * velocity),
        (HalfCheetahVelocity(), -np.abs(velocity - GOALS)),
    ):
        seen, rewards = episode(task, GOALS)
        np.testing.assert_array_equal(seen, plain)
        np.testing.assert_allclose(rewards, ideal - 0.05 * effort, atol=1e-12)


def test_goals_change_from_reset_to_reset() -> None:
    """Each row has the goal of its own episode; a fixed one holds in all rows."""
    simulation = Simulation(HalfCheetahVelocity(), 2, [Goal()], threads=1)
    still = np.zeros((2, 6))
    rewards = []
    for goals in ([[0.0], [2.0]], [[2.0], [0.0]]):
        simulation.reset(np.arange(2), np.array(goals), SEEDS[:2])
        rewards.append(simulation.step(None, still).reward)
    np.testing.assert_array_equal(rewards[0], rewards[1][::-1])
    assert abs(rewards[0][0] - rewards[0][1]) > 1
    fixed = Simulation(HalfCheetahVelocity(), 2, threads=1, fixed=[(Goal(), [2.0])])
    fixed.reset(np.arange(2), np.zeros((2, 0)), SEEDS[:2])
    np.testing.assert_array_equal(fixed.step(None, still).reward, [rewards[0][1]] * 2)


def test_a_direction_is_one_of_two() -> None:
    """The law "ends" draws low or high, each as likely."""
    tasks = Randomization([Draw(Goal(), distribution="ends", low=-1.0, high=1.0)])
    tasks.check(ParamSpace(Simulation(HalfCheetahDirection(), 1, [Goal()]).space.parameters))
    drawn = tasks.sample(np.random.default_rng(0), 1000)
    assert set(drawn.ravel()) == {-1.0, 1.0} and abs(drawn.mean()) < 0.1


def test_no_robot_has_a_goal_and_no_diagnosis_looks_for_one() -> None:
    """Where no task asks for one it is refused in a sentence; a search leaves it out."""
    with pytest.raises(EffectError, match="no robot, recording or diagnosis has it; leave it out"):
        Simulation(Hopper(), 1, [Goal()])
    with pytest.raises(EffectError, match="env=halfcheetah_direction"):
        Simulation(Hopper(), 1, fixed=[(Goal(), [1.0])])
    assert "goal" in EFFECTS and not EFFECTS["goal"].closes_gaps
