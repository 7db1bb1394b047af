"""The policy that remembers: its unit is torch's, its windows are its episodes, it resumes."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from envs import Simulation
from envs.effects import make
from envs.randomization import Draw, Randomization
from envs.tasks import HopperPolito
from sim2real.config.compose import compose
from sim2real.config.targets import build
from sim2real.learning.algorithms.experience import gather
from sim2real.learning.algorithms.ppo import PPO
from sim2real.learning.modules.gru_actor_critic import GRUActorCritic
from sim2real.runs.errors import Sim2RealError

SHAPE: dict[str, Any] = {"hidden": (8,), "activation": "tanh", "log_std": 0.0}


def network(memory: int = 6, window: int = 4) -> GRUActorCritic:
    """Return a policy of 5 observations and 2 actions whose heads see what it remembers."""
    limits = (-np.ones(2), np.ones(2))
    policy = GRUActorCritic(5, 2, *limits, **SHAPE, memory=memory, window=window)
    policy.initialize(generator(0))
    with torch.no_grad():
        policy.theta.add_(0.2 * torch.randn(policy.theta.shape, generator=generator(1)))
    return policy


def generator(seed: int) -> torch.Generator:
    """Return a seeded generator."""
    return torch.Generator().manual_seed(seed)


def learner(seed: int = 0, **changes: Any) -> PPO:
    """Return an untrained PPO of short, randomized Hoppers with a memory."""
    tree = compose(["algorithm=ppo", "policy=gru"])
    small = {"num_rows": 6, "steps": 32, "minibatch_size": 64, "epochs": 2}
    tasks = Randomization([Draw(make("link_mass", where="torso"), low=-1.0, high=1.0)])
    parts = {"env": partial(Simulation, HopperPolito(max_steps=20)), "tasks": tasks}
    parts["policy"] = build(tree["policy"], "policy")
    made = build(tree["algorithm"] | small | changes, "algorithm")(**parts, seed=seed, device="cpu")
    assert isinstance(made, PPO)
    return made


def test_the_memory_is_torchs_gated_recurrent_unit() -> None:
    """A window from a fresh start remembers what `torch.nn.GRU` does, step for step."""
    policy, seen = network(), torch.randn(3, 9, 5, generator=generator(2))
    unit = nn.GRU(5, 6, batch_first=True)
    with torch.no_grad():
        for own, value in zip(unit.parameters(), policy.gates(policy.theta), strict=True):
            own.copy_(value)
        ones = torch.ones(3, 9, 6)
        ones[:, 0] = 0
        remembered = policy._remember(torch.cat([seen, ones], -1))
        torch.testing.assert_close(remembered, unit(seen)[0])


def test_learning_sees_what_acting_did() -> None:
    """Before any update, means over windows with ends of episodes equal those that acted.

    So ratios of probabilities start at 1, and the first loss is that of the policy that acted.
    """
    algorithm = learner()
    batch = None
    for _ in range(2):  # the second batch starts within episodes
        given = gather(
            algorithm.stream,
            algorithm.policy,
            32,
            np.random.default_rng(0),
            None,
            algorithm._memory,
        )
        batch = algorithm._prepare(given)
        assert given.over.any() and batch.observation.shape[:2] == (12, 16)
    assert batch is not None
    divergence, clipped = algorithm._divergence(batch)
    assert abs(divergence) < 1e-9 and clipped == 0
    memory = batch.observation[..., 11:]
    starts = (memory == 0).all(-1)
    assert starts[:, 1:].any() and not starts.all()


def test_gradients_reach_back_a_window_and_stop_at_a_start() -> None:
    """The last step's value depends on the first observation, unless an episode starts between."""
    policy, seen = network(), torch.randn(2, 4, 11, generator=generator(3))
    seen[1, 2, 5:] = 0.0  # the second window starts anew at its third step
    seen.requires_grad_()
    policy(seen)[2][:, -1].sum().backward()
    assert seen.grad is not None
    reach = seen.grad[..., :5].abs().sum(-1) > 0
    assert reach.tolist() == [[True, True, True, True], [False, False, True, True]]


def test_the_actor_remembers_what_it_is_given() -> None:
    """Alone, it acts as in training, row by row; a fresh one starts afresh."""
    policy = network()
    actor = policy.actor(np.full(5, 0.3), np.full(5, 2.0))
    memory, seen = torch.zeros(4, 6), torch.randn(5, 4, 5, generator=generator(4)).double()
    with torch.no_grad():
        first = actor(seen[0])
        for t in range(5):
            normalized = ((seen[t] - 0.3) / 2.0).float()
            mean, memory = policy.advance(torch.cat([normalized, memory], -1))
            own = first if t == 0 else actor(seen[t])
            torch.testing.assert_close(own, mean.clamp(-1, 1), atol=1e-6, rtol=1e-5)
        fresh = policy.actor(np.full(5, 0.3), np.full(5, 2.0))
        torch.testing.assert_close(fresh(seen[0]), first)
        assert not torch.equal(actor(seen[0]), first)
        alone = policy.actor(np.full(5, 0.3), np.full(5, 2.0))
        torch.testing.assert_close(alone(seen[0, 2]), first[2])


def test_a_loaded_state_goes_on_to_the_last_bit() -> None:
    """The memories of episodes in progress are part of the state."""
    first = learner()
    for _ in range(2):
        first.iterate()
    second = learner(seed=5)
    second.load_state_dict(first.state_dict())
    for _ in range(2):
        assert first.iterate() == second.iterate()
    assert torch.equal(first.policy.theta, second.policy.theta)


def test_a_window_must_divide_the_steps() -> None:
    """Both numbers are named; a memory of nothing is refused."""
    with pytest.raises(Sim2RealError, match=r"window=16 does not divide algorithm\.steps=40"):
        learner(steps=40)
    with pytest.raises(Sim2RealError, match="memory=0 and window=4"):
        network(memory=0)
