"""SAC: that an update is Stable-Baselines3's, that it resumes, that it learns."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch import nn

from envs import MujocoEnv
from envs.tasks import Hopper, InvertedPendulum
from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.base import build
from sim2real.learning.algorithms.sac import SAC
from sim2real.runs.checkpoint import CheckpointStore, restore
from sim2real.runs.errors import CheckpointError, Sim2RealError

PENDULUM = partial(MujocoEnv, task=InvertedPendulum(max_steps=100))
SMALL = ("policy.actor.num_cells=[32,32]", "policy.qvalue.num_cells=[32,32]")


def learner(
    *words: str,
    base: Callable[..., Any] = PENDULUM,
    seed: int = 0,
    device: str = "cpu",
    **changes: Any,
) -> SAC:
    """Return an untrained SAC of the preset, with small networks."""
    settings = {"batch_size": 64, "steps": 50} | changes
    own = [f"algorithm.{name}={value}" for name, value in settings.items()]
    _, given = instantiate(compose(["algorithm=sac", *(words or SMALL), *own]), Path())
    environment = replace(given["parts"].environment, base=base)
    parts = replace(given["parts"], environment=environment, seed=seed, device=device)
    made = build(given["algorithm"], parts)
    assert isinstance(made, SAC)
    return made


def transitions(count: int) -> TensorDict:
    """Return transitions of Hopper's sizes, some of which end the episode."""
    g = torch.Generator().manual_seed(3)
    seen, after = torch.randn(2, count, 11, generator=g)
    over = torch.rand(count, 1, generator=g) < 0.3
    following = {"observation": after, "reward": torch.randn(count, 1, generator=g)}
    following |= {"done": over, "terminated": over}
    action = torch.rand(count, 3, generator=g) * 2 - 1
    return TensorDict({"observation": seen, "action": action, "next": following}, [count])


def matched(ours: SAC, theirs: Any) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
    """Yield each parameter of our networks with that of Stable-Baselines3's policy."""
    loss, actor = ours._loss, theirs.actor
    layers = [m for m in ours.policy.actor.modules() if isinstance(m, nn.Linear)]
    hidden = [m for m in actor.latent_pi if isinstance(m, nn.Linear)]
    count = actor.mu.out_features
    critics = (loss.qvalue_network_params, theirs.critic)
    targets = (loss.target_qvalue_network_params, theirs.critic_target)
    for part in ("weight", "bias"):
        for own, other in zip(layers, hidden, strict=False):
            yield getattr(own, part), getattr(other, part)
        last = getattr(layers[-1], part)
        yield last[:count], getattr(actor.mu, part)
        yield last[count:], getattr(actor.log_std, part)
        for params, critic in (critics, targets):
            for which, network in enumerate(critic.q_networks):
                for place, layer in enumerate(network):
                    if isinstance(layer, nn.Linear):
                        yield params["module", str(place), part][which], getattr(layer, part)


def numbers(ours: SAC) -> dict[str, torch.Tensor]:
    """Return what training changes, by name."""
    return {name: p.detach().clone() for name, p in ours._networks().items()}


class Given:
    """A replay buffer of Stable-Baselines3 that holds one batch."""

    def __init__(self, batch: TensorDict) -> None:
        self._batch = batch

    def sample(self, size: int, env: Any = None) -> Any:
        """Return the batch."""
        from stable_baselines3.common.type_aliases import ReplayBufferSamples

        data: Any = self._batch
        after = data["next"]
        over = after["terminated"].float()
        return ReplayBufferSamples(
            data["observation"], data["action"], after["observation"], over, after["reward"], None
        )


