"""PPO: what it computes, that it equals Stable-Baselines3, that it resumes, that it learns."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import nn
from torchrl.envs import EnvBase

from envs import MujocoEnv
from envs.pixels.env import PixelsEnv
from envs.tasks import HopperPolito, InvertedPendulum
from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.base import build
from sim2real.learning.algorithms.on_policy import OnPolicy
from sim2real.learning.algorithms.ppo import PPO
from sim2real.runs.checkpoint import CheckpointStore, restore
from sim2real.runs.errors import CheckpointError, Sim2RealError

HOPPER: partial[Any] = partial(MujocoEnv, task=HopperPolito(max_steps=40))


def learner(
    *words: str,
    preset: str = "ppo_sb3",
    base: Callable[..., EnvBase] = HOPPER,
    seed: int = 0,
    device: str = "cpu",
    kind: type[Any] = PPO,
    **changes: Any,
) -> Any:
    """Return an untrained PPO of a preset, with changes."""
    own = [f"algorithm.{name}={'null' if v is None else v}" for name, v in changes.items()]
    _, given = instantiate(compose([f"algorithm={preset}", *words, *own]), Path())
    parts = replace(given["parts"], seed=seed, device=device)
    environment = replace(parts.environment, base=base)
    made = build(given["algorithm"], replace(parts, environment=environment))
    assert isinstance(made, kind)
    return made


def linears(module: nn.Module) -> list[nn.Linear]:
    """Return the layers of a network."""
    return [layer for layer in module.modules() if isinstance(layer, nn.Linear)]


def log_std(ours: OnPolicy) -> nn.Parameter:
    """Return the parameter that no layer has."""
    return next(p for name, p in ours.policy.actor.named_parameters() if "scale" in name)


def experience(reward: list[float], ends: dict[int, str]) -> TensorDictBase:
    """Return steps of one row, (1, T); `ends` says which the "task" or the "limit" ended."""
    count = len(reward)
    seen = torch.randn(1, count + 1, 11, generator=torch.Generator().manual_seed(0))
    after = seen[:, 1:].clone()
    for t, kind in ends.items():
        if kind == "limit":
            after[0, t] = 0.5
    task, over = (
        torch.tensor([[[ends.get(t) in kinds] for t in range(count)]])
        for kinds in (("task",), ("task", "limit"))
    )
    rewards = torch.tensor(reward)[None, :, None]
    following = {"observation": after, "reward": rewards, "done": over, "terminated": task}
    data = {"observation": seen[:, :-1], "action": torch.zeros(1, count, 3), "next": following}
    return TensorDict(data, [1, count])


def values(algorithm: PPO, data: TensorDictBase) -> tuple[list[float], float]:
    """Return the critic's values of all observations, and of one that the limit cut off."""
    last = data["next", "observation"][0, -1:]
    seen = torch.cat([data["observation"][0], last, torch.full((1, 11), 0.5)])
    critic = algorithm.policy.critic
    assert critic is not None
    with torch.no_grad():
        all_of_them = critic(TensorDict({"observation": seen}, [len(seen)]))
    found = all_of_them["state_value"][:, 0].tolist()
    return found[:-1], found[-1]


def judged(algorithm: OnPolicy, data: TensorDictBase) -> TensorDictBase:
    """Return steps with their advantages."""
    with torch.no_grad():
        return algorithm._advantage(data.clone())


GAE = ("advantage.gamma=0.9", "advantage.lmbda=0.8")


def test_advantages_have_their_closed_form() -> None:
    """An advantage is the discounted sum of the one-step errors that follow it."""
    algorithm, reward = learner(*GAE), [1.0, -2.0, 0.5, 3.0]
    given = experience(reward, {})
    v, _ = values(algorithm, given)
    errors = [r + 0.9 * v[t + 1] - v[t] for t, r in enumerate(reward)]
    expected = [sum(0.72 ** (k - t) * errors[k] for k in range(t, 4)) for t in range(4)]
    data = judged(algorithm, given)
    np.testing.assert_allclose(data["advantage"][0, :, 0], expected, atol=1e-5)
    value = (data["value_target"] - data["advantage"])[0, :, 0]
    np.testing.assert_allclose(value, v[:-1], atol=1e-5)


