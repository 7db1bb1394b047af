"""ES-MAML over actors of tensordict modules: perceptrons, networks of a user's, with a memory."""

from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn
from torchrl.envs import CatFrames
from torchrl.modules import MLP, GRUModule

from envs.effects import make
from envs.mujoco import MujocoEnv
from envs.randomization import Draw, Randomization
from envs.tasks import Hopper
from sim2real.learning.adapt import GradientAdaptation, HillClimb
from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.esmaml import ESMAML, ESMAMLSettings
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.actor_critic import actor_critic
from sim2real.learning.population.actors import ActorSlots, PerceptronSlots
from sim2real.learning.population.population import PopulationRequest
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.learning.algorithms.test_esmaml import OPTIONS, SMALL


class Sine(nn.Module):
    """A network of a user's own."""

    def __init__(self, in_features: int, out_features: int) -> None:
        super().__init__()
        self.first, self.last = nn.Linear(in_features, 5), nn.Linear(5, out_features)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Compute it."""
        return self.last(torch.sin(self.first(x)))


NETWORK = partial(MLP, num_cells=[6], activation_class=nn.Tanh)
PERCEPTRON = partial(actor_critic, actor=NETWORK, critic=NETWORK)
OWN = partial(actor_critic, actor=Sine, critic=NETWORK)
MEMORY = partial(GRUModule, hidden_size=4, python_based=True)
RECURRENT = partial(actor_critic, actor=NETWORK, critic=NETWORK, memory=MEMORY)
POLICIES = {"perceptron": PERCEPTRON, "own": OWN, "recurrent": RECURRENT}
CLIMB = HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1)
STACK = {"stack": partial(CatFrames, N=2, dim=-1, in_keys=["observation"])}
each_policy = pytest.mark.parametrize("policy", POLICIES.values(), ids=POLICIES)


def made(policy: Any, adapt: Any = CLIMB, seed: int = 0, **changes: Any) -> ESMAML:
    """Return the algorithm on short Hopper episodes with masses of their own."""
    transforms = changes.pop("transforms", {})
    tasks = Randomization([Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0)])
    environment = EnvironmentFactory(
        partial(MujocoEnv, task=Hopper(max_steps=15)), tasks, transforms
    )
    return ESMAML(
        Components(environment, policy, seed, adapt),
        ESMAMLSettings(**{**OPTIONS, **SMALL, "pairs": 3, **changes}),
    )


@each_policy
@pytest.mark.parametrize(
    "transforms", [pytest.param({}, marks=pytest.mark.slow), STACK], ids=["plain", "stacked"]
)
def test_an_actor_trains_and_resumes_bit_for_bit(policy: Any, transforms: Any) -> None:
    """Another seed, other rows and two shards: after the state is loaded, the same numbers."""
    one = made(policy, transforms=transforms)
    first = one.theta
    one.iterate()
    other = made(policy, seed=5, num_rows=5, shards=2, transforms=transforms)
    other.load_state_dict(one.state_dict())
    assert one.iterate() == other.iterate()
    np.testing.assert_array_equal(one.theta, other.theta)
    assert np.abs(one.theta - first).max() > 1e-4


@each_policy
def test_what_is_trained_plays_as_its_members_did(policy: Any) -> None:
    """The policy that is evaluated and deployed: same parameters, normalizer, memory and limits."""
    algorithm = made(policy)
    algorithm.iterate()
    rng = np.random.default_rng(0)
    values, seeds = algorithm.tasks.sample(rng, 3), np.arange(3, dtype=np.uint64)
    played = algorithm.trained().run_episodes(seeds, values=values)
    cohort = CLIMB.start_many(np.tile(algorithm.theta, (3, 1)), [rng] * 3)
    episodes = np.repeat(seeds[:, None], CLIMB.episodes, axis=1)
    results = algorithm.population.run(
        PopulationRequest(cohort, values, values, episodes), algorithm.normalizer
    )
    np.testing.assert_allclose(played.returns, results.returns[:, 0], rtol=1e-4)


def test_a_perceptron_comes_to_the_same_on_both_paths() -> None:
    """Called by torch.func for all rows at once, or as the fast network: equal to 1e-6."""
    fast, general = made(PERCEPTRON), made(PERCEPTRON)
    setattr(general.policy, "_perceptron", None)  # noqa: B010 - it has the one of several kinds
    assert isinstance(fast.policy.slots(1), PerceptronSlots)
    assert isinstance(general.policy.slots(1), ActorSlots)
    general.population = type(general.population)(
        [general.parts.environment.rows(4)], general.policy
    )
    metrics = [one.iterate() for one in (fast, general)]
    assert metrics[0] == pytest.approx(metrics[1], rel=1e-6)
    np.testing.assert_allclose(fast.theta, general.theta, rtol=1e-6)


@each_policy
def test_every_operator_adapts_it(policy: Any) -> None:
    """A gradient step and hill climbing change the parameters of a robot's policy."""
    for adapt in (CLIMB, GradientAdaptation(queries=2, sigma=0.1, rate=0.1, baseline="mean")):
        algorithm = made(policy, adapt)
        assert algorithm.adapted(np.array([5.0]), np.random.default_rng(0)) is not None
        scores = algorithm.scores(np.array([[5.0]]), np.zeros(1, np.uint64), 1)
        assert np.isfinite(scores.after).all() and scores.steps > 0


def test_the_seed_decides_the_first_parameters() -> None:
    """The same seed draws the same actor, whatever torch's generator stands at."""
    first = made(PERCEPTRON).theta
    torch.rand(1)
    np.testing.assert_array_equal(made(PERCEPTRON).theta, first)
    assert np.abs(made(PERCEPTRON, seed=1).theta - first).max() > 1e-3


def test_only_a_function_of_what_a_robot_shows_is_exported() -> None:
    """A perceptron is one torch module; with a memory, or behind stacked frames, it is none."""
    assert made(PERCEPTRON).trained().program is not None
    assert made(RECURRENT).trained().program is None
    assert made(PERCEPTRON, transforms=STACK).trained().program is None


def test_a_policy_without_an_actor_is_refused() -> None:
    """A bare network is no policy."""
    with pytest.raises(Sim2RealError, match="Linear has no tensordict module of that name"):
        made(lambda env: nn.Linear(11, 3))