@pytest.mark.skipif(not find_spec("stable_baselines3"), reason="needs stable-baselines3")
@pytest.mark.parametrize("loss", ["sac", "fast_sac"])
@pytest.mark.parametrize("still", ["critic", "actor"])
def test_an_update_is_that_of_stable_baselines3(loss: str, still: str, monkeypatch) -> None:
    """From equal weights, transitions and noise: equal after a step of Adam, the target included.

    There the critics move before the actor is judged by them, here all moves at once; so each is
    compared while the other stands still.
    """
    sb3 = pytest.importorskip("stable_baselines3")
    ours = learner(f"loss={loss}", *SMALL, base=partial(MujocoEnv, task=Hopper()), batch_size=32)
    kwargs = {"net_arch": [32, 32]}
    theirs = sb3.SAC("MlpPolicy", "Hopper-v5", device="cpu", policy_kwargs=kwargs)
    with torch.no_grad():
        for own, other in matched(ours, theirs.policy):
            other.copy_(own)
    batch = transitions(32)
    noise = torch.randn(2, 32, 3, generator=torch.Generator().manual_seed(4))
    drawn: list[torch.Tensor] = []
    normal = "torch.distributions.normal._standard_normal"
    monkeypatch.setattr(normal, lambda *_, **__: drawn.pop(0))
    monkeypatch.setattr("torch.randn_like", lambda _: drawn.pop(0))
    before = numbers(ours)
    monkeypatch.setattr(ours._buffer, "sample", lambda count: batch)
    drawn[:] = [noise[1], noise[0]]  # for the next states first
    ours._learn(1)
    drawn[:] = [noise[0], noise[1]]
    theirs._setup_learn(1)
    theirs.replay_buffer = Given(batch)
    part = getattr(theirs, still)
    part.optimizer.param_groups[0]["lr"] = 0.0
    theirs.critic.optimizer.param_groups[0]["eps"] /= 2  # its critics' loss is half of ours
    monkeypatch.setattr(theirs, "_update_learning_rate", lambda _: None)
    theirs.train(1, 32)
    assert not drawn
    after = learner(f"loss={loss}", *SMALL, base=partial(MujocoEnv, task=Hopper()), batch_size=32)
    found = numbers(ours)
    with torch.no_grad():
        after._loss.log_alpha.copy_(theirs.log_ent_coef[0])
        for own, other in matched(after, theirs.policy):
            own.copy_(other)
    compared = {"critic": ("actor_network", "log_alpha"), "actor": ("qvalue_network", "target")}
    for name, value in numbers(after).items():
        if name.startswith(compared[still]) and value.is_floating_point():
            assert (found[name] - before[name]).abs().max() > 1e-6, name
            torch.testing.assert_close(found[name], value, atol=2e-6, rtol=0, msg=name)


@pytest.mark.parametrize("kept", [pytest.param(10_000, marks=pytest.mark.slow), 350])
def test_a_loaded_state_goes_on_to_the_last_bit(kept: int, tmp_path: Path) -> None:
    """Before and after the replay buffer is full, a run from a checkpoint equals the saved one."""
    words = (*SMALL, f"buffer.storage.max_size={kept}")
    first = learner(*words, steps=25, update_ratio=0.25)
    for _ in range(3):
        first.iterate()
    second = learner(*words, seed=5, steps=25, update_ratio=0.25)
    path = CheckpointStore(tmp_path, keep_last=1).save(first, 3, {}, 0.0)
    restore(path, second, {})
    for _ in range(2):
        assert first.iterate() == second.iterate()
    for name, value in numbers(first).items():
        assert torch.equal(value, numbers(second)[name])


@pytest.mark.slow
def test_random_steps_resume_as_such(tmp_path: Path) -> None:
    """A run that is saved before it has learned goes on acting at random for as long."""
    late: dict[str, Any] = {"warmup_frames": 800, "update_ratio": 0.1}
    first, second = learner(**late), learner(seed=5, **late)
    first.iterate()
    restore(CheckpointStore(tmp_path, keep_last=1).save(first, 1, {}, 0.0), second, {})
    for _ in range(2):
        assert first.iterate() == second.iterate()
    assert torch.equal(first._buffer[:]["action"], second._buffer[:]["action"])