def test_the_limit_goes_on_in_the_value_and_the_task_does_not() -> None:
    """After a fall nothing follows; after the time limit the value of where it was; no mixing."""
    algorithm, reward = learner(*GAE), [1.0, 1.0, 1.0, 1.0]
    fell, cut = experience(reward, {1: "task"}), experience(reward, {1: "limit"})
    v, beyond = values(algorithm, fell)
    errors = {"task": 1.0 - v[1], "limit": 1.0 + 0.9 * beyond - v[1]}
    for given, kind in ((fell, "task"), (cut, "limit")):
        advantage = judged(algorithm, given)["advantage"][0, :, 0]
        assert float(advantage[1]) == pytest.approx(errors[kind], abs=1e-5)
        first = 1.0 + 0.9 * v[1] - v[0] + 0.72 * errors[kind]
        assert float(advantage[0]) == pytest.approx(first, abs=1e-5)
    both = [judged(algorithm, given)["advantage"][0, 2:, 0] for given in (fell, cut)]
    torch.testing.assert_close(*both)


def test_actions_are_drawn_unclipped_and_taken_clipped() -> None:
    """The samples keep what was drawn, with its probability; the robot gets what its limits let."""
    algorithm = learner(num_rows=4, steps=16)
    data = algorithm.collecting.next()
    base: Any = algorithm.collecting.env.base_env
    assert (data["action"].abs() > 1).any() and np.abs(base._actions).max() == 1.0
    with torch.no_grad():
        law = algorithm.policy.actor.get_dist(data)
    torch.testing.assert_close(data["action_log_prob"], law.log_prob(data["action"]))


def copy_weights(ours: OnPolicy, theirs: Any, back: bool = False) -> None:
    """Give a policy of Stable-Baselines3 our weights, or ours its own."""
    mlp = theirs.mlp_extractor
    pairs = [(log_std(ours), theirs.log_std)]
    critic = ours.policy.critic
    assert critic is not None
    for network, hidden, head in (
        (ours.policy.actor, mlp.policy_net, theirs.action_net),
        (critic, mlp.value_net, theirs.value_net),
    ):
        layers = zip(linears(network), [*linears(hidden), head], strict=True)
        pairs += [pair for a, b in layers for pair in ((a.weight, b.weight), (a.bias, b.bias))]
    with torch.no_grad():
        for own, other in pairs:
            one, two = (other, own) if not back else (own, other)
            one.copy_(two)


def fill(buffer: Any, data: TensorDictBase, theirs: Any, gamma: float) -> None:
    """Put experience into a rollout buffer as Stable-Baselines3's own collection does."""
    start = np.ones(len(data))
    with torch.no_grad():
        for step in data.unbind(1):
            seen, after = step["observation"], step["next"]
            value, probability, _ = theirs.evaluate_actions(seen, step["action"])
            reward = after["reward"][:, 0].numpy().copy()
            cut = (after["truncated"] & ~after["terminated"])[:, 0].numpy()
            last = theirs.predict_values(after["observation"])[:, 0].numpy()
            reward[cut] += gamma * last[cut]
            acted = step["action"].numpy()
            buffer.add(seen.numpy(), acted, reward, start, value.flatten(), probability)
            start = after["done"][:, 0].numpy().astype(np.float64)
        # of a row that ended the value is not asked for: its next episode's start
        final = theirs.predict_values(data["next", "observation"][:, -1])
    buffer.compute_returns_and_advantage(last_values=final, dones=start)


class InTheirOrder:
    """Minibatches in the order in which Stable-Baselines3 draws them.

    Args:
        size: samples of a minibatch.
        draws_before: orders that it draws, and does not use, before.
    """

    def __init__(self, size: int = 64, draws_before: int = 0) -> None:
        self._rng, self._size, self._unused = np.random.RandomState(0), size, draws_before

    def empty(self) -> None:
        """Forget nothing: the next samples replace these."""

    def extend(self, data: TensorDictBase) -> None:
        """Take samples."""
        self._data = data

    def __iter__(self) -> Iterator[TensorDictBase]:
        for _ in range(self._unused):
            self._rng.permutation(len(self._data))
        self._unused = 0
        order = torch.from_numpy(self._rng.permutation(len(self._data)))
        yield from (self._data[part] for part in order.split(self._size))


