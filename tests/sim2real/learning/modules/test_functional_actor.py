"""The normal law as a pure function: it is the actor; its Fisher matrix is a Hessian."""

from functools import partial
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict
from torch.func import hessian
from torch.nn.utils import parameters_to_vector
from torchrl.modules import MLP

from envs import MujocoEnv
from envs.tasks import InvertedPendulum
from sim2real.config.compose import compose, instantiate
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.actor_critic import Policy, actor_critic
from sim2real.learning.modules.functional_actor import (
    FunctionalActor,
    divergence,
    fisher_product,
    log_prob,
)
from sim2real.runs.errors import Sim2RealError

SEEN = torch.randn(40, 4, generator=torch.Generator().manual_seed(3)).double()


def policy(*cells: int) -> Policy:
    """Return a small policy in float64."""
    env = EnvironmentFactory(partial(MujocoEnv, task=InvertedPendulum())).make(2)
    network = partial(MLP, num_cells=list(cells), activation_class=torch.nn.Tanh)
    return actor_critic(env, actor=network, critic=network, log_std=-0.3, orthogonal=False).double()


def test_it_is_the_actor() -> None:
    """Means, deviations and log-densities are those of TorchRL's actor; so is the vector."""
    actor = policy(5, 6).actor
    law = FunctionalActor(actor)
    vector = law.vector()
    torch.testing.assert_close(vector, parameters_to_vector(actor.parameters()))
    data = actor(TensorDict({"observation": SEEN}, [40]))
    found = law(vector, *law.read(data))
    torch.testing.assert_close(found[0], data["loc"])
    torch.testing.assert_close(found[1].exp(), data["scale"])
    torch.testing.assert_close(log_prob(found, data["action"]), data["action_log_prob"])
    law.load(vector + 0.1)
    torch.testing.assert_close(law.vector(), vector + 0.1)


def test_the_divergence_is_torchs() -> None:
    """KL(new || old) of two laws equals that of `torch.distributions`, summed over actions."""
    law = FunctionalActor(policy(5).actor)
    vector = law.vector()
    new, old = law(vector + 0.2, SEEN), law(vector, SEEN)
    made = [torch.distributions.Normal(loc, log_scale.exp()) for loc, log_scale in (new, old)]
    expected = torch.distributions.kl_divergence(*made).sum(-1)
    assert float(expected.detach().min()) > 1e-4
    torch.testing.assert_close(divergence(new, old), expected)


def test_its_fisher_matrix_is_the_hessian_of_the_divergence() -> None:
    """Each column of the matrix, multiplied out, equals the Hessian that autograd finds."""
    law = FunctionalActor(policy(4, 3).actor)
    vector = law.vector()
    old = [x.detach() for x in law(vector, SEEN)]

    def mean(theta: torch.Tensor) -> torch.Tensor:
        return divergence(law(theta, SEEN), (old[0], old[1])).mean()

    product = fisher_product(lambda theta: law(theta, SEEN), vector, 1 / len(SEEN))
    found = torch.stack([product(row) for row in torch.eye(len(vector)).double()])
    expected = hessian(mean)(vector)
    assert float(expected.abs().max()) > 0.1
    torch.testing.assert_close(found, expected, atol=1e-10, rtol=1e-8)


def test_an_actor_that_is_no_function_is_refused() -> None:
    """A memory makes an action depend on more than what is seen."""
    words = ["env=hopper", "algorithm=trpo", "policy=gru"]
    _, given = instantiate(compose(words), Path())
    made = given["parts"].policy(given["parts"].environment.make(2))
    with pytest.raises(Sim2RealError, match=r"without a memory; use policy=actor_critic"):
        FunctionalActor(made.actor)