def test_updates_follow_steps_in_the_ratio_that_is_set() -> None:
    """None during the warm-up; then so many for each step, also when it is a fraction."""
    for ratio in (0.3, 2.0):
        algorithm = learner(update_ratio=ratio, warmup_frames=200, steps=25)
        algorithm.iterate()
        assert algorithm.updates == 0 and algorithm.frames == 200
        algorithm.iterate()
        assert algorithm.updates == int(ratio * 200)


def test_what_is_remembered_is_what_happened() -> None:
    """The last observation of an episode is kept, not the next start; the limit is no end."""
    algorithm = learner(num_rows=2, warmup_frames=10**6, steps=150)
    seen: list[np.ndarray] = []
    rows: Any = algorithm.collecting.env.base_env.rows
    original = rows.step

    def step(ids: Any, action: np.ndarray) -> Any:
        done = original(ids, action)
        seen.append(done.observation.astype(np.float32))
        return done

    rows.step = step
    algorithm.iterate()
    kept = algorithm._buffer[:]
    after = kept["next", "observation"].reshape(150, 2, -1)
    np.testing.assert_array_equal(after, np.stack(seen))
    assert 0 < int(kept["next", "terminated"].sum()) < 300
    assert 0.9 < float(kept["action"].abs().max()) <= 1


@pytest.mark.slow
def test_it_learns_to_balance_a_pole() -> None:
    """Within 6000 steps the deterministic actor keeps the pole up for 95 of 100."""
    words = (*SMALL, "optimizer.lr=1e-3", "loss.alpha_init=0.1")
    algorithm = learner(*words, gamma=0.98, seed=1)
    score, seeds = 0.0, np.arange(8, dtype=np.uint64)
    while score < 95 and algorithm.frames < 6000:
        algorithm.iterate()
        score = algorithm.trained().run_episodes(seeds).returns.mean()
    assert score >= 95


def test_what_it_trained_acts_within_the_limits() -> None:
    """As tensordict module, as function of raw observations and on a robot: the same actions."""
    trained = learner(base=partial(MujocoEnv, task=InvertedPendulum(max_steps=100))).trained()
    seen = np.random.default_rng(0).standard_normal((6, 4))
    assert trained.program is not None
    program = trained.program(trained.theta)
    with torch.no_grad():
        expected = program(torch.from_numpy(seen)).numpy()
    pilot = trained.controller(num_rows=6)
    np.testing.assert_allclose(pilot(seen), expected, atol=1e-5)
    assert trained.environment.observation_and_action_spec()[2] == pytest.approx(
        3.0
    )  # [N], of the limits
    assert 0 < np.abs(expected).max() < 3.0


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_it_runs_on_a_gpu_and_resumes_there() -> None:
    """Networks are on the device, numbers are finite, and a loaded state goes on alike."""
    first, second = learner(device="cuda"), learner(device="cuda", seed=5)
    first.iterate()
    assert all(p.is_cuda for p in first._loss.parameters())
    second.load_state_dict(first.state_dict())
    metrics = [one.iterate() for one in (first, second)]
    assert metrics[0] == pytest.approx(metrics[1], rel=1e-3)


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Ratios of 0, a policy of another kind, another network, a part that it does not use."""
    with pytest.raises(Sim2RealError, match="update_ratio=0"):
        learner(update_ratio=0.0)
    with pytest.raises(Sim2RealError, match="Policy is neither; use policy=soft_actor_critic"):
        learner("policy=actor_critic")
    with pytest.raises(Sim2RealError, match="SAC does not use advantage"):
        learner("advantage=gae", *SMALL)
    state = learner().state_dict()
    state["policy"] = state["policy"] | {"log_alpha": [8]}
    with pytest.raises(CheckpointError, match="its policy is"):
        learner().load_state_dict(state)