@pytest.mark.skipif(not find_spec("stable_baselines3"), reason="needs stable-baselines3")
@pytest.mark.parametrize(
    ("epochs", "steps", "within"),
    [(1, 4, 1e-5), pytest.param(10, 128, 1e-4, marks=pytest.mark.slow)],
)
def test_an_iteration_of_preset_sb3_is_that_of_stable_baselines3(epochs, steps, within) -> None:
    """Equal weights and experience, 2048 samples with falls and time limits: equal after training.

    One update agrees to 1e-5, and so do the parameters after the 320 of an iteration to 1e-4.
    """
    gymnasium, sb3 = pytest.importorskip("gymnasium"), pytest.importorskip("stable_baselines3")
    torch.manual_seed(0)  # of weights: a ratio at its clip can fall on either side by rounding
    ours = learner(epochs=epochs, steps=steps)
    vector = sb3.common.vec_env.DummyVecEnv([lambda: gymnasium.make("Hopper-v5")] * 16)
    theirs = sb3.PPO("MlpPolicy", vector, n_steps=steps, n_epochs=epochs, device="cpu")
    copy_weights(ours, theirs.policy)
    data = ours.collecting.next()
    fill(theirs.rollout_buffer, data, theirs.policy, theirs.gamma)
    theirs._setup_learn(10**9)
    theirs._current_progress_remaining = 1.0
    ours._buffer = InTheirOrder()  # type: ignore[assignment]
    np.random.seed(0)  # what Stable-Baselines3 sorts by
    before = nn.utils.parameters_to_vector(ours.policy.parameters()).detach().clone()
    theirs.train()
    ours._learn(judged(ours, data))
    trained = learner(epochs=epochs, steps=steps)
    moved = nn.utils.parameters_to_vector(ours.policy.parameters()).detach()
    copy_weights(trained, theirs.policy, back=True)
    assert float((moved - before).abs().max()) > 10 * within
    expected = nn.utils.parameters_to_vector(trained.policy.parameters()).detach()
    torch.testing.assert_close(moved, expected, atol=within, rtol=0)


@pytest.mark.skipif(not find_spec("stable_baselines3"), reason="needs stable-baselines3")
def test_preset_sb3_starts_and_steps_as_stable_baselines3_by_default() -> None:
    """Every setting of the preset is the default there, and weights start with the same sizes."""
    sb3 = pytest.importorskip("stable_baselines3")
    ours, theirs = learner(), sb3.PPO("MlpPolicy", "Hopper-v5", device="cpu")
    group, mine = theirs.policy.optimizer.param_groups[0], ours._optimizer.param_groups[0]
    same = ("lr", "eps", "betas", "weight_decay")
    assert {k: mine[k] for k in same} == {k: group[k] for k in same}
    parts, loss = ours.parts, ours._loss
    judge, minimized = parts.advantage.keywords, parts.loss.keywords  # type: ignore[union-attr]
    there = (theirs.n_epochs, theirs.batch_size, theirs.gamma, theirs.gae_lambda)
    assert there == (ours._epochs, ours._buffer.batch_size, judge["gamma"], judge["lmbda"])
    assert (theirs.vf_coef, theirs.ent_coef, theirs.max_grad_norm) == (
        minimized["critic_coeff"],
        minimized["entropy_coeff"],
        ours._max_norm,
    )
    assert theirs.clip_range(1.0) == pytest.approx(float(loss.clip_epsilon))
    assert minimized["loss_critic_type"] == "l2" and minimized["normalize_advantage"]
    assert theirs.n_steps * theirs.n_envs == ours.collecting.next().numel()
    copied = learner(seed=1)
    copy_weights(copied, theirs.policy, back=True)
    for name in ("actor", "critic"):
        networks = [linears(getattr(one.policy, name)) for one in (ours, copied)]
        for one, other in zip(*networks, strict=True):
            # orthogonal weights of one gain: the same singular values
            sizes = [torch.linalg.svdvals(x.weight.detach()) for x in (one, other)]
            torch.testing.assert_close(*sizes, atol=1e-5, rtol=0)
    torch.testing.assert_close(log_std(ours), log_std(copied))


@pytest.mark.parametrize("preset", [pytest.param("ppo_sb3", marks=pytest.mark.slow), "ppo"])
def test_a_loaded_state_goes_on_to_the_last_bit(preset: str, tmp_path: Path) -> None:
    """Iterations from a checkpoint equal those of the run that was saved, to the last bit."""
    small: dict[str, Any] = {"num_rows": 8, "steps": 32, "epochs": 2, "minibatch_size": 64}
    small |= {"preset": preset, "anneal_frames": 5000}
    first = learner("params=udr", **small)
    for _ in range(3):
        first.iterate()
    second = learner("params=udr", seed=5, **small)
    path = CheckpointStore(tmp_path, keep_last=1).save(first, 3, {}, 0.0)
    restore(path, second, {})
    for _ in range(3):
        assert first.iterate() == second.iterate()
    for one, other in zip(first.policy.parameters(), second.policy.parameters(), strict=True):
        assert torch.equal(one, other)


