"""Adaptation by PPO: held against TorchRL's, member by member, in sessions, and what it refuses."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictSequential
from torch import nn
from torch.nn.utils import parameters_to_vector
from torchrl.modules import MLP
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from envs import MujocoEnv
from envs.tasks import InvertedPendulum
from sim2real.learning.adapt import EpisodeTrajectory, PPOAdaptation
from sim2real.learning.adapt.batched_ppo import BatchedPPO, BlockedPPO, RolloutBatch
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.actor_critic import Policy, actor_critic
from sim2real.learning.modules.functional_actor import FunctionalActor
from sim2real.learning.modules.value import Critic, FunctionalCritic
from sim2real.runs.errors import Sim2RealError

ADAPT = PPOAdaptation(
    rounds=3,
    steps=40,
    epochs=2,
    minibatch_size=16,
    learning_rate=3e-3,
    eps=1e-5,
    clip_epsilon=0.2,
    critic_coeff=0.5,
    gamma=0.99,
    lmbda=0.95,
    max_grad_norm=0.5,
)


def policy(activation: type[nn.Module] = nn.ReLU) -> Policy:
    """Return a small actor and its critic."""
    torch.manual_seed(0)
    env = EnvironmentFactory(partial(MujocoEnv, task=InvertedPendulum())).make(2)
    network = partial(MLP, num_cells=[16, 8], activation_class=activation)
    return actor_critic(env, actor=network, critic=network, log_std=-0.3, orthogonal=False)


def networks(activation: type[nn.Module] = nn.ReLU) -> tuple[FunctionalActor, FunctionalCritic]:
    """Return its law and the critic's value."""
    made = policy(activation)
    return FunctionalActor(made.actor), FunctionalCritic(made.critic)


def parameters(made: Policy) -> torch.Tensor:
    """Return actor and critic as a member's vector."""
    assert made.critic is not None
    both = [*made.actor.parameters(), *made.critic.parameters()]
    return parameters_to_vector(both).detach()


def rounds(members: int, steps: int = 40, seed: int = 1) -> RolloutBatch:
    """Return steps of some members: episodes that the task ends, and such as time ends."""
    rng = torch.Generator().manual_seed(seed)
    shape = members, steps
    terminated = torch.rand(*shape, generator=rng) < 0.1
    return RolloutBatch(
        torch.randn(*shape, 4, generator=rng),
        torch.randn(*shape, 1, generator=rng),
        torch.randn(*shape, generator=rng),
        torch.randn(*shape, 4, generator=rng),
        terminated | (torch.rand(*shape, generator=rng) < 0.1),
        terminated,
    )


def orders(members: int, steps: int = 40, seed: int = 2) -> torch.Tensor:
    """Return in which order each pass of each member takes its steps."""
    rng = np.random.default_rng(seed)
    return torch.from_numpy(np.stack([ADAPT.orders(rng, steps) for _ in range(members)]))


def by_torchrl(made: Any, steps: RolloutBatch, order: torch.Tensor, optimizer: Any) -> None:
    """Improve a policy by a round of one member with TorchRL's parts."""
    loss = ClipPPOLoss(
        made.actor,
        made.critic,
        clip_epsilon=ADAPT.clip_epsilon,
        critic_coeff=ADAPT.critic_coeff,
        entropy_bonus=False,
        loss_critic_type="l2",
        normalize_advantage=True,
    )
    judge = GAE(
        gamma=ADAPT.gamma, lmbda=ADAPT.lmbda, value_network=made.critic, deactivate_vmap=True
    )
    after = {"observation": steps.after[0], "reward": steps.reward[0, :, None]}
    after |= {name: getattr(steps, name)[0, :, None] for name in ("done", "terminated")}
    data = TensorDict(
        {"observation": steps.observation[0], "action": steps.action[0], "next": after},
        [steps.reward.shape[1]],
    )
    with torch.no_grad():
        dist = made.actor.get_dist(data)
        data["action_log_prob"] = dist.log_prob(data["action"])
        judge(data)
    for one in order[0]:
        for chosen in one.split(ADAPT.minibatch_size):
            found = loss(data[chosen])
            optimizer.zero_grad()
            (found["loss_objective"] + found["loss_critic"]).backward()
            nn.utils.clip_grad_norm_(list(made.parameters()), ADAPT.max_grad_norm)
            optimizer.step()


