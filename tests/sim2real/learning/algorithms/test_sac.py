"""SAC: that its gradients are SACLoss's, that it resumes, that it learns."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import ProbabilisticTensorDictModule, ProbabilisticTensorDictSequential
from tensordict.nn import TensorDictModule as Mod
from torch import nn
from torchrl.data import Bounded
from torchrl.objectives import SACLoss

from envs import MujocoEnv
from envs.tasks import InvertedPendulum
from sim2real.config.compose import compose, prepare
from sim2real.learning.algorithms.base import build
from sim2real.learning.algorithms.sac import SAC
from sim2real.learning.losses.sac_loss import SACGradient, Transitions
from sim2real.learning.modules.perceptrons import Perceptrons
from sim2real.learning.modules.soft_actor_critic import SoftActorCritic, draw
from sim2real.runs.checkpoint import CheckpointStore, restore
from sim2real.runs.errors import CheckpointError, Sim2RealError

PENDULUM = partial(MujocoEnv, task=InvertedPendulum(max_steps=100))
GAMMA, ALPHA, TARGET = 0.97, 0.3, -2.0


def network() -> SoftActorCritic:
    """Return networks of 5 observations and 2 actions, the target not quite the critics."""
    low, high = -np.ones(2), np.ones(2)
    policy = SoftActorCritic(5, 2, low, high, hidden=(16, 8), activation="relu")
    policy.initialize(torch.Generator().manual_seed(0))
    with torch.no_grad():
        policy.target.add_(0.1 * torch.randn(policy.target.shape, generator=generator(1)))
        noise = torch.randn(policy.actor_theta.shape, generator=generator(2))
        policy.actor_theta.add_(0.1 * noise)
    return policy


def generator(seed: int) -> torch.Generator:
    """Return a seeded generator."""
    return torch.Generator().manual_seed(seed)


def transitions(count: int = 32) -> Transitions:
    """Return transitions, some of which end the episode."""
    g = generator(3)
    seen, after = torch.randn(2, count, 5, generator=g)
    action = torch.rand(count, 2, generator=g) * 2 - 1
    over = (torch.rand(count, generator=g) < 0.3).float()
    return Transitions(seen, action, torch.randn(count, generator=g), after, over)


class Squashed(torch.distributions.Distribution):
    """The actor's distribution with its noise given beforehand, for TorchRL."""

    noises: list[torch.Tensor]
    arg_constraints = {}  # type: ignore[assignment]  # noqa: RUF012 - as torch names it

    def __init__(self, said: torch.Tensor) -> None:
        super().__init__(said.shape[:-1], said.shape[-1:], validate_args=False)
        self._drawn = draw(said, Squashed.noises.pop(0))

    def rsample(self, sample_shape: Any = ()) -> torch.Tensor:
        """Return the actions."""
        return self._drawn.action

    def log_prob(self, value: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of the density at those actions."""
        return self._drawn.log_prob


class Actor(nn.Module):
    """What our actor says, as a module of its own parameters."""

    def __init__(self, policy: SoftActorCritic) -> None:
        super().__init__()
        self.theta, self._body = (
            nn.Parameter(policy.actor_theta.detach().clone()),
            policy.actor_body,
        )

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return means and logarithmic deviations."""
        return self._body.forward(self._body.weights(self.theta), observation)[-1][0]


class Critic(nn.Module):
    """One of our critics, by itself."""

    def __init__(self, policy: SoftActorCritic, flat: torch.Tensor, which: int) -> None:
        super().__init__()
        self._body = Perceptrons(1, policy.critic_body.sizes, policy.activation, "linear")
        self.theta = nn.Parameter(alone(policy, flat, which))

    def forward(self, observation: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        """Return its values, (B, 1)."""
        both = torch.cat([observation, action], dim=-1)
        return self._body.forward(self._body.weights(self.theta), both)[-1][0]


def alone(policy: SoftActorCritic, flat: torch.Tensor, which: int) -> torch.Tensor:
    """Return what belongs to one critic of a flat vector of both."""
    layers = policy.critic_body.weights(flat.detach())
    return torch.cat([part[which].flatten() for layer in layers for part in layer])


def sac_loss(policy: SoftActorCritic) -> SACLoss:
    """Return TorchRL's loss of the same networks."""
    chain: Any = ProbabilisticTensorDictSequential
    actor = chain(
        Mod(Actor(policy), in_keys=["observation"], out_keys=["said"]),
        ProbabilisticTensorDictModule(
            in_keys=["said"], out_keys=["action"], distribution_class=Squashed, return_log_prob=True
        ),
    )
    keys: dict[str, Any] = {
        "in_keys": ["observation", "action"],
        "out_keys": ["state_action_value"],
    }
    critics = [Mod(Critic(policy, policy.critic_theta, k), **keys) for k in range(2)]
    loss = SACLoss(
        actor,
        critics,  # type: ignore[arg-type]
        loss_function="l2",
        alpha_init=ALPHA,
        target_entropy=TARGET,
        action_spec=Bounded(-1.0, 1.0, torch.Size((2,))),
    )
    loss.make_value_estimator(gamma=GAMMA)
    targets = loss.target_qvalue_network_params["module", "theta"]
    with torch.no_grad():
        targets.copy_(torch.stack([alone(policy, policy.target, k) for k in range(2)]))
    return loss


def test_the_gradients_are_those_of_sac_loss() -> None:
    """From equal networks, transitions and noise: actor, both critics and temperature to 1e-6."""
    policy, batch = network(), transitions()
    noise = torch.randn(2, len(batch.reward), 2, generator=generator(4))
    mine = SACGradient(policy, GAMMA, TARGET)(batch, noise[0], noise[1], torch.tensor(ALPHA))
    over = batch.terminated.bool()[:, None]
    after = {"observation": batch.next_observation, "reward": batch.reward[:, None]}
    data = {"observation": batch.observation, "action": batch.action}
    following = after | {"done": over, "terminated": over}
    Squashed.noises = [noise[1], noise[0]]  # it draws for the next states first
    loss = sac_loss(policy)
    parts = loss(TensorDict(data | {"next": following}, [len(batch.reward)]))
    assert not Squashed.noises
    for name in ("loss_actor", "loss_qvalue", "loss_alpha"):
        parts[name].backward()
    actor, critics = (
        params["module", *path].grad
        for params, path in (
            (loss.actor_network_params, ("0", "module", "theta")),
            (loss.qvalue_network_params, ("theta",)),
        )
    )
    close: Any = {"atol": 1e-6, "rtol": 1e-5}
    torch.testing.assert_close(policy.actor_theta.grad, actor, **close)
    for k in range(2):
        assert policy.critic_theta.grad is not None
        own = alone(policy, policy.critic_theta.grad, k)
        assert float(own.norm()) > 0.1
        torch.testing.assert_close(own, critics[k], **close)
    temperature: Any = loss.log_alpha
    torch.testing.assert_close(mine, temperature.grad.reshape(()), **close)


def test_probabilities_are_those_of_squashed_gaussians() -> None:
    """The density of tanh(x) integrates to 1, and is exact where tanh rounds to 1."""
    x = torch.linspace(-12, 12, 20001, dtype=torch.float64)[:, None]
    said = torch.tensor([[0.4, -0.2]], dtype=torch.float64).expand(len(x), 2)
    noise = (x - 0.4) / np.exp(-0.2)
    drawn = draw(said, noise)
    density = torch.exp(drawn.log_prob) * (1 - torch.tanh(x[:, 0]) ** 2)  # by x
    assert float(torch.trapezoid(density, x[:, 0])) == pytest.approx(1.0, abs=1e-6)
    far = draw(torch.tensor([[30.0, 0.0]]), torch.zeros(1, 1))
    assert float(far.log_prob) == pytest.approx(-0.5 * np.log(2 * np.pi) + 60 - 2 * np.log(2))


def learner(*words: str, seed: int = 0, device: str = "cpu", **changes: Any) -> SAC:
    """Return an untrained SAC of the preset, with small networks."""
    settings = {"batch_size": 64, "steps": 50} | changes
    own = [f"algorithm.{name}={value}" for name, value in settings.items()]
    words = words or ("policy.hidden=[32,32]",)
    _, given = prepare(compose(["algorithm=sac", *words, *own]), Path())
    environment = replace(given["parts"].environment, base=PENDULUM)
    parts = replace(given["parts"], environment=environment, seed=seed, device=device)
    made = build(given["algorithm"], parts)
    assert isinstance(made, SAC)
    return made


@pytest.mark.parametrize("buffer", [10_000, 700])
def test_a_loaded_state_goes_on_to_the_last_bit(buffer: int, tmp_path: Path) -> None:
    """Before and after the replay buffer is full, a run from a checkpoint equals the saved one."""
    first = learner(buffer_size=buffer)
    for _ in range(3):
        first.iterate()
    second = learner(buffer_size=buffer, seed=5)
    path = CheckpointStore(tmp_path, keep_last=1).save(first, 3, {}, 0.0)
    restore(path, second, {})
    for _ in range(2):
        assert first.iterate() == second.iterate()
    for name, value in first.policy.state_dict().items():
        assert torch.equal(value, second.policy.state_dict()[name])


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
    original = algorithm.stream.step

    def step(action: np.ndarray) -> Any:
        done = original(action)
        seen.append(done.observation.astype(np.float32))
        return done

    algorithm.stream.step = step  # type: ignore[method-assign]
    algorithm.iterate()
    kept = algorithm._replay.storage[:300]
    np.testing.assert_array_equal(kept["next_observation"].reshape(150, 2, -1), np.stack(seen))
    assert 0 < float(kept["terminated"].sum()) < 300
    assert float(kept["action"].abs().max()) <= 1


def test_it_learns_to_balance_a_pole() -> None:
    """Within 6000 steps, seconds of work, the deterministic actor keeps the pole up for all 100."""
    algorithm = learner(gamma=0.98, learning_rate=1e-3, alpha=0.1)
    score, seeds = 0.0, np.arange(8, dtype=np.uint64)
    while score < 95 and algorithm.frames < 6000:
        algorithm.iterate()
        score = algorithm.trained().play(seeds).returns.mean()
    assert score >= 95


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_it_runs_on_a_gpu_and_resumes_there() -> None:
    """Networks are on the device, numbers are finite, and a loaded state goes on alike."""
    first, second = learner(device="cuda"), learner(device="cuda", seed=5)
    first.iterate()
    assert first.policy.actor_theta.is_cuda
    second.load_state_dict(first.state_dict())
    metrics = [one.iterate() for one in (first, second)]
    assert metrics[0] == pytest.approx(metrics[1], rel=1e-3)
    assert torch.isfinite(first.policy.actor_theta).all()


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Ratios of 0, a buffer smaller than a step, a policy of another kind, another network."""
    with pytest.raises(Sim2RealError, match="update_ratio=0"):
        learner(update_ratio=0.0)
    with pytest.raises(Sim2RealError, match="buffer_size=4 must be at least 8"):
        learner(buffer_size=4)
    with pytest.raises(Sim2RealError, match="Policy is none; use policy=soft_actor_critic"):
        learner("policy=actor_critic")
    state = learner().state_dict()
    state["policy"] = state["policy"] | {"hidden": [8]}
    with pytest.raises(CheckpointError, match="its policy is"):
        learner().load_state_dict(state)
