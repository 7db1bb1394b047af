"""Tensordict actors in a population: each row acts by its own parameters and memory alone."""

from typing import Any

import numpy as np
import pytest
import torch
from tensordict import NestedKey, TensorDict
from tensordict.nn import (
    AddStateIndependentNormalScale,
    NormalParamExtractor,
    ProbabilisticTensorDictSequential,
    TensorDictModule,
    TensorDictSequential,
)
from torch import nn
from torch.nn.utils import vector_to_parameters
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.modules import MLP, GRUModule, IndependentNormal, ProbabilisticActor, TanhNormal

from envs.mujoco import MujocoEnv
from envs.tasks import Hopper
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.population.actors import ActorPolicy, ActorSlots, PerceptronSlots
from sim2real.learning.population.population import Population, PopulationRequest
from sim2real.runs.errors import Sim2RealError

KEYS: list[NestedKey] = ["loc", "scale"]


def perceptron(distribution: Any = IndependentNormal, width: int = 7) -> Any:
    """Return an actor of Hopper's 11 numbers and 3 actions."""
    mean = MLP(in_features=11, out_features=3, num_cells=[width], activation_class=nn.Tanh)
    body = nn.Sequential(mean, AddStateIndependentNormalScale(3))
    module = TensorDictModule(body, in_keys=["observation"], out_keys=KEYS)
    return ProbabilisticActor(module, in_keys=KEYS, distribution_class=distribution)


def recurrent(python_based: bool = True, width: int = 7) -> Any:
    """Return an actor with a memory."""
    keys: Any = {"in_keys": ["observation", "memory", "is_init"]}
    keys["out_keys"] = ["seen", ("next", "memory")]
    memory = GRUModule(11, width, **keys, python_based=python_based)
    head = nn.Sequential(nn.Linear(width, 3), AddStateIndependentNormalScale(3))
    modules = TensorDictSequential([memory, TensorDictModule(head, ["seen"], KEYS)])
    return ProbabilisticActor(modules, in_keys=KEYS, distribution_class=IndependentNormal)


def policy(actor: Any) -> ActorPolicy:
    """Return it for Hopper."""
    return ActorPolicy(actor, MujocoEnv(Hopper(), 1, threads=1))


def thetas(of: ActorPolicy, count: int) -> np.ndarray:
    """Return parameter vectors of size about 0.3."""
    rng = np.random.default_rng(0)
    return (0.3 * rng.standard_normal((count, of.num_parameters))).astype(np.float32)


def alone(actor: ProbabilisticTensorDictSequential, theta: np.ndarray, seen: np.ndarray) -> Any:
    """Return the actions of one actor, called by itself, on observations (T, O) of an episode."""
    vector_to_parameters(torch.from_numpy(theta.copy()), actor.parameters())
    memory, actions = torch.zeros(1, 1, 7), []
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        for one in torch.from_numpy(seen).float():
            begin = torch.zeros(1, 1, dtype=torch.bool)
            shown = {"observation": one[None], "memory": memory, "is_init": begin}
            out = actor(TensorDict(shown, [1]))
            memory = out.get(("next", "memory"), memory)
            actions.append(out["action"][0].clamp(-1, 1).numpy())  # Hopper's limits
    return np.array(actions)


MAKERS = [perceptron, lambda: perceptron(TanhNormal), recurrent]
NAMES = ["perceptron", "squashed", "recurrent"]


def test_a_scale_of_the_state_is_no_part_of_the_means() -> None:
    """An actor whose network says means and scales acts by the means alone."""
    body = nn.Sequential(nn.Linear(11, 7), nn.Tanh(), nn.Linear(7, 6), NormalParamExtractor())
    module = TensorDictModule(body, in_keys=["observation"], out_keys=KEYS)
    actor = ProbabilisticActor(module, in_keys=KEYS, distribution_class=IndependentNormal)
    one, seen = policy(actor), np.random.default_rng(1).standard_normal((3, 1, 11))
    given, slots = thetas(one, 1), one.slots(1)
    slots.load(np.arange(1), given)
    acted = np.array([slots.act(None, now)[0] for now in seen])
    np.testing.assert_allclose(acted, alone(actor, given[0], seen[:, 0]), atol=1e-5)


