"""Navigation tasks: rewards and endings as published, independent rows, noise by its law."""

import numpy as np
import pytest

from envs.errors import ParameterError, TaskError
from envs.toys import Combo, ComboGoals, Corners, FourCorners, Nav2D, NavGoals, NoisyNav2D


def episode(env: Nav2D, values: np.ndarray, seeds: np.ndarray, action: np.ndarray) -> np.ndarray:
    """Returns of a constant action in every row, until each row's end."""
    ids = np.arange(env.num_rows)
    env.reset(ids, values, seeds)
    totals = np.zeros(env.num_rows)
    while len(ids):
        step = env.step(ids, np.tile(action, (len(ids), 1)))
        totals[ids] += step.reward
        ids = ids[~np.asarray(step.terminated | step.truncated)]
    return totals


def test_walking_to_the_goal_ends_the_episode() -> None:
    """Reward is minus the squared distance after the move; it ends within 0.1 m, not by time."""
    env = Nav2D(1)
    env.reset(np.array([0]), np.array([[0.5, 0.0]]), np.zeros(1, np.uint64))
    rewards = []
    for _ in range(4):
        step = env.step(None, np.array([[5.0, 0.0]]))  # clipped to 0.1
        rewards.append(float(step.reward[0]))
    np.testing.assert_allclose(rewards, [-0.16, -0.09, -0.04, -0.01])
    step = env.step(None, np.array([[0.01, 0.0]]))
    assert step.terminated[0]
    assert not step.truncated[0]


def test_the_box_holds_and_time_ends() -> None:
    """A point that runs into the wall stays there, and the hundredth step truncates."""
    env = Nav2D(1)
    env.reset(np.array([0]), np.array([[-1.0, -1.0]]), np.zeros(1, np.uint64))
    for _ in range(100):
        step = env.step(None, np.array([[0.1, 0.1]]))
    np.testing.assert_allclose(step.observation, [[1.0, 1.0]])
    assert step.truncated[0]
    assert step.reward[0] == pytest.approx(-8)


def test_corners_pay_only_nearby() -> None:
    """Farther than 2 m from the goal every place pays -4; at the goal 0; the episode goes on."""
    env = FourCorners(2)
    env.reset(np.arange(2), np.array([[2.0, 2.0], [-2.0, 2.0]]), np.zeros(2, np.uint64))
    for _ in range(20):
        step = env.step(None, np.full((2, 2), 0.1))
    np.testing.assert_allclose(step.reward, [0, -4], atol=1e-12)
    assert not step.terminated.any()


def test_wrong_goals_cost_dearly_and_right_ones_stop_costing() -> None:
    """The closed form on the way to a corner that is right in row 0 and wrong in row 1.

    Goal 0 lies at (2, 2). A wrong goal within 2 m costs 1e4 (4 - d^2); a right one that was reached
    costs nothing from then on, and starts to cost again with the next episode.
    """
    env = Combo(2)
    goals = np.array([[0.0], [2.0]])  # right: (2, 2), and (-2, -2)
    for _ in range(2):
        env.reset(np.arange(2), goals, np.zeros(2, np.uint64))
        for moves in range(1, 21):
            step = env.step(None, np.full((2, 2), 0.1))
            squared = 2 * (2 - 0.1 * moves) ** 2
            found = -min(squared, 4.0) if squared >= 0.01 else 0.0
            lost = -4.0 + 1e4 * min(0.0, squared - 4.0)
            np.testing.assert_allclose(step.reward, [found, lost], rtol=1e-9, atol=1e-9)
    for _ in range(20):  # away again
        step = env.step(None, np.full((2, 2), -0.1))
    np.testing.assert_allclose(step.reward, [0.0, -4.0])


