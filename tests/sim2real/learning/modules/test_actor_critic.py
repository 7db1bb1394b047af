"""Policies of tensordict modules: memories, shared bodies, what does not fit."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn
from torchrl.modules import set_recurrent_mode

from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.base import build
from sim2real.learning.algorithms.ppo import PPO
from sim2real.learning.modules.actor_critic import _is_unconverted
from sim2real.runs.errors import Sim2RealError

GRU = ["policy=gru", "policy.window=8", "algorithm.num_rows=6", "algorithm.steps=16"]
PIXELS = ["env=hopper_polito_pixels", "policy=cnn", "env.size=36", "algorithm.num_rows=2"]
PIXELS += ["algorithm.steps=8"]


def learner(*words: str, seed: int = 0) -> PPO:
    """Return an untrained PPO."""
    short = ["env.task.max_steps=20", "algorithm.minibatch_size=16", "algorithm.epochs=2"]
    tree = compose(["algorithm=ppo_sb3", f"seed={seed}", *short, *words])
    _, given = instantiate(tree, Path())
    made = build(given["algorithm"], given["parts"])
    assert isinstance(made, PPO)
    return made


def test_learning_sees_what_acting_did() -> None:
    """Before any update, laws over windows with ends of episodes equal those that acted.

    So ratios of probabilities start at 1, and the first loss is that of the policy that acted.
    """
    algorithm = learner("env=hopper", *GRU, "env.task.max_steps=12")  # less than a batch's 16
    for _ in range(2):  # the second batch starts within episodes
        data = algorithm.collecting.next()
        assert data["next", "done"].any()
        with torch.no_grad():
            samples = algorithm._samples(algorithm._advantage(data))
            assert samples.shape == (12, 8)
            with set_recurrent_mode(True):
                law = algorithm.policy.actor.get_dist(samples.clone())
        again = law.log_prob(samples["action"])
        torch.testing.assert_close(again, samples["action_log_prob"], atol=1e-5, rtol=1e-5)
    starts = data["is_init"][..., 0]
    assert (data["recurrent_state"][starts] == 0).all() and starts[:, 1:].any()


def test_gradients_reach_back_a_window_and_stop_at_a_start() -> None:
    """The last step's action depends on the first observation, unless an episode starts between."""
    algorithm = learner("env=hopper", *GRU)
    whole = algorithm._samples(algorithm._advantage(algorithm.collecting.next()))
    data: Any = whole[:2].clone()
    data["is_init"] = torch.zeros(2, 8, 1, dtype=torch.bool)
    data["is_init"][1, 4] = True
    seen = data["observation"].detach().clone().requires_grad_()
    data["observation"] = seen
    with set_recurrent_mode(True):
        algorithm.policy.actor.get_dist(data).mean[:, -1].sum().backward()
    assert seen.grad is not None
    reach = seen.grad.abs().sum(-1) > 0
    assert reach[0].all() and reach[1].tolist() == [False] * 4 + [True] * 4


def test_a_trained_memory_acts_as_in_training() -> None:
    """A pilot sees what the environment shows and does what the actor does there, step by step."""
    algorithm = learner("env=hopper", *GRU)
    algorithm.iterate()
    trained = algorithm.trained()
    pilot, rows = trained.controller(), algorithm.parts.environment.base_rows(1)
    seed, first = np.array([3], np.uint64), np.arange(1)
    returns = []
    for _ in range(2):
        pilot.reset()
        seen, total, over = rows.reset(first, rows.space.points(1), seed), 0.0, False
        while not over:
            step = rows.step(None, np.clip(pilot(seen), rows.action_low, rows.action_high))
            seen, total = step.observation, total + step.reward[0]
            over = bool(step.terminated[0] | step.truncated[0])
        returns.append(total)
    assert returns[0] == returns[1]
    np.testing.assert_allclose(trained.run_episodes(seed).returns, returns[0], rtol=1e-4)


@pytest.mark.parametrize("words", [["env=hopper", *GRU], PIXELS])
def test_a_loaded_state_goes_on_to_the_last_bit(words: list[str]) -> None:
    """Memories and stacked images of episodes in progress are part of the state."""
    first, second = learner(*words), learner(*words, seed=5)
    for _ in range(2):
        first.iterate()
    second.load_state_dict(first.state_dict())
    for _ in range(2):
        assert first.iterate() == second.iterate()


def test_what_actor_and_critic_share_gets_the_gradient_of_both() -> None:
    """The loss calls the critic's own part on what the actor has just computed, not on old data."""
    algorithm = learner(*PIXELS)
    with torch.no_grad():
        samples = algorithm._samples(algorithm._advantage(algorithm.collecting.next()))
    with torch.no_grad():
        samples["features"] = torch.full((len(samples), 512), 1e3)  # what was there before
    losses = algorithm._loss(samples)
    losses["loss_critic"].backward()
    policy: Any = algorithm.policy
    body = [p for p in policy.actor.parameters() if p.dim() == 4]
    assert len(body) == 3 and all(float(p.grad.norm()) > 0 for p in body)
    with torch.no_grad():
        value = policy.critic(samples.clone())["state_value"]
    expected = 0.5 * nn.functional.mse_loss(value, samples["value_target"])
    torch.testing.assert_close(losses["loss_critic"], expected)


def test_what_does_not_fit_is_said() -> None:
    """A window that divides no iteration, images as whole numbers, a network of another kind."""
    with pytest.raises(Sim2RealError, match=r"window=8 does not divide algorithm\.steps=20"):
        learner("env=hopper", *GRU, "algorithm.steps=20")
    with pytest.raises(Sim2RealError, match=r"unsigned char.*transforms=pixels"):
        learner(*PIXELS, "transforms=none")
    with pytest.raises(Sim2RealError, match=r"Kernel size.*the image is too small") as small:
        learner(*PIXELS, "env.size=16")
    assert "transforms" not in str(small.value)


@pytest.mark.parametrize(
    ("shape", "dtype", "unconverted"),
    [
        ((1, 36, 36, 3), torch.float32, True),
        ((1, 4, 36, 36), torch.uint8, True),
        ((1, 4, 36, 36), torch.float32, False),
        ((1, 11), torch.float32, False),
    ],
)
def test_an_image_of_bytes_or_with_channels_last_is_unconverted(
    shape: tuple[int, ...], dtype: torch.dtype, unconverted: bool
) -> None:
    """Those a transform has still to turn into what a network reads."""
    assert _is_unconverted(torch.zeros(shape, dtype=dtype)) is unconverted