@pytest.mark.parametrize("activation", [nn.ReLU, nn.Tanh])
def test_a_member_learns_as_by_torchrl(activation: type[nn.Module]) -> None:
    """Three rounds equal `GAE`, `ClipPPOLoss` and `torch.optim.Adam`, in the same order."""
    made, start = policy(activation), parameters(policy(activation))
    learner = BatchedPPO(ADAPT, *networks(activation), start[None])
    optimizer = torch.optim.Adam(made.parameters(), lr=ADAPT.learning_rate, eps=ADAPT.eps)
    for number in range(3):
        steps, order = rounds(1, seed=10 + number), orders(1, seed=20 + number)
        learner.learn(steps, order)
        by_torchrl(made, steps, order, optimizer)
    moved = (learner.thetas[0] - start).abs()
    assert float(moved.max()) > 1e-2
    torch.testing.assert_close(learner.thetas[0], parameters(made), atol=1e-5, rtol=1e-5)


def test_an_end_of_time_is_followed_by_its_value_and_no_other() -> None:
    """The target of a last step is its reward, plus the discounted value where time ended it."""
    law, value = networks()
    learner = BatchedPPO(ADAPT, law, value, parameters(policy())[None])
    steps = RolloutBatch(*(x[:, :3] for x in rounds(1)))
    terminated, done = torch.tensor([[True, False, False]]), torch.ones(1, 3, dtype=torch.bool)
    target = learner._samples(steps._replace(done=done, terminated=terminated)).target[0]
    later = value(value.vector(), steps.after[0]).detach()
    expected = steps.reward[0] + torch.tensor([0.0, 0.99, 0.99]) * later
    torch.testing.assert_close(target, expected)


@pytest.mark.parametrize("activation", [nn.ReLU, nn.Tanh])
def test_members_side_by_side_equal_a_loop(activation: type[nn.Module]) -> None:
    """More than a block, and each alone: the same actions and parameters, to the last bit."""
    count, rng = 35, np.random.default_rng(0)
    noise = rng.standard_normal((count, parameters(policy()).numel())).astype(np.float32)
    thetas = parameters(policy(activation)).numpy() + np.float32(0.1) * noise
    own, steps, order = networks(activation), rounds(count), orders(count)
    seen, drawn = rng.standard_normal((count, 4)), rng.standard_normal((count, 1))
    together = BlockedPPO(ADAPT, *own, thetas)
    together.learn(steps, order)
    actions = together.act(seen, drawn)
    for i in (0, 17, 31, 32, 34):
        one = slice(i, i + 1)
        alone = BlockedPPO(ADAPT, *own, thetas[one])
        alone.learn(RolloutBatch(*(x[one] for x in steps)), order[one])
        np.testing.assert_array_equal(alone.thetas, together.thetas[one])
        np.testing.assert_array_equal(alone.act(seen[one], drawn[one]), actions[one])
    single = BatchedPPO(ADAPT, *own, torch.from_numpy(thetas[:1]))  # not filled up to a block
    single.learn(RolloutBatch(*(x[:1] for x in steps)), order[:1])
    np.testing.assert_allclose(single.thetas.numpy(), together.thetas[:1], atol=1e-5)


def test_the_first_step_of_each_member_is_the_learning_rate() -> None:
    """A fresh Adam moves along the sign of the gradient, however long that is."""
    adapt = replace(ADAPT, epochs=1, minibatch_size=40, eps=1e-12)
    theta = parameters(policy())
    learner = BatchedPPO(adapt, *networks(), torch.stack([theta, theta]))
    learner.learn(rounds(2), torch.arange(40).expand(2, 1, 40))
    moved = (learner.thetas - theta).abs()
    torch.testing.assert_close(moved[moved > 1e-9], torch.full_like(moved[moved > 1e-9], 3e-3))
    assert (moved > 1e-9).float().mean() > 0.8


def session(unit: float = 1.0, **changes: Any) -> tuple[Any, np.ndarray]:
    """Return a session of a small policy, and its parameters before."""
    made = policy()
    assert made.critic is not None
    theta = parameters_to_vector(made.actor.parameters()).detach().numpy()
    operator = replace(ADAPT, **changes).bind_policy(made.actor, Critic(made.critic, unit))
    return operator.start(theta, np.random.default_rng(0)), theta