def test_choices_of_several_goals() -> None:
    """Each choice of two goals of five is drawn, and pays for those two."""
    tasks, env = ComboGoals(5, 2), Combo(10, 5, 2)
    assert tasks.distinct is not None and len(tasks.distinct) == 10
    tasks.check(env.space)
    drawn = tasks.sample(np.random.default_rng(0), 500)
    assert set(drawn.ravel()) == set(range(10))
    env.reset(np.arange(10), tasks.distinct, np.zeros(10, np.uint64))
    still = env.step(None, np.zeros((10, 2)))
    np.testing.assert_allclose(still.reward, -8.0)  # both 2.8 m away, no wrong one within 2 m
    for goals, right in ((4, 0), (4, 4)):
        with pytest.raises(TaskError, match=f"right={right} must be at least 1"):
            Combo(1, goals, right)


def test_subsets_and_other_rows_change_nothing() -> None:
    """A row stepped in a subset, or beside other rows, goes through the same states."""
    rng = np.random.default_rng(0)
    values, seeds = NavGoals().sample(rng, 5), rng.integers(0, 2**63, 5, dtype=np.uint64)
    actions = rng.uniform(-0.1, 0.1, (30, 5, 2))
    many, one = Nav2D(5), Nav2D(1)
    many.reset(np.arange(5), values, seeds)
    one.reset(np.array([0]), values[3:4], seeds[3:4])
    for t, action in enumerate(actions):
        ids = np.arange(5) if t % 2 else np.array([1, 3])
        step = many.step(None if t % 2 else ids, action[ids])
        alone = one.step(None, action[3:4])
        np.testing.assert_array_equal(step.observation[ids == 3], alone.observation)
        np.testing.assert_array_equal(step.reward[ids == 3], alone.reward)


def test_return_noise_follows_its_law_and_its_seed() -> None:
    """Gaussian noise has its spread, corruption hurts its share only; 0 switches noise off."""
    count = 4000
    goals = np.ones((count, 2))
    seeds = np.arange(count, dtype=np.uint64)
    walk = np.array([0.1, 0.1])
    clean = episode(Nav2D(count), goals, seeds, walk)
    on, off = (np.column_stack([goals, np.full(count, k)]) for k in (1.0, 0.0))
    gaussian = NoisyNav2D(count, "gaussian", 20.0)
    error = episode(gaussian, on, seeds, walk) - clean
    assert error.mean() == pytest.approx(0, abs=1.5)
    assert error.std() == pytest.approx(20, rel=0.05)
    np.testing.assert_array_equal(episode(gaussian, on, seeds, walk) - clean, error)
    np.testing.assert_array_equal(episode(gaussian, off, seeds, walk), clean)
    corrupt = episode(NoisyNav2D(count, "corrupt", 50.0, share=0.3), on, seeds, walk) - clean
    assert (corrupt <= 0).all()
    assert (corrupt < 0).mean() == pytest.approx(0.3, abs=0.03)


def test_tasks_fit_their_environments_only() -> None:
    """Draws lie in the task's space; tasks of another environment are refused by name."""
    rng = np.random.default_rng(0)
    NavGoals().check(Nav2D(1).space)
    Nav2D(1).space.validate(NavGoals().sample(rng, 100))
    assert {tuple(row) for row in Corners().sample(rng, 200)} == {
        (x, y) for x in (-2.0, 2.0) for y in (-2.0, 2.0)
    }
    with pytest.raises(ParameterError, match="return_noise"):
        NavGoals(return_noise=1.0).check(Nav2D(1).space)
    with pytest.raises(ParameterError, match=r"goal\.x = 3"):
        Nav2D(1).reset(np.array([0]), np.array([[3.0, 0.0]]), np.zeros(1, np.uint64))


def test_bad_input_is_refused() -> None:
    """Impossible sizes, noises and actions are errors that name the value."""
    with pytest.raises(TaskError, match="num_rows=0"):
        Nav2D(0)
    with pytest.raises(TaskError, match="share=2"):
        NoisyNav2D(1, "corrupt", 1.0, share=2)
    with pytest.raises(TaskError, match="shape"):
        Nav2D(2).step(None, np.zeros((1, 2)))