@pytest.mark.slow
def test_it_learns_to_balance_a_pole() -> None:
    """Within 60000 steps, seconds of work, the actor alone keeps the pole up for all 200."""
    pendulum: partial[Any] = partial(MujocoEnv, task=InvertedPendulum(max_steps=200))
    algorithm, score = learner(preset="ppo", base=pendulum), 0.0
    seeds = np.arange(8, dtype=np.uint64)
    while score < 190 and algorithm.frames < 60_000:
        algorithm.iterate()
        score = algorithm.trained().run_episodes(seeds).returns.mean()
    assert score >= 190


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("policy", ["actor_critic", "gru", "cnn"])
@pytest.mark.parametrize("preset", ["ppo", "ppo_sb3"])
def test_it_runs_on_a_gpu_as_on_the_cpu(policy: str, preset: str) -> None:
    """It learns there with finite numbers, and a loaded state goes on alike."""
    words, base = [f"policy={policy}"], HOPPER
    if policy == "cnn":
        pixels: partial[Any] = partial(PixelsEnv, task=HopperPolito())
        words, base = [*words, "transforms=pixels"], pixels
    if policy != "actor_critic" and preset == "ppo":
        words = [*words, "loss=clip_ppo", "optimizer=adam"]  # the fast ones take perceptrons
    far, again = (
        learner(*words, base=base, preset=preset, device="cuda", num_rows=8, epochs=2, steps=64)
        for _ in range(2)
    )
    assert next(far.policy.parameters()).is_cuda
    far.iterate()
    again.load_state_dict(far.state_dict())
    assert again.iterate() == pytest.approx(far.iterate(), rel=1e-3)


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Counts below 1, a minibatch beyond the samples, a policy of no critic."""
    with pytest.raises(Sim2RealError, match=r"epochs=0 must be at least 1"):
        learner(epochs=0)
    with pytest.raises(Sim2RealError, match=r"minibatch_size=64 is more than the 32 samples"):
        learner(num_rows=4, steps=8)
    with pytest.raises(Sim2RealError, match="ppo also needs a critic; use"):
        learner("policy=actor")
    with pytest.raises(Sim2RealError, match="MLPPolicy is neither; use policy=actor_critic"):
        learner("policy=mlp")


def test_weights_that_are_not_finite_stop_the_run() -> None:
    """A sentence says what to lower; nothing goes on with NaN."""
    algorithm = learner("optimizer.lr=1.0e30", num_rows=4, steps=16)
    with pytest.raises(Sim2RealError, match=r"no longer finite after iteration 0; lower optimizer"):
        for _ in range(3):
            algorithm.iterate()


def test_divergence_ends_the_epochs() -> None:
    """A limit that any update passes leaves one epoch; none leaves them all."""
    assert learner(target_kl=1e-9, steps=16).iterate()["train/epochs"] == 1
    assert learner(epochs=3, steps=16).iterate()["train/epochs"] == 3


def test_a_state_of_other_settings_is_refused() -> None:
    """Other transforms, other rows or another network: said, and nothing is taken over."""
    state = learner(preset="ppo").state_dict()
    with pytest.raises(CheckpointError, match="the transforms differ"):
        learner("~transforms.reward_scaling", preset="ppo").load_state_dict(state)
    with pytest.raises(CheckpointError, match=r"it has 32 rows, this run 8; .*num_rows=32"):
        learner(preset="ppo", num_rows=8).load_state_dict(state)
    with pytest.raises(CheckpointError, match="its policy is"):
        learner("policy.actor.num_cells=[8]", preset="ppo").load_state_dict(state)


@pytest.mark.parametrize(
    ("of", "here", "sentence"),
    [
        ("ppo_sb3", "ppo", "only this run has observation_norm, reward_scaling"),
        ("ppo", "ppo_sb3", "the checkpoint has transform 1, transform 2"),
    ],
)
def test_a_policy_acts_behind_the_transforms_of_its_training(
    of: str, here: str, sentence: str
) -> None:
    """Statistics that nothing has gathered are refused like those that are not used."""
    state = learner(preset=of, num_rows=4).state_dict()
    other = learner(preset=here, num_rows=4)
    with pytest.raises(CheckpointError, match=f"{sentence}.*; remove transforms="):
        other.load_policy(state)


def test_a_policy_is_taken_over_without_the_rest(tmp_path: Path) -> None:
    """To be evaluated, a policy needs neither the rows nor the settings of its training."""
    trained = learner(preset="ppo", num_rows=4)
    trained.iterate()
    path = CheckpointStore(tmp_path, keep_last=1).save(trained, 1, {}, 0.0)
    taken = learner(preset="ppo", num_rows=6, epochs=1, seed=3)
    restore(path, taken, {}, generators=False)
    seeds = np.arange(3, dtype=np.uint64)
    one, other = trained.trained().run_episodes(seeds), taken.trained().run_episodes(seeds)
    np.testing.assert_array_equal(one.returns, other.returns)
    assert taken.frames == trained.frames
