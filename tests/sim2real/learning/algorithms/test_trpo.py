"""TRPO: its step against a dense solution and sb3-contrib's, that it resumes, that it learns."""

import logging
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.func import grad, hessian
from torch.nn.utils import parameters_to_vector

from envs import MujocoEnv
from envs.tasks import HopperPolito, InvertedPendulum
from sim2real.learning.algorithms.trpo import TRPO
from sim2real.learning.modules.functional_actor import divergence, log_prob
from sim2real.learning.optimizers.natural import RESIDUAL
from sim2real.runs.checkpoint import CheckpointStore, restore
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.learning.algorithms.test_ppo import InTheirOrder, copy_weights, fill, judged
from tests.sim2real.learning.algorithms.test_ppo import learner as any_learner

PENDULUM = partial(MujocoEnv, task=InvertedPendulum(max_steps=60))
SMALL = ("num_rows=4", "steps=32", "minibatch_size=64", "critic_epochs=2")


def learner(*words: str, base: Any = PENDULUM, kind: type[TRPO] = TRPO, seed: int = 0) -> TRPO:
    """Return an untrained TRPO with changes."""
    own = [
        word if word.startswith(("policy", "optimizer")) else f"algorithm.{word}" for word in words
    ]
    return any_learner(*own, preset="trpo", base=base, seed=seed, kind=kind)


def test_its_step_is_the_dense_solution() -> None:
    """One step equals one with the divergence's whole Hessian and a direct solution."""
    tiny = ("policy.actor.num_cells=[3]", "step.cg_iterations=60", "kl_per_action=false")
    algorithm = learner(*tiny, "num_rows=4", "steps=64")
    with algorithm._randomness:
        data = judged(algorithm, algorithm.collecting.next())
    algorithm.policy.double()
    samples = algorithm._samples(data).double()
    law = algorithm._law
    start, seen = law.vector(), law.read(samples)
    old = law(start, *seen)
    advantage = samples["advantage"][:, 0]
    advantage = (advantage - advantage.mean()) / advantage.std()

    def objective(theta: torch.Tensor) -> torch.Tensor:
        ratio = (log_prob(law(theta, *seen), samples["action"]) - samples["action_log_prob"]).exp()
        return (ratio * advantage).mean()

    curvature = hessian(lambda theta: divergence(law(theta, *seen), old).mean())(start)
    damped = curvature + 0.1 * torch.eye(len(start)).double()
    slope = grad(objective)(start)
    direction = torch.linalg.solve(damped, slope)
    length = (2 * 0.01 / (slope @ direction)).sqrt()
    tried = [start + 0.8**k * length * direction for k in range(10)]
    expected = next(
        theta
        for theta in tried
        if divergence(law(theta, *seen), old).mean() < 0.01 and objective(theta) > objective(start)
    )
    algorithm._climb(samples)
    # conjugate gradients end at a residual of RESIDUAL; no eigenvalue is below the damping
    within = float(length) * RESIDUAL**0.5 / 0.1
    assert float((expected - start).abs().max()) > 100 * within
    torch.testing.assert_close(law.vector(), expected, atol=within, rtol=0)