@pytest.mark.parametrize("make", MAKERS, ids=NAMES)
def test_each_row_is_its_own_actor(make: Any) -> None:
    """Through several steps, a row acts as the actor with its parameters does by itself."""
    one = policy(make())
    kind = PerceptronSlots if make is perceptron else ActorSlots
    slots, given = one.slots(40), thetas(one, 40)
    assert isinstance(slots, kind)
    slots.load(np.arange(40), given)
    seen = np.random.default_rng(1).standard_normal((6, 40, 11))
    acted = np.array([slots.act(None, now) for now in seen])
    for row in (0, 17, 39):
        expected = alone(make(), given[row], seen[:, row])
        np.testing.assert_allclose(acted[:, row], expected, atol=1e-5)
    assert np.abs(acted[0, 0] - acted[0, 1]).max() > 1e-3


@pytest.mark.parametrize("make", MAKERS, ids=NAMES)
@pytest.mark.parametrize("count", [1, 3, 33])
def test_neighbours_change_no_bit(make: Any, count: int) -> None:
    """In other rows, among others or alone, with rows that pause: the same actions to the bit."""
    one = policy(make())
    given, seen = thetas(one, 70), np.random.default_rng(2).standard_normal((5, 70, 11))
    whole, some = one.slots(70), one.slots(count)
    whole.load(np.arange(70), given)
    picked = np.sort(np.random.default_rng(3).permutation(70)[:count])
    some.load(np.arange(count), given[picked])
    for now in seen:
        acted = whole.act(picked, now[picked]) if count > 1 else whole.act(None, now)[picked]
        assert np.array_equal(some.act(None, now[picked]), acted)


def test_an_episode_begins_without_a_memory() -> None:
    """A row that is loaded again acts as one that was never used; the others remember."""
    one = policy(recurrent())
    given, seen = thetas(one, 2), np.random.default_rng(1).standard_normal((2, 2, 11))
    used, fresh = one.slots(2), one.slots(2)
    for slots in (used, fresh):
        slots.load(np.arange(2), given)
    used.act(None, seen[0])
    used.load(np.array([1]), given[1:])
    later, first = used.act(None, seen[1]), fresh.act(None, seen[1])
    assert np.array_equal(later[1], first[1])
    assert np.abs(later[0] - first[0]).max() > 1e-4


def test_a_population_runs_it() -> None:
    """Members with memories play whole episodes; in how many rows they do changes no return."""
    one, returns = policy(recurrent()), []
    cohort_of = NoAdaptation()
    for rows in (3, 8):
        env = MujocoEnv(Hopper(max_steps=20), rows, threads=1)
        cohort = cohort_of.start_many(thetas(one, 5), [np.random.default_rng(0)] * 5)
        seeds = np.arange(5, dtype=np.uint64)[:, None]
        members = PopulationRequest(cohort, np.zeros((5, 0)), np.zeros((5, 0)), seeds)
        returns.append(Population([env.rows], one).run(members, None).returns)  # type: ignore[arg-type]
    assert np.array_equal(*returns) and len(np.unique(returns[0])) == 5


def test_its_module_sees_raw_observations() -> None:
    """What is evaluated and exported normalizes by itself, and acts as the row did."""
    one = policy(perceptron())
    theta, raw = thetas(one, 1)[0], np.random.default_rng(1).standard_normal((4, 11)) * 3 + 1
    mean, std = np.full(11, 1.0), np.full(11, 3.0)
    slots = one.slots(4)
    slots.load(np.arange(4), np.tile(theta, (4, 1)))
    expected = slots.act(None, (raw - mean) / std)
    shown = TensorDict({"observation": torch.from_numpy(raw)}, [4])
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        out = one.acting(theta, mean, std)(shown)
    np.testing.assert_allclose(out["action"].clamp(-1, 1), expected, atol=1e-5)
    assert torch.equal(out["observation"], torch.from_numpy(raw))


def test_what_rows_cannot_call_is_refused() -> None:
    """A fused GRU, entries that rows do not have: a sentence each."""
    with pytest.raises(Sim2RealError, match=r"python_based=true"):
        policy(recurrent(python_based=False))
    module = TensorDictModule(nn.Linear(4, 3), in_keys=["pixels"], out_keys=["action"])
    with pytest.raises(Sim2RealError, match=r"do not receive pixels"):
        policy(module)