def episodes(unit: float = 1.0) -> list[EpisodeTrajectory]:
    """Return three episodes, of which time ends the second."""
    rng = np.random.default_rng(1)
    return [
        EpisodeTrajectory(
            rng.standard_normal((n, 4)).astype(np.float32),
            rng.standard_normal((n, 1)).astype(np.float32),
            unit * rng.standard_normal(n),
            rng.standard_normal(4).astype(np.float32) if n == 22 else None,
        )
        for n in (30, 22, 17)
    ]


def test_a_session_learns_after_each_episode_as_a_member_does() -> None:
    """The asked parameters are those of a member that is given the same steps as rounds."""
    one, theta = session()
    learner = BatchedPPO(ADAPT, *networks(), parameters(policy())[None])
    for number, steps in enumerate(episodes(), 1):
        asked = one.ask()
        np.testing.assert_array_equal(asked, learner.thetas[0, : len(theta)])
        one.tell(float(steps.reward.sum()), steps)
        length = len(steps.reward)
        last = steps.observation[-1] if steps.end is None else steps.end
        done = torch.arange(length) == length - 1
        member = (
            torch.from_numpy(steps.observation),
            torch.from_numpy(steps.action),
            torch.from_numpy(steps.reward.astype(np.float32)),
            torch.from_numpy(np.concatenate([steps.observation[1:], last[None]])),
            done,
            done & (steps.end is None),
        )
        rng = np.random.default_rng([one._seed, number])
        order = torch.from_numpy(ADAPT.orders(rng, length))
        learner.learn(RolloutBatch(*(x[None] for x in member)), order[None])
    assert one.ask() is None and np.abs(one.result - theta).max() > 1e-3


def test_rewards_are_counted_in_the_critics_unit() -> None:
    """Ten times the rewards in ten times the unit are the same rewards."""
    (small, _), (large, _) = session(), session(unit=10.0)
    for one, told in ((small, episodes()), (large, episodes(10.0))):
        for steps in told:
            one.tell(0.0, steps)
    np.testing.assert_allclose(small.result, large.result, atol=1e-6)


@pytest.mark.parametrize("told", [0, 2, 3])
def test_a_session_resumes_between_any_two_episodes(told: int) -> None:
    """One that was saved ends where the uninterrupted one does, to the last bit."""
    (first, theta), (second, _) = session(), session()
    second = second._recipe.start(theta, np.random.default_rng(9))
    for steps in episodes()[:told]:
        first.tell(0.0, steps)
    second.load_state_dict(first.state_dict())
    for one in (first, second):
        for steps in episodes()[told:]:
            one.tell(0.0, steps)
    np.testing.assert_array_equal(first.result, second.result)


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Settings out of range, returns alone, no critic, an operator of no policy."""
    wrong = {"rounds": 0, "steps": 0, "epochs": 0, "minibatch_size": 0, "learning_rate": 0.0}
    wrong |= {"clip_epsilon": 0.0, "gamma": 1.5, "lmbda": -0.1, "max_grad_norm": 0.0}
    for name, value in wrong.items():
        with pytest.raises(Sim2RealError, match=f"adapt.{name}={value} must be"):
            replace(ADAPT, **{name: value})
    one, theta = session()
    with pytest.raises(Sim2RealError, match="needs each episode's steps"):
        one.tell(1.0)
    with pytest.raises(Sim2RealError, match="finite"):
        one.tell(1.0, episodes()[0]._replace(end=np.full(4, np.nan)))
    for steps in episodes():
        one.tell(0.0, steps)
    with pytest.raises(Sim2RealError, match="all 3 episodes have been reported"):
        one.tell(0.0, episodes()[0])
    with pytest.raises(Sim2RealError, match=r"bind_policy\(actor, critic\)"):
        ADAPT.start(theta, np.random.default_rng(0))
    with pytest.raises(Sim2RealError, match="but found none; train with policy=actor_"):
        ADAPT.bind_policy(policy().actor)
    with pytest.raises(Sim2RealError, match="but found none"):
        ADAPT.check(object())
    shared: Any = policy().critic
    with pytest.raises(Sim2RealError, match="but found TensorDictSequential"):
        FunctionalCritic(TensorDictSequential(shared))  # as of an actor and a critic that share
    operator = one._recipe
    with pytest.raises(Sim2RealError, match=r"algorithm\.critic=true"):
        operator.start_batch(theta[None], np.zeros((1, 0, len(theta))))
    cohort = operator.start_batch(parameters(policy()).numpy()[None], np.zeros((1, 0, 1)))
    with pytest.raises(Sim2RealError, match="received only returns"):
        cohort.tell(np.array([0]), np.array([0]), np.array([1.0]))
