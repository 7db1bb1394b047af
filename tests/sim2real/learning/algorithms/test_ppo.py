"""PPO: what it computes, that it equals Stable-Baselines3, that it resumes, that it learns."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from envs import Simulation
from envs.randomization import Randomization
from envs.rows import Rows
from envs.tasks import HopperPolito, InvertedPendulum
from sim2real.config.compose import compose
from sim2real.config.targets import build
from sim2real.learning.algorithms.experience import Experience, gather
from sim2real.learning.algorithms.ppo import PPO
from sim2real.learning.losses.clip_loss import log_prob
from sim2real.learning.modules.actor_critic import ActorCritic
from sim2real.learning.population.rollout import play
from sim2real.runs.checkpoint import CheckpointStore, restore
from sim2real.runs.errors import CheckpointError, Sim2RealError

HOPPER = partial(Simulation, HopperPolito(max_steps=40))


def learner(
    preset: str = "ppo_sb3",
    env: Callable[..., Rows] = HOPPER,
    seed: int = 0,
    device: str = "cpu",
    words: tuple[str, ...] = (),
    **changes: Any,
) -> PPO:
    """Return an untrained PPO of a preset, with changes."""
    tree = compose([f"algorithm={preset}", *words])
    settings = tree["algorithm"] | changes
    parts = {"env": env, "tasks": Randomization(), "policy": build(tree["policy"], "policy")}
    made = build(settings, "algorithm")(**parts, seed=seed, device=device)
    assert isinstance(made, PPO)
    return made


def experience(reward: list[float], ends: dict[int, str]) -> Experience:
    """Return steps of one row; `ends` says which of them the "task" or the "limit" ended."""
    count = len(reward)
    over = np.isin(np.arange(count), list(ends))[:, None]
    task = np.array([[ends.get(t) == "task"] for t in range(count)])
    limits = [t for t, kind in ends.items() if kind == "limit"]
    seen = torch.randn(count + 1, 1, 11, generator=torch.Generator().manual_seed(0))
    cut = torch.full((len(limits), 11), 0.5)
    where = torch.tensor(limits, dtype=torch.long), torch.zeros(len(limits), dtype=torch.long)
    rewards, action = np.array(reward)[:, None], torch.zeros(count, 1, 3)
    return Experience(seen, seen[:-1].double().numpy(), action, rewards, task, over, cut, where)


def values(algorithm: PPO, given: Experience) -> tuple[list[float], float]:
    """Return the critic's values of all observations, and of the one that the limit cut off."""
    with torch.no_grad():
        seen = algorithm.policy(given.observation[:, 0])[2].tolist()
        return seen, float(algorithm.policy(torch.full((1, 11), 0.5))[2])


def test_advantages_have_their_closed_form() -> None:
    """An advantage is the discounted sum of the one-step errors that follow it."""
    algorithm, reward = learner(gamma=0.9, lmbda=0.8), [1.0, -2.0, 0.5, 3.0]
    given = experience(reward, {})
    v, _ = values(algorithm, given)
    errors = [r + 0.9 * v[t + 1] - v[t] for t, r in enumerate(reward)]
    expected = [sum(0.72 ** (k - t) * errors[k] for k in range(t, 4)) for t in range(4)]
    batch = algorithm._prepare(given)
    np.testing.assert_allclose(batch.advantage, expected, atol=1e-5)
    np.testing.assert_allclose(batch.target - batch.advantage, v[:-1], atol=1e-5)


def test_the_limit_goes_on_in_the_value_and_the_task_does_not() -> None:
    """After a fall nothing follows; after the time limit the value of where it was; no mixing."""
    algorithm, reward = learner(gamma=0.9, lmbda=0.8), [1.0, 1.0, 1.0, 1.0]
    fell, cut = experience(reward, {1: "task"}), experience(reward, {1: "limit"})
    v, beyond = values(algorithm, fell)
    errors = {"task": 1.0 - v[1], "limit": 1.0 + 0.9 * beyond - v[1]}
    for given, kind in ((fell, "task"), (cut, "limit")):
        advantage = algorithm._prepare(given).advantage
        assert float(advantage[1]) == pytest.approx(errors[kind], abs=1e-5)
        first = 1.0 + 0.9 * v[1] - v[0] + 0.72 * errors[kind]
        assert float(advantage[0]) == pytest.approx(first, abs=1e-5)
    both = [algorithm._prepare(given).advantage[2:] for given in (fell, cut)]
    torch.testing.assert_close(*both)


