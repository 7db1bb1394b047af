"""Each task equals Gymnasium's environment of the same name."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from envs.quiet import no_deprecation_notice
from envs.simulation import Simulation
from envs.tasks import Ant, HalfCheetah, Hopper, InvertedPendulum, Swimmer, Task, Walker2d

STEPS = 1001  # one more than the time limit, so that tasks that never terminate are reset by it
ONE = np.arange(1)
WITHOUT_FORCES: dict[str, Any] = {
    "include_cfrc_ext_in_observation": False,
    "contact_cost_weight": 0,
}
PAIRS = [
    pytest.param(Hopper(), "Hopper-v5", {}, id="hopper"),
    pytest.param(Walker2d(), "Walker2d-v5", {}, id="walker2d"),
    pytest.param(HalfCheetah(), "HalfCheetah-v5", {}, id="half_cheetah"),
    pytest.param(Swimmer(), "Swimmer-v5", {}, id="swimmer"),
    pytest.param(InvertedPendulum(), "InvertedPendulum-v5", {}, id="inverted_pendulum"),
    pytest.param(Ant(), "Ant-v5", WITHOUT_FORCES, id="ant"),
    pytest.param(Ant(contact_forces="exact"), "Ant-v5", {}, id="ant_exact"),
]


def gymnasium_env(name: str, options: dict[str, Any]) -> gymnasium.Env:
    """Return Gymnasium's environment, its model's deprecation warning kept quiet."""
    with no_deprecation_notice():
        return gymnasium.make(name, disable_env_checker=True, **options)


@pytest.mark.parametrize(("task", "name", "options"), PAIRS)
def test_equals_gymnasium(task: Task, name: str, options: dict[str, Any]) -> None:
    """1,001 random steps agree to the last bit, through clamped actions, resets and time limits."""
    theirs, ours = gymnasium_env(name, options), Simulation(task, num_rows=1, threads=1)
    data = theirs.unwrapped.data  # type: ignore[attr-defined]
    rng = np.random.default_rng(0)

    def reset(seed: int) -> None:
        expected, _ = theirs.reset(seed=seed)
        ours.reset(ONE, np.zeros((1, 0)), np.zeros(1, np.uint64))
        observation = ours.set_state(ONE, data.qpos[None].copy(), data.qvel[None].copy())
        np.testing.assert_array_equal(observation[0], expected)

    reset(0)
    ends = 0
    for i in range(STEPS):
        action = 1.2 * rng.uniform(ours.action_low, ours.action_high)
        expected, reward, terminated, truncated, _ = theirs.step(action)
        step = ours.step(None, action[None])
        np.testing.assert_array_equal(step.observation[0], expected)
        assert step.reward[0] == reward
        assert (step.terminated[0], step.truncated[0]) == (terminated, truncated)
        assert not step.failed[0]
        if terminated or truncated:
            ends += 1
            reset(i)
    assert ends > 0


@pytest.mark.parametrize(("task", "name", "options"), PAIRS)
def test_spaces_and_limits_are_gymnasiums(task: Task, name: str, options: dict[str, Any]) -> None:
    """Sizes, action bounds and the time limit are those that Gymnasium registers."""
    theirs, ours = gymnasium_env(name, options), Simulation(task, num_rows=1, threads=1)
    assert theirs.observation_space.shape == (ours.observation_size,)
    np.testing.assert_array_equal(theirs.action_space.low, ours.action_low)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(theirs.action_space.high, ours.action_high)  # type: ignore[attr-defined]
    assert theirs.spec is not None
    assert theirs.spec.max_episode_steps == ours.max_steps


@pytest.mark.parametrize(("task", "name", "options"), PAIRS)
def test_starts_are_distributed_as_gymnasiums(task: Task, name: str, options) -> None:
    """Starting states have the mean and spread, per coordinate, that Gymnasium's have."""
    theirs, ours = gymnasium_env(name, options), Simulation(task, num_rows=1, threads=1)
    data = theirs.unwrapped.data  # type: ignore[attr-defined]
    drawn = []
    for seed in range(300):
        theirs.reset(seed=seed)
        drawn.append(np.concatenate([data.qpos, data.qvel]))
    expected = np.array(drawn)
    states = np.concatenate(ours.task.initial(np.arange(3000, dtype=np.uint64)), axis=1)
    spread = expected.std(0)
    np.testing.assert_allclose(
        states.mean(0), expected.mean(0), atol=4 * spread.max() / np.sqrt(300)
    )
    np.testing.assert_allclose(states.std(0), spread, rtol=0.2)


@pytest.mark.parametrize(
    "task", [Hopper(), Walker2d(), InvertedPendulum(), Ant()], ids=lambda t: type(t).__name__
)
def test_a_state_of_nan_is_unhealthy(task: Task) -> None:
    """NaN in the state terminates, as each comparison with it is false in Gymnasium."""
    simulation = Simulation(task, num_rows=1, threads=1)
    simulation.reset(ONE, np.zeros((1, 0)), np.zeros(1, np.uint64))
    state = simulation._state(ONE)
    assert not task.terminated(state)[0]
    assert task.terminated(state._replace(qpos=np.full_like(state.qpos, np.nan)))[0]
