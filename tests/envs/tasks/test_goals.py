"""Tasks with a goal: the reward asks for it, the policy does not see it, no robot has it."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from envs.effects import Goal
from envs.errors import EffectError
from envs.params import ParamSpace
from envs.randomization import Draw, Randomization
from envs.simulation import Simulation
from envs.tasks import (
    Ant,
    AntDirection,
    AntPosition,
    AntVelocity,
    HalfCheetah,
    HalfCheetahDirection,
    HalfCheetahVelocity,
    Hopper,
    Swimmer,
    SwimmerDirection,
    SwimmerVelocity,
    Task,
    Walker2d,
    Walker2dDirection,
    Walker2dFastVelocity,
    Walker2dVelocity,
)
from sim2real.diagnosis.inference.candidates import EFFECTS

GOALS = np.array([-1.0, 0.5, 1.0])
IDS = np.arange(3)
SEEDS = np.full(3, 7, np.uint64)


def episode(task: Task, goals: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
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


@pytest.mark.parametrize(
    ("robot", "task", "alive", "cost"),
    [
        ("HalfCheetah-v5", HalfCheetahDirection, 0.0, 0.05),
        ("Ant-v5", AntDirection, 0.0, 0.0),
        ("Ant-v5", AntVelocity, 0.0, 0.0),
        ("Swimmer-v5", SwimmerDirection, 0.0, 0.0),
        ("Swimmer-v5", SwimmerVelocity, 0.0, 0.0),
        ("Walker2d-v5", Walker2dDirection, 1.0, 0.0),
        ("Walker2d-v5", Walker2dVelocity, 1.0, 0.0),
    ],
)
def test_physics_and_velocities_are_gymnasiums(robot: str, task: type[Task], alive, cost) -> None:
    """From one state and the same actions, rewards are a closed form of Gymnasium's velocity."""
    simulation = Simulation(task(), 3, [Goal()], threads=1)
    simulation.reset(IDS, GOALS[:, None], SEEDS)
    world: Any = gymnasium.make(robot).unwrapped
    world.reset(seed=0)
    start = simulation.state()
    world.set_state(start.qpos[0], start.qvel[0])
    rng = np.random.default_rng(1)
    for _ in range(10):
        action = rng.uniform(-1, 1, simulation.action_size)
        step = simulation.step(None, np.tile(action, (3, 1)))
        _, _, fallen, _, info = world.step(action)
        velocity = info["x_velocity"]
        asked = GOALS * velocity if "Direction" in task.__name__ else -np.abs(velocity - GOALS)
        lasting = robot == "Ant-v5" or not fallen
        ideal = asked + alive * lasting - cost * (action**2).sum()
        np.testing.assert_allclose(step.reward, ideal, atol=1e-9)
        np.testing.assert_allclose(simulation.state().qpos[0], world.data.qpos, atol=1e-12)


def test_a_fast_walker_is_paid_fifteen_for_steps_of_16_ms() -> None:
    """ProMP's variant: the same physics, twice as long a control step, another bonus."""
    slow, fast = (
        Simulation(task, 3, [Goal()], threads=1)
        for task in (Walker2dVelocity(), Walker2dFastVelocity())
    )
    for simulation in (slow, fast):
        simulation.reset(IDS, np.full((3, 1), 4.0), SEEDS)
    action = np.full((3, 6), 0.2)
    first, second, whole = slow.step(None, action), slow.step(None, action), fast.step(None, action)
    np.testing.assert_allclose(fast.state().qpos, slow.state().qpos, atol=1e-12)
    velocity = 4.0 - (1.0 - np.array([first.reward, second.reward]))  # below 4 m/s: no kink
    np.testing.assert_allclose(whole.reward, 15.0 - (4.0 - velocity.mean(axis=0)), atol=1e-9)


def test_an_ant_is_paid_for_being_near_a_point() -> None:
    """Minus the distances along x and y; it sees itself and not the point; a fall ends nothing."""
    points = np.array([[3.0, -3.0], [0.0, 0.0], [-1.0, 2.0]])
    simulation = Simulation(AntPosition(), 3, [Goal(axes=2)], threads=1)
    plain = Simulation(Ant(), 3, threads=1)
    assert simulation.space.names == ("goal.x", "goal.y")
    seen, other = simulation.reset(IDS, points, SEEDS), plain.reset(IDS, np.zeros((3, 0)), SEEDS)
    np.testing.assert_array_equal(seen[:, 2:], other)
    step = simulation.step(None, np.full((3, 8), 0.5))
    place = simulation.state().qpos[:, :2]
    np.testing.assert_array_equal(step.observation[:, :2], place)
    np.testing.assert_allclose(step.reward, -np.abs(place - points).sum(axis=1), atol=1e-12)
    state = simulation.state()
    state.qpos[:, 2] = 0.1  # below what is healthy
    simulation.set_state(IDS, state.qpos, state.qvel)
    assert not simulation.step(None, np.zeros((3, 8))).terminated.any()


@pytest.mark.parametrize(
    ("task", "plain"),
    [(SwimmerVelocity(), Swimmer()), (Walker2dDirection(), Walker2d()), (AntVelocity(), Ant())],
)
def test_the_policy_does_not_see_the_goal(task: Task, plain: Task) -> None:
    """Observations are those of the task without a goal, to the bit."""
    observed = []
    for one, effects, values in ((task, [Goal()], GOALS[:, None]), (plain, [], np.zeros((3, 0)))):
        simulation = Simulation(one, 3, effects, threads=1)
        simulation.reset(IDS, values, SEEDS)
        action = np.full((3, simulation.action_size), 0.1)
        observed.append(simulation.step(None, action).observation)
    np.testing.assert_array_equal(*observed)


def test_a_goal_has_as_many_axes_as_the_task_asks_for() -> None:
    """A point for a task of directions, and the other way round, are refused in a sentence."""
    with pytest.raises(EffectError, match="axes=2, SwimmerDirection asks for 1"):
        Simulation(SwimmerDirection(), 1, [Goal(axes=2)])
    with pytest.raises(EffectError, match="axes=1, AntPosition asks for 2"):
        Simulation(AntPosition(), 1, [Goal()])
    with pytest.raises(EffectError, match="axes=3 must be 1, or 2"):
        Goal(axes=3)


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
    with pytest.raises(EffectError, match="goal belongs to a task, but no task here has one"):
        Simulation(Hopper(), 1, [Goal()])
    with pytest.raises(EffectError, match="env=halfcheetah_direction"):
        Simulation(Hopper(), 1, fixed=[(Goal(), [1.0])])
    assert "goal" in EFFECTS and not EFFECTS["goal"].visible_in_replay
