"""Adaptation by a policy gradient: its advantages, its sessions, and what it refuses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from sim2real.learning.adapt import EpisodeTrajectory, LinearGAE, PolicyGradient
from sim2real.learning.adapt.linear_gae import discounted
from sim2real.learning.modules.functional_actor import FunctionalActor, log_prob
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.learning.modules.test_functional_actor import policy

JUDGE = LinearGAE(gamma=0.9, lmbda=1.0, ridge=1e-5)
ADAPT = PolicyGradient(trajectories=3, rate=0.2, surrogate="likelihood", advantage=JUDGE)


def test_discounted_sums_have_their_closed_form() -> None:
    """Each is the sum of what follows, a power of the discount for each step."""
    found = discounted(torch.tensor([1.0, -2.0, 0.5]).double(), 0.9)
    expected = [1 - 2 * 0.9 + 0.5 * 0.81, -2 + 0.5 * 0.9, 0.5]
    torch.testing.assert_close(found, torch.tensor(expected).double())


def test_advantages_are_what_the_fit_leaves_of_the_returns() -> None:
    """Least squares by numpy on the steps of one task; steps after an end count for nothing."""
    rng = np.random.default_rng(0)
    seen, reward = rng.standard_normal((4, 6, 2)), rng.standard_normal((4, 6))
    lengths = np.array([6, 3, 5, 6])
    alive = np.arange(6) < lengths[:, None]
    rows, returns = [], []
    for episode, length in enumerate(lengths):
        for t in range(length):
            o, now = seen[episode, t], t / 100
            rows.append([*o, *o**2, 1, now, now**2, now**3])
            later = reward[episode, t:length]
            returns.append(float(later @ 0.9 ** np.arange(len(later))))
    x, y = np.array(rows), np.array(returns)
    weights = np.linalg.solve(x.T @ x + 1e-5 * np.eye(8), x.T @ y)
    left = y - x @ weights
    expected = (left - left.mean()) / left.std()
    given = [torch.from_numpy(a) for a in (seen, reward, alive)]
    found = JUDGE(*given)
    np.testing.assert_allclose(found[given[2]], expected, atol=1e-6)
    assert (found[~given[2]] == 0).all()
    both = JUDGE(*(torch.stack([a, a.flip(0)]) for a in given))  # two tasks, each by itself
    torch.testing.assert_close(both[0], found)


def session(size: int = 3, **changes: Any) -> tuple[Any, FunctionalActor, np.ndarray]:
    """Return a session of a small policy, its law and the parameters before."""
    actor = policy(size).float().actor
    law = FunctionalActor(actor)
    theta = law.vector().numpy()
    operator = replace(ADAPT, **changes).bind_policy(actor)
    return operator.start(theta, np.random.default_rng(0)), law, theta


def episodes() -> list[EpisodeTrajectory]:
    """Return three episodes of different lengths."""
    rng = np.random.default_rng(1)
    return [
        EpisodeTrajectory(
            rng.standard_normal((n, 4)).astype(np.float32),
            rng.standard_normal((n, 1)).astype(np.float32),
            rng.standard_normal(n),
        )
        for n in (5, 2, 4)
    ]


def test_a_session_takes_the_gradient_step() -> None:
    """After its episodes the result is theta + rate times the gradient of mean log pi A."""
    one, law, theta = session()
    told = episodes()
    for steps in told:
        np.testing.assert_array_equal(one.ask(), theta)
        np.testing.assert_array_equal(one.result, theta)
        one.tell(float(steps.reward.sum()), steps)
    assert one.ask() is None and one.episodes_left == 0
    alive = torch.arange(5) < torch.tensor([[5], [2], [4]])
    seen, reward = torch.zeros(3, 5, 4), torch.zeros(3, 5)
    for i, steps in enumerate(told):
        seen[i, : len(steps.reward)] = torch.from_numpy(steps.observation)
        reward[i, : len(steps.reward)] = torch.from_numpy(steps.reward)
    advantage = JUDGE(seen, reward, alive)[alive]
    action = torch.from_numpy(np.concatenate([steps.action for steps in told]))
    start = torch.from_numpy(theta).requires_grad_()
    (log_prob(law(start, seen[alive]), action) * advantage).mean().backward()
    assert start.grad is not None
    expected = theta + 0.2 * start.grad.numpy()
    assert np.abs(expected - theta).max() > 1e-3
    np.testing.assert_allclose(one.result, expected, atol=1e-6)


@pytest.mark.parametrize("told", [0, 2, 3])
def test_a_session_resumes_between_any_two_episodes(told: int) -> None:
    """One that was saved ends where the uninterrupted one does, to the last bit."""
    (first, *_), (second, *_) = session(), session()
    for steps in episodes()[:told]:
        first.tell(0.0, steps)
    second.load_state_dict(first.state_dict())
    for one in (first, second):
        for steps in episodes()[told:]:
            one.tell(0.0, steps)
    np.testing.assert_array_equal(first.result, second.result)


def test_the_surrogates_have_one_gradient_where_episodes_were_drawn() -> None:
    """The step of "ratio" is that of "likelihood"; only second derivatives differ."""
    results = []
    for surrogate in ("likelihood", "ratio"):
        torch.manual_seed(0)
        one, *_ = session(surrogate=surrogate)
        for steps in episodes():
            one.tell(0.0, steps)
        results.append(one.result)
    np.testing.assert_allclose(*results, atol=1e-6)


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Settings out of range, returns alone, a population, an operator of no policy."""
    for name, value in (("trajectories", 0), ("rate", 0.0), ("surrogate", "odd")):
        with pytest.raises(Sim2RealError, match=f"{name}="):
            replace(ADAPT, **{name: value})
    with pytest.raises(Sim2RealError, match=r"gamma=1\.5"):
        replace(JUDGE, gamma=1.5)
    one, _, theta = session()
    with pytest.raises(Sim2RealError, match="needs each episode's steps"):
        one.tell(1.0)
    with pytest.raises(Sim2RealError, match="finite"):
        one.tell(float("nan"), episodes()[0])
    for steps in episodes():
        one.tell(0.0, steps)
    with pytest.raises(Sim2RealError, match="all 3 episodes have been reported"):
        one.tell(0.0, episodes()[0])
    with pytest.raises(Sim2RealError, match="use adapt=gradient"):
        ADAPT.start_batch(theta[None], np.zeros((1, 0, len(theta))))
    with pytest.raises(Sim2RealError, match=r"bind_policy\(actor\)"):
        ADAPT.start(theta, np.random.default_rng(0))
