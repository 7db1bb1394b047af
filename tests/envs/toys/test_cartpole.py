"""Biased CartPole: Gymnasium's dynamics, a continuous force and a sensor that is off."""

from typing import Any

import gymnasium
import numpy as np

from envs.toys import AngleBias, BiasedCartPole


def test_dynamics_are_those_of_gymnasium() -> None:
    """At full force and without bias, states and the fall agree with Gymnasium's CartPole-v1."""
    reference: Any = gymnasium.make("CartPole-v1").unwrapped
    env, rng = BiasedCartPole(1), np.random.default_rng(0)
    for seed in range(20):
        start = env.reset(np.array([0]), np.zeros((1, 1)), np.array([seed], np.uint64))
        assert (np.abs(start) <= 0.05).all()
        reference.reset()
        reference.state = start[0]
        over = False
        while not over:
            push = int(rng.integers(2))
            expected, _, over, _, _ = reference.step(push)
            step = env.step(None, np.array([[20.0 * push - 10.0]]))
            np.testing.assert_allclose(step.observation[0], expected, rtol=1e-5, atol=1e-6)
            assert bool(step.terminated[0]) == over


def test_bias_changes_the_measured_angle_only() -> None:
    """Two rows with the same seed and force differ in the angle by the bias and in nothing else."""
    env = BiasedCartPole(2)
    first = env.reset(np.arange(2), np.array([[0.0], [0.1]]), np.array([5, 5], np.uint64))
    later = env.step(None, np.array([[3.0], [3.0]])).observation
    for observation in (first, later):
        np.testing.assert_allclose(observation[1] - observation[0], [0, 0, 0.1, 0], atol=1e-12)


def test_reward_counts_the_steps_upright() -> None:
    """Each step upright pays 1, the one that falls 0; a pole that stays up is truncated at 500."""
    env = BiasedCartPole(1)
    env.reset(np.array([0]), np.zeros((1, 1)), np.array([1], np.uint64))
    rewards, over = [], False
    while not over:
        step = env.step(None, np.array([[10.0]]))
        rewards.append(float(step.reward[0]))
        over = bool(step.terminated[0])
    assert rewards == [1.0] * (len(rewards) - 1) + [0.0]
    observation = env.reset(np.array([0]), np.zeros((1, 1)), np.array([1], np.uint64))
    gain = np.array([1.0, 2.0, 60.0, 10.0])
    for _ in range(500):
        step = env.step(None, observation @ gain[:, None])
        observation = step.observation
    assert step.truncated[0]
    assert not step.terminated[0]


def test_biases_cover_their_range() -> None:
    """Draws lie within the limit on both sides and fit the environment."""
    tasks = AngleBias()
    biases = tasks.sample(np.random.default_rng(0), 1000)
    tasks.check(BiasedCartPole(1).space)
    assert np.abs(biases).max() <= tasks.limit
    assert biases.min() < -0.9 * tasks.limit
    assert biases.max() > 0.9 * tasks.limit