def test_actions_are_drawn_unclipped_and_taken_clipped() -> None:
    """The samples keep what was drawn, with its probability; the robot gets what its limits let."""
    algorithm = learner(num_rows=4, steps=16)
    given = gather(algorithm.stream, algorithm.policy, 16, np.random.default_rng(0), None)
    batch = algorithm._prepare(given)
    assert (given.action.abs() > 1).any() and np.abs(algorithm.stream._actions).max() == 1.0
    with torch.no_grad():
        mean, log_std, _ = algorithm.policy(batch.observation)
    torch.testing.assert_close(batch.log_prob, log_prob(batch.action, mean, log_std))


def copy_weights(ours: Any, theirs: Any) -> None:
    """Give a policy of Stable-Baselines3 our weights."""
    weights, mlp = ours.present, theirs.mlp_extractor
    with torch.no_grad():
        for layer, (weight, bias) in enumerate(weights.hidden):
            for side, network in enumerate((mlp.policy_net, mlp.value_net)):
                network[2 * layer].weight.copy_(weight[side].T)
                network[2 * layer].bias.copy_(bias[side, 0])
        for layer, (weight, bias) in (
            (theirs.action_net, weights.mean),
            (theirs.value_net, weights.value),
        ):
            layer.weight.copy_(weight.T)
            layer.bias.copy_(bias)
        theirs.log_std.copy_(weights.log_std)


def fill(buffer: Any, given: Experience, theirs: Any, gamma: float) -> None:
    """Put experience into a rollout buffer as Stable-Baselines3's own collection does."""
    steps, rows = given.over.shape
    start = np.ones(rows)
    with torch.no_grad():
        for t in range(steps):
            seen = given.observation[t]
            value, probability, _ = theirs.evaluate_actions(seen, given.action[t])
            reward = given.reward[t].astype(np.float32)
            for which, row in enumerate(given.cut_at[1][given.cut_at[0] == t].tolist()):
                last = given.cut[given.cut_at[0] == t][which]
                reward[row] += gamma * float(theirs.predict_values(last[None]))
            acted = given.action[t].numpy()
            buffer.add(seen.numpy(), acted, reward, start, value.flatten(), probability)
            start = given.over[t].astype(np.float64)
        last = theirs.predict_values(given.observation[-1])
    buffer.compute_returns_and_advantage(last_values=last, dones=start)


