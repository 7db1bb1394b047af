"""A policy that is told latent numbers: the perceptron of both, and a search of them."""

import numpy as np
import pytest
import torch

from sim2real.learning.adapt import LatentSearch
from sim2real.learning.modules.latent import LatentPolicy
from sim2real.learning.modules.mlp_policy import MLPPolicy
from sim2real.runs.errors import Sim2RealError

LIMITS = (-np.ones(2), np.ones(2))
OPTIONS = {"hidden": (5,), "activation": "tanh", "output": "tanh", "initial": "normal"}


def make(latent: int = 3) -> LatentPolicy:
    """Return a policy of four numbers and some latent ones."""
    return LatentPolicy(4, 2, *LIMITS, latent=latent, **OPTIONS)


def test_it_is_the_perceptron_of_observation_and_latent_numbers() -> None:
    """Told z beside the observation, a perceptron with the same weights acts the same."""
    policy, wider = make(), MLPPolicy(7, 2, *LIMITS, **OPTIONS)
    rng = np.random.default_rng(0)
    theta = rng.normal(size=policy.num_parameters).astype(np.float32)
    seen, z = rng.normal(size=4), theta[-3:]
    own, told = theta[: 4 * 5], theta[-3 - 3 * 5 : -3]
    both = np.concatenate([own, told, theta[4 * 5 : -3 - 3 * 5]])
    zero, one = np.zeros(7), np.ones(7)
    ideal = wider.module(both, zero, one)(torch.from_numpy(np.concatenate([seen, z]))).detach()
    got = policy.module(theta, zero[:4], one[:4])(torch.from_numpy(seen))
    torch.testing.assert_close(got, ideal, atol=1e-6, rtol=0)
    slots = policy.slots(2)
    slots.load(np.array([1]), theta[None])
    acted = slots.act(np.array([1]), seen[None])
    np.testing.assert_allclose(acted[0], ideal.numpy(), atol=1e-6)
    moved = theta.copy()
    moved[-1] += 1.0
    slots.load(np.array([0]), moved[None])
    assert np.abs(slots.act(None, np.tile(seen, (2, 1)))[0] - acted[0]).max() > 1e-3


def test_a_row_does_not_depend_on_the_others() -> None:
    """Many vectors become perceptrons one by one, to the bit; the first has z of 0."""
    policy = make()
    rng = np.random.default_rng(1)
    assert not policy.initial(rng)[-3:].any()
    thetas = rng.normal(size=(6, policy.num_parameters)).astype(np.float32)
    single = np.concatenate([policy.plain(theta[None]) for theta in thetas])
    np.testing.assert_array_equal(policy.plain(thetas), single)


def test_a_search_moves_latent_numbers_alone() -> None:
    """All other parameters stay; the latent ones find the top of a hill."""
    policy = make(2)
    theta = policy.initial(np.random.default_rng(0))
    search = LatentSearch(dims=2, mode="sequential", queries=60, parallel=1, sigma=0.3)
    search.check(policy)
    session = search.start(theta, np.random.default_rng(0))
    while (candidate := session.ask()) is not None:
        np.testing.assert_array_equal(candidate[:-2], theta[:-2])
        session.tell(-float(np.square(candidate[-2:] - 1).sum()))
    np.testing.assert_allclose(session.result[-2:], 1.0, atol=0.4)
    assert str(search).startswith("a search of 2 latent numbers by sequential hill climbing, 61")


def test_a_policy_without_latent_numbers_is_refused() -> None:
    """Else the search would move the last biases; so is another number of them, and none at all."""
    search = LatentSearch(dims=2, mode="sequential", queries=1, parallel=1, sigma=0.3)
    with pytest.raises(
        Sim2RealError, match="has no latent numbers to search; choose policy=latent"
    ):
        search.check(MLPPolicy(4, 2, *LIMITS, **OPTIONS))
    with pytest.raises(Sim2RealError, match=r"has 3 latent .*; set adapt\.dims=3"):
        search.check(make(3))
    with pytest.raises(Sim2RealError, match=r"adapt\.dims=0"):
        LatentSearch(dims=0, mode="sequential", queries=1, parallel=1, sigma=0.3)
    with pytest.raises(Sim2RealError, match=r"policy\.latent=0"):
        make(0)