@pytest.mark.skipif(not find_spec("sb3_contrib"), reason="needs sb3-contrib")
def test_an_iteration_is_that_of_sb3_contrib(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal weights and experience, falls and time limits among it: equal after actor and critic.

    Its conjugate gradients start from small random numbers, ours from 0, so it is given zeros.
    """
    gymnasium, contrib = pytest.importorskip("gymnasium"), pytest.importorskip("sb3_contrib")
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    hopper = partial(MujocoEnv, task=HopperPolito(max_steps=40))
    ours = learner(base=hopper)
    vector = vec_env.DummyVecEnv([lambda: gymnasium.make("Hopper-v5")] * 16)
    theirs = contrib.TRPO("MlpPolicy", vector, n_steps=128, device="cpu")
    copy_weights(ours, theirs.policy)
    data = ours.collecting.next()
    fill(theirs.rollout_buffer, data, theirs.policy, theirs.gamma)
    theirs._setup_learn(10**9)
    theirs._current_progress_remaining = 1.0
    before = parameters_to_vector(ours.policy.parameters()).detach().clone()
    ours._buffer = InTheirOrder(128, draws_before=1)  # type: ignore[assignment]
    monkeypatch.setattr(torch, "randn_like", torch.zeros_like)
    np.random.seed(0)  # what it sorts by
    theirs.train()
    ours._learn(judged(ours, data))
    trained = learner(base=hopper)
    copy_weights(trained, theirs.policy, back=True)
    moved = parameters_to_vector(ours.policy.parameters()).detach()
    expected = parameters_to_vector(trained.policy.parameters()).detach()
    assert float((moved - before).abs().max()) > 1e-2
    torch.testing.assert_close(moved, expected, atol=2e-4, rtol=0)


@pytest.mark.skipif(not find_spec("sb3_contrib"), reason="needs sb3-contrib")
def test_the_preset_is_set_as_sb3_contrib_by_default() -> None:
    """Every setting of the preset is the default there."""
    contrib = pytest.importorskip("sb3_contrib")
    ours, theirs = learner(), contrib.TRPO("MlpPolicy", "Hopper-v5", device="cpu")
    step, judge = ours._step, ours.parts.advantage.keywords  # type: ignore[union-attr]
    there = (theirs.target_kl, theirs.cg_max_steps, theirs.cg_damping)
    assert there == (step.max_kl, step.cg_iterations, step.damping)
    searched = (theirs.line_search_max_iter, theirs.line_search_shrinking_factor)
    assert searched == (step.backtracks, step.shrink)
    fitted = (theirs.n_critic_updates, theirs.batch_size, theirs.learning_rate)
    group = ours._optimizer.param_groups[0]
    assert fitted == (ours._critic_epochs, ours._buffer.batch_size, group["lr"])
    assert (theirs.gamma, theirs.gae_lambda) == (judge["gamma"], judge["lmbda"])
    assert theirs.n_steps * theirs.n_envs == ours.collecting.next().numel()
    assert theirs.policy.optimizer.param_groups[0]["eps"] == group["eps"]


def test_without_a_direction_the_actor_stays(caplog: pytest.LogCaptureFixture) -> None:
    """Where every action is as good as any other it says so; the critic learns on."""
    algorithm = learner(*SMALL)
    data = judged(algorithm, algorithm.collecting.next())
    data["advantage"] = torch.zeros_like(data["advantage"])
    actor = parameters_to_vector(algorithm.policy.actor.parameters()).clone()
    judge = algorithm.policy.critic
    assert judge is not None
    critic = parameters_to_vector(judge.parameters()).clone()
    with caplog.at_level(logging.WARNING):
        _, logged = algorithm._learn(data)
    assert "the gradient is zero; the policy is unchanged" in caplog.text
    assert logged["train/moved"] == 0 and logged["train/kl"] == 0
    assert torch.equal(actor, parameters_to_vector(algorithm.policy.actor.parameters()))
    assert not torch.equal(critic, parameters_to_vector(judge.parameters()))


def test_a_loaded_state_goes_on_to_the_last_bit(tmp_path: Path) -> None:
    """Iterations from a checkpoint equal those of the run that was saved, to the last bit."""
    first, second = learner(*SMALL), learner(*SMALL, seed=5)
    for _ in range(2):
        first.iterate()
    path = CheckpointStore(tmp_path, keep_last=1).save(first, 2, {}, 0.0)
    restore(path, second, {})
    for _ in range(2):
        assert first.iterate() == second.iterate()
    for one, other in zip(first.policy.parameters(), second.policy.parameters(), strict=True):
        assert torch.equal(one, other)


@pytest.mark.slow
def test_it_learns_to_balance_a_pole() -> None:
    """Within 20000 steps the actor alone keeps the pole up for all 60."""
    algorithm, score = learner("step.max_kl=0.05", "critic_epochs=4", "optimizer.lr=3.0e-3"), 0.0
    seeds = np.arange(8, dtype=np.uint64)
    while score < 57 and algorithm.frames < 20_000:
        algorithm.iterate()
        score = algorithm.trained().run_episodes(seeds).returns.mean()
    assert score >= 57


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Counts below 1, and networks that the critic would move along with the actor."""
    with pytest.raises(Sim2RealError, match="critic_epochs=0 must be at least 1"):
        learner("critic_epochs=0")
    with pytest.raises(Sim2RealError, match=r"max_kl=0\.0 must be above 0"):
        learner("step.max_kl=0.0")
    with pytest.raises(Sim2RealError, match="algorithm=trpo needs an actor and a critic"):
        learner("policy=mlp")


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_it_runs_on_a_gpu_as_on_the_cpu() -> None:
    """It learns there with finite numbers, and a loaded state goes on alike."""
    small = [f"algorithm.{word}" for word in SMALL]
    far, again = (
        any_learner(*small, preset="trpo", base=PENDULUM, kind=TRPO, device="cuda")
        for _ in range(2)
    )
    far.iterate()
    assert all(p.is_cuda for p in far.policy.parameters())
    again.load_state_dict(far.state_dict())
    assert again.iterate() == pytest.approx(far.iterate(), rel=1e-3)
