"""Actor and critic over images."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
import torch

from sim2real.learning.modules.conv_actor_critic import ConvActorCritic
from sim2real.runs.errors import Sim2RealError

LOW, HIGH = -np.ones(3), np.ones(3)


def network(
    channels: int = 2, size: int = 36, precision: Literal["float32", "bfloat16"] = "float32"
) -> ConvActorCritic:
    """Return an initialized network."""
    policy = ConvActorCritic(
        channels * size * size, 3, LOW, HIGH, size=size, log_std=-0.5, precision=precision
    )
    policy.initialize(torch.Generator().manual_seed(0))
    return policy


def test_it_is_nature_cnn() -> None:
    """For four images of 84 px it has as many parameters as Mnih et al.'s, and two heads."""
    policy = network(channels=4, size=84)
    convolutions = 32 * (4 * 64 + 1) + 64 * (32 * 16 + 1) + 64 * (64 * 9 + 1)
    dense = 512 * (64 * 7 * 7 + 1)
    assert policy.theta.numel() == convolutions + dense + 3 * 513 + 513 + 3


def test_the_actor_is_the_policys_mean() -> None:
    """The module that acts afterwards computes the same, cut at the limits."""
    policy = network()
    images = torch.rand(5, policy.observation_size, generator=torch.Generator().manual_seed(1))
    mean, log_std, value = policy(images)
    assert value.shape == (5,) and (log_std == -0.5).all()
    torch.testing.assert_close(policy.mean(images), mean)
    zeros, ones = np.zeros(policy.observation_size), np.ones(policy.observation_size)
    torch.testing.assert_close(policy.actor(zeros, ones)(images), mean.clamp(-1, 1))
    one = policy.actor(zeros, ones)(images[0])
    torch.testing.assert_close(one, mean[0].clamp(-1, 1))


def test_the_actor_begins_near_zero_and_sees() -> None:
    """Orthogonal weights of gain 0.01 give small means, that depend on every channel."""
    policy = network()
    images = torch.rand(1, policy.observation_size, generator=torch.Generator().manual_seed(2))
    images.requires_grad_()
    mean = policy(images)[0]
    assert mean.abs().max() < 0.1
    mean.sum().backward()
    assert images.grad is not None
    assert (images.grad.view(2, 36, 36).abs().amax((1, 2)) > 0).all()


def test_half_precision_rounds_the_features_alone() -> None:
    """Means, values and gradients keep float32's type and agree to bfloat16's three digits."""
    images = torch.rand(8, 2 * 36 * 36, generator=torch.Generator().manual_seed(3))
    found = []
    for precision in ("float32", "bfloat16"):
        policy = network(precision=precision)
        mean, _, value = policy(images)
        (mean.sum() + value.sum()).backward()
        found.append((mean.detach(), value.detach(), policy.theta.grad))
    for exact, rounded in zip(*found, strict=True):
        assert rounded.dtype == torch.float32
        off = (rounded - exact).norm() / exact.norm()
        assert 0 < off < 0.03


def test_what_is_no_image_is_refused() -> None:
    """A size that does not divide the observation, or is too small, is one sentence."""
    with pytest.raises(Sim2RealError, match="11 numbers are no images of 84 x 84 px"):
        ConvActorCritic(11, 3, LOW, HIGH, size=84, log_std=0.0, precision="float32")
    with pytest.raises(Sim2RealError, match=r"policy.size=20 px is too small .* 36 or more"):
        network(channels=1, size=20)
    with pytest.raises(Sim2RealError, match="float16 is not known; it is float32 or bfloat16"):
        network(precision="float16")  # pyright: ignore[reportArgumentType]
