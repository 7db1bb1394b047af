"""The policy network: rows are independent, torch computes the same, bad shapes are refused."""

import numpy as np
import pytest
import torch

from sim2real.learning.modules.mlp_policy import MLPPolicy

LOW, HIGH = np.array([-1.0, -0.5, 0.0]), np.array([1.0, 0.5, 2.0])


def make(**changes) -> MLPPolicy:
    """Policy of Hopper's sizes."""
    options = {"hidden": (64, 64), "activation": "tanh", "output": "tanh", "initial": "normal"}
    return MLPPolicy(11, 3, LOW, HIGH, **(options | changes))


@pytest.mark.parametrize("hidden", [(), (32,), (64, 64)])
def test_rows_do_not_depend_on_the_batch(hidden: tuple[int, ...]) -> None:
    """A row's action has the same bits alone, among others, and in a shuffled subset."""
    policy, rng = make(hidden=hidden), np.random.default_rng(0)
    thetas = np.stack([policy.initial(rng) for _ in range(37)])
    observation = rng.standard_normal((37, 11))
    slots = policy.slots(37)
    slots.load(np.arange(37), thetas)
    together = slots.act(None, observation)
    for ids in (np.array([5]), np.array([0, 7, 36]), np.arange(1, 37)):
        np.testing.assert_array_equal(slots.act(ids, observation[ids]), together[ids])
    alone = policy.slots(1)
    for row in range(37):
        alone.load(np.array([0]), thetas[row : row + 1])
        np.testing.assert_array_equal(alone.act(None, observation[row : row + 1])[0], together[row])


def test_loading_a_row_changes_that_row_only() -> None:
    """New weights in a row show at once, also when a subset of rows acts twice in a row."""
    policy, rng = make(), np.random.default_rng(1)
    thetas = np.stack([policy.initial(rng) for _ in range(8)])
    slots, observation = policy.slots(8), rng.standard_normal((8, 11))
    slots.load(np.arange(8), thetas)
    ids = np.array([1, 4, 6])
    before = slots.act(ids, observation[ids])
    slots.load(np.array([4]), thetas[:1])
    after = slots.act(ids, observation[ids])
    assert np.array_equal(before[[0, 2]], after[[0, 2]])
    assert not np.array_equal(before[1], after[1])


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("output", ["tanh", "linear"])
@pytest.mark.parametrize("hidden", [(), (32,), (64, 32)])
def test_torch_module_is_the_same_function(hidden: tuple[int, ...], activation, output) -> None:
    """The torch module agrees with the numpy rows on raw observations, normalization included."""
    policy = make(hidden=hidden, activation=activation, output=output)
    rng = np.random.default_rng(2)
    theta = policy.initial(rng) + 0.1 * rng.standard_normal(policy.num_parameters).astype(
        np.float32
    )
    mean, std = rng.standard_normal(11), rng.uniform(0.5, 2, 11)
    observation = rng.standard_normal((20, 11))
    slots = policy.slots(20)
    slots.load(np.arange(20), np.tile(theta, (20, 1)))
    expected = slots.act(None, (observation - mean) / std)
    module = policy.module(theta, mean, std)
    with torch.no_grad():
        got = module(torch.from_numpy(observation)).numpy()
    np.testing.assert_allclose(got, expected, atol=2e-6)


def test_squashed_actions_stay_within_limits() -> None:
    """Tanh output reaches towards both limits of each action and never beyond."""
    policy = make(hidden=())
    slots = policy.slots(2)
    thetas = np.zeros((2, policy.num_parameters), np.float32)
    thetas[0, -3:], thetas[1, -3:] = 50, -50
    slots.load(np.arange(2), thetas)
    action = slots.act(None, np.zeros((2, 11)))
    np.testing.assert_allclose(action, [HIGH, LOW])


def test_initial_weights_have_the_stated_variance() -> None:
    """Each layer's weights have variance 2 / fan_in of that layer, biases are 0."""
    policy = make(hidden=(200, 100))
    theta = policy.initial(np.random.default_rng(3))
    for weight, bias in zip(policy.pieces[::2], policy.pieces[1::2], strict=True):
        drawn = theta[weight.start : weight.stop]
        if drawn.size > 1000:
            assert drawn.var() == pytest.approx(2 / weight.shape[0], rel=0.1)
        assert not theta[bias.start : bias.stop].any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"activation": "gelu"}, "activation='gelu' is not one of tanh, relu"),
        ({"hidden": (0,)}, "at least 1"),
        ({"initial": "zero"}, "zero gradient"),
    ],
)
def test_impossible_networks_are_refused(changes: dict, message: str) -> None:
    """A network that cannot be built or cannot learn is an error with a remedy."""
    with pytest.raises(ValueError, match=message):
        make(**changes)


def test_module_refuses_parameters_of_another_network() -> None:
    """A parameter vector of the wrong length is named."""
    with pytest.raises(ValueError, match="parameters for a network"):
        make().module(np.zeros(5), np.zeros(11), np.ones(11))
