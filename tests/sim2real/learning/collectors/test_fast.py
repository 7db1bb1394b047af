"""The fast collector against TorchRL's: the same steps, to the last bit."""

from collections.abc import Callable
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule, TensorDictSequential
from torch import nn
from torchrl import envs
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.envs.utils import ExplorationType
from torchrl.modules import MLP, GRUModule, IndependentNormal, ProbabilisticActor, TanhNormal

from envs.effects import make
from envs.mujoco import MujocoEnv
from envs.randomization import Draw, Randomization
from envs.tasks import Hopper
from envs.torch_env import RandomizeParams
from sim2real.learning.collectors.fast import FastCollector
from sim2real.runs.errors import Sim2RealError

MASS = Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0)
NORMALIZED: tuple[Callable[[], envs.Transform], ...] = (
    lambda: envs.VecNormV2(in_keys=["observation"]),
    envs.RewardSum,
    lambda: envs.StepCounter(max_steps=30),
    envs.InitTracker,
)


def world(
    *transforms: Callable[[], envs.Transform], rows: int = 5, draws: tuple[Draw, ...] = (MASS,)
) -> envs.EnvBase:
    """Return Hoppers whose episodes end within a batch, most by a fall, some by the limit."""
    tasks = Randomization(draws)
    env = MujocoEnv(Hopper(max_steps=40), rows, tasks.effects, threads=1, seed=3)
    return envs.TransformedEnv(
        env, envs.Compose([RandomizeParams(tasks), *(make() for make in transforms)])
    )


def bare() -> envs.EnvBase:
    """Return rows that draw by themselves, without transforms."""
    tasks = Randomization((MASS,))
    return MujocoEnv(Hopper(max_steps=40), 5, tasks.effects, threads=1, seed=3, tasks=tasks)


def actor(distribution: Any = IndependentNormal, inputs: int = 11) -> ProbabilisticActor:
    """Return an actor of a small network."""
    torch.manual_seed(0)
    mean = MLP(in_features=inputs, out_features=3, num_cells=[16], activation_class=nn.Tanh)
    body = nn.Sequential(mean, AddStateIndependentNormalScale(3))
    return ProbabilisticActor(
        TensorDictModule(body, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=distribution,
        return_log_prob=True,
    )


def batches(kind: type[Collector], env: envs.EnvBase, policy: Any, **options: Any) -> list[Any]:
    """Return two batches of 60 steps a row, and the state that the collector ends in."""
    options = {"frames_per_batch": 60 * env.batch_size.numel(), "total_frames": -1} | options
    collector = kind(env, policy, **options)
    torch.manual_seed(1)
    found = [batch for batch, _ in zip(collector, range(2), strict=False)]
    found.append(dict(collector.state_dict()["env_state_dict"]))
    collector.shutdown()
    return found


def flat(batch: TensorDictBase) -> dict[Any, torch.Tensor]:
    """Return the entries of a tensordict by their whole keys."""
    return dict(batch.items(include_nested=True, leaves_only=True))


def compare(make: Callable[[], envs.EnvBase], policy: Any, **options: Any) -> TensorDictBase:
    """Hold the batches of both collectors against each other; return one of them."""
    ours, theirs = (batches(kind, make(), policy, **options) for kind in (FastCollector, Collector))
    assert ours.pop().keys() == theirs.pop().keys()
    for one, other in zip(ours, theirs, strict=True):
        assert one.batch_size == other.batch_size and one.names == other.names
        assert one.device == other.device
        mine, yours = flat(one), flat(other)
        assert mine.keys() == yours.keys()
        for key, value in yours.items():
            torch.testing.assert_close(mine[key], value, atol=0, rtol=0, msg=str(key))
    return ours[0]


@pytest.mark.parametrize(
    "make",
    [world, lambda: world(*NORMALIZED), bare, lambda: world(draws=()), lambda: world(rows=1)],
    ids=["randomized", "transforms", "bare", "no parameters", "one row"],
)
def test_it_yields_what_collector_yields(make: Callable[[], envs.EnvBase]) -> None:
    """Entries, shapes, names and values agree to the last bit, falls and time limits included."""
    batch = compare(make, actor())
    assert batch["next", "terminated"].any()
    assert (batch["collector", "traj_ids"].diff(dim=-1) > 0).any()


@pytest.mark.parametrize(
    "options",
    [
        {"exploration_type": ExplorationType.DETERMINISTIC, "reset_at_each_iter": True},
        {"track_traj_ids": False, "set_truncated": True},
        {"max_frames_per_traj": 7, "init_random_frames": 60 * 5},
    ],
    ids=" ".join,
)
def test_options_mean_what_they_mean_there(options: dict[str, Any]) -> None:
    """Each option of TorchRL's collector, two at a time, gives the same steps here."""
    compare(lambda: world(*NORMALIZED[:2], envs.InitTracker), actor(), **options)


@pytest.mark.slow
def test_any_policy_and_any_transform_goes_through() -> None:
    """A squashed Gaussian, a memory with its primer, a transform that keeps frames of its own."""
    compare(world, actor(TanhNormal))
    frames = lambda: envs.CatFrames(N=3, dim=-1, in_keys=["observation"])  # noqa: E731
    compare(lambda: world(frames), actor(inputs=33))
    scaled = lambda: envs.ActionScaling(loc=torch.zeros(3), scale=torch.full((3,), 0.5))  # noqa: E731
    compare(lambda: world(scaled), actor())
    keys: Any = {"in_keys": ["observation", "memory", "is_init"]}
    memory = GRUModule(11, 8, **keys, out_keys=["seen", ("next", "memory")], python_based=True)
    head = TensorDictModule(nn.Linear(8, 3), in_keys=["seen"], out_keys=["action"])
    policy = TensorDictSequential([memory, head])
    compare(lambda: world(envs.InitTracker, memory.make_tensordict_primer), policy)


def test_a_buffer_is_filled() -> None:
    """Given a replay buffer it extends it, as TorchRL's does."""
    kept = []
    for kind in (FastCollector, Collector):
        buffer = ReplayBuffer(storage=LazyTensorStorage(1000))
        batches(kind, world(), actor(), replay_buffer=buffer, auto_register_policy_transforms=False)
        kept.append(flat(buffer[:]))
    assert kept[0].keys() == kept[1].keys()
    for key, value in kept[1].items():
        torch.testing.assert_close(kept[0][key], value, atol=0, rtol=0, msg=str(key))


def test_what_it_has_not_is_refused() -> None:
    """Options and environments that need TorchRL's collector: a sentence that says so."""
    with pytest.raises(
        Sim2RealError, match="does not support compact_obs=True; use collector=sync"
    ):
        FastCollector(world(), actor(), frames_per_batch=5, compact_obs=True)
    with pytest.raises(Sim2RealError, match=r"batch size \(\)"):
        FastCollector(envs.GymEnv("Pendulum-v1"), None, frames_per_batch=5)