class RowMajor:
    """Permutations of Stable-Baselines3, which lays samples out row after row, in our layout."""

    def __init__(self, steps: int) -> None:
        self._rng, self._steps = np.random.RandomState(0), steps

    def permutation(self, count: int) -> np.ndarray:
        """Return the next order of samples (T, N)."""
        row, step = np.divmod(self._rng.permutation(count), self._steps)
        return step * (count // self._steps) + row


@pytest.mark.skipif(not find_spec("stable_baselines3"), reason="needs stable-baselines3")
def test_an_iteration_of_preset_sb3_is_that_of_stable_baselines3() -> None:
    """Equal weights and experience, 2048 samples with falls and time limits: equal after training.

    One update agrees to 1e-5, and so do the parameters after the 320 of an iteration to 1e-4.
    """
    gymnasium, sb3 = pytest.importorskip("gymnasium"), pytest.importorskip("stable_baselines3")
    for epochs, steps, within in ((1, 4, 1e-5), (10, 128, 1e-4)):
        ours = learner(epochs=epochs, steps=steps)
        vector = sb3.common.vec_env.DummyVecEnv([lambda: gymnasium.make("Hopper-v5")] * 16)
        theirs = sb3.PPO("MlpPolicy", vector, n_steps=steps, n_epochs=epochs, device="cpu")
        copy_weights(ours.policy, theirs.policy)
        given = gather(ours.stream, ours.policy, steps, np.random.default_rng(0), None)
        fill(theirs.rollout_buffer, given, theirs.policy, theirs.gamma)
        theirs._setup_learn(10**9)
        theirs._current_progress_remaining = 1.0
        ours._sorting = RowMajor(steps)  # type: ignore[assignment]
        np.random.seed(0)  # what Stable-Baselines3 sorts by
        before = ours.policy.theta.detach().clone()
        theirs.train()
        ours._learn(ours._prepare(given))
        trained = learner(epochs=epochs, steps=steps).policy
        moved = ours.policy.theta.detach().clone()
        copy_back(trained, theirs.policy)
        assert float((moved - before).abs().max()) > 10 * within
        torch.testing.assert_close(moved, trained.theta.detach(), atol=within, rtol=0)


def copy_back(ours: Any, theirs: Any) -> None:
    """Give our policy the weights of one of Stable-Baselines3."""
    weights, mlp = ours.present, theirs.mlp_extractor
    with torch.no_grad():
        for layer, (weight, bias) in enumerate(weights.hidden):
            for side, network in enumerate((mlp.policy_net, mlp.value_net)):
                weight[side].copy_(network[2 * layer].weight.T)
                bias[side, 0].copy_(network[2 * layer].bias)
        weights.mean[0].copy_(theirs.action_net.weight.T)
        weights.mean[1].copy_(theirs.action_net.bias)
        weights.value[0].copy_(theirs.value_net.weight.T)
        weights.value[1].copy_(theirs.value_net.bias)
        weights.log_std.copy_(theirs.log_std)


@pytest.mark.skipif(not find_spec("stable_baselines3"), reason="needs stable-baselines3")
def test_preset_sb3_starts_and_steps_as_stable_baselines3_by_default() -> None:
    """Every setting of the preset is the default there, and weights start with the same sizes."""
    sb3 = pytest.importorskip("stable_baselines3")
    ours, theirs = learner(), sb3.PPO("MlpPolicy", "Hopper-v5", device="cpu")
    group = theirs.policy.optimizer.param_groups[0]
    mine = ours._optimizer.param_groups[0]
    assert {k: mine[k] for k in ("lr", "eps", "betas", "weight_decay")} == {
        k: group[k] for k in ("lr", "eps", "betas", "weight_decay")
    }
    there = (theirs.n_epochs, theirs.batch_size, theirs.gamma, theirs.gae_lambda, theirs.vf_coef)
    assert there == (
        ours._epochs,
        ours._minibatch,
        ours._gamma,
        ours._lmbda,
        ours._loss.critic_coeff,
    )
    assert (theirs.clip_range(1.0), theirs.ent_coef, theirs.max_grad_norm) == (
        ours._loss.clip_epsilon,
        ours._loss.entropy_coeff,
        ours._max_norm,
    )
    assert theirs.n_steps * theirs.n_envs == ours._steps * ours.stream.rows.num_rows
    fresh, copied = ours.policy, learner(seed=1).policy
    assert isinstance(fresh, ActorCritic) and isinstance(copied, ActorCritic)
    copy_back(copied, theirs.policy)
    for (one, _), (other, _) in zip(fresh.present.hidden, copied.present.hidden, strict=True):
        for side in range(2):  # orthogonal weights of one gain: the same singular values
            sizes = [torch.linalg.svdvals(x[side]) for x in (one, other)]
            torch.testing.assert_close(*sizes, atol=1e-5, rtol=0)
    for one, other in (
        (fresh.present.mean, copied.present.mean),
        (fresh.present.value, copied.present.value),
    ):
        sizes = [torch.linalg.svdvals(x[0]) for x in (one, other)]
        torch.testing.assert_close(*sizes, atol=1e-5, rtol=0)
    torch.testing.assert_close(fresh.present.log_std, copied.present.log_std)


@pytest.mark.parametrize("preset", ["ppo_sb3", "ppo"])
def test_a_loaded_state_goes_on_to_the_last_bit(preset: str, tmp_path: Path) -> None:
    """Iterations from a checkpoint equal those of the run that was saved, to the last bit."""
    small: dict[str, Any] = {"num_rows": 8, "steps": 32, "epochs": 2, "minibatch_size": 64}
    first = learner(preset, anneal_frames=5000, **small)
    for _ in range(3):
        first.iterate()
    second = learner(preset, seed=5, anneal_frames=5000, **small)
    path = CheckpointStore(tmp_path, keep_last=1).save(first, 3, {}, 0.0)
    restore(path, second, {})
    for _ in range(3):
        assert first.iterate() == second.iterate()
    assert torch.equal(first.policy.theta, second.policy.theta)


def test_it_learns_to_balance_a_pole() -> None:
    """Within 60000 steps, seconds of work, the actor alone keeps the pole up for all 200."""
    pendulum = partial(Simulation, InvertedPendulum(max_steps=200))
    algorithm, score = learner("ppo", pendulum), 0.0
    seeds = np.arange(8, dtype=np.uint64)
    while score < 190 and algorithm.frames < 60_000:
        algorithm.iterate()
        played = play(pendulum(num_rows=8), algorithm.module(), np.zeros((8, 0)), seeds)
        score = played.returns.mean()
    assert score >= 190


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("policy", ["actor_critic", "gru"])
def test_it_runs_on_a_gpu_as_on_the_cpu(policy: str) -> None:
    """Two iterations on the device end near those on the CPU, and a loaded state goes on there."""
    near, far, again = (
        learner("ppo", words=(f"policy={policy}",), device=device, num_rows=8, epochs=2)
        for device in ("cpu", "cuda", "cuda")
    )
    assert far.policy.theta.is_cuda
    for one in (near, far):
        one.iterate()
    torch.testing.assert_close(far.policy.theta.cpu(), near.policy.theta, atol=1e-3, rtol=0)
    again.load_state_dict(far.state_dict())
    assert again.iterate() == pytest.approx(far.iterate(), rel=1e-3)


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Counts below 1, a discount above 1, a minibatch beyond the samples, a policy of no critic."""
    with pytest.raises(Sim2RealError, match=r"epochs=0 must be at least 1"):
        learner(epochs=0)
    with pytest.raises(Sim2RealError, match=r"gamma=1\.5 must be between 0 and 1"):
        learner(gamma=1.5)
    with pytest.raises(Sim2RealError, match=r"minibatch_size=64 is more than the 32 samples"):
        learner(num_rows=4, steps=8)
    tree = compose(["algorithm=ppo", "policy=mlp"])
    parts = {"env": HOPPER, "tasks": Randomization(), "policy": build(tree["policy"], "policy")}
    with pytest.raises(Sim2RealError, match="MLPPolicy is none; use policy=actor_critic"):
        build(tree["algorithm"], "algorithm")(**parts, seed=0, device="cpu")


def test_a_state_of_other_settings_is_refused() -> None:
    """Another normalization or another network: said, and nothing is taken over."""
    state = learner("ppo").state_dict()
    with pytest.raises(CheckpointError, match="normalize_observations"):
        learner("ppo", normalize_observations=False).load_state_dict(state)
    with pytest.raises(CheckpointError, match=r"it has 32 rows, this run 8; .*num_rows=32"):
        learner("ppo", num_rows=8).load_state_dict(state)


def test_a_policy_is_taken_over_without_the_rest(tmp_path: Path) -> None:
    """To be evaluated, a policy needs neither the rows nor the settings of its training."""
    trained = learner("ppo", num_rows=4)
    trained.iterate()
    path = CheckpointStore(tmp_path, keep_last=1).save(trained, 1, {}, 0.0)
    taken = learner("ppo", num_rows=6, epochs=1, normalize_rewards=False, seed=3)
    restore(path, taken, {}, generators=False)
    seen = torch.randn(5, 11, dtype=torch.float64)
    with torch.no_grad():
        assert torch.equal(taken.module()(seen), trained.module()(seen))
    assert taken.frames == trained.frames
