"""The meta-objective: its gradient and its Fisher product, through the step of adaptation."""

from dataclasses import replace

import pytest
import torch
from torch.func import hessian, vmap

from sim2real.learning.adapt import LinearGAE, PolicyGradient
from sim2real.learning.adapt.policy_gradient import TransitionBatch
from sim2real.learning.losses.meta import MetaObjective
from sim2real.learning.modules.functional_actor import FunctionalActor, divergence, log_prob
from tests.sim2real.learning.modules.test_functional_actor import policy

Tensor = torch.Tensor
TASKS, STEPS = 3, 12
JUDGE = LinearGAE(gamma=0.99, lmbda=1.0, ridge=1e-5)
ADAPT = PolicyGradient(trajectories=4, rate=0.3, surrogate="likelihood", advantage=JUDGE)
surrogates = pytest.mark.parametrize("surrogate", ["likelihood", "ratio"])


def experience(law: FunctionalActor, thetas: Tensor, seed: int) -> TransitionBatch:
    """Return steps of each task, drawn under parameters (B, P)."""
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> Tensor:
        return torch.randn(TASKS, STEPS, *shape, generator=generator).double()

    seen = random(4)
    loc, log_scale = vmap(law)(thetas, seen)
    action = loc + log_scale.exp() * random(1)
    score = log_prob((loc, log_scale), action)
    weight = torch.full_like(score, 1 / STEPS)
    return TransitionBatch((seen,), action, score, random(), weight)


def made(surrogate: str = "likelihood", first_order: bool = False) -> MetaObjective:
    """Return an objective of 3 tasks and a net of 4 tanh units, in float64."""
    torch.manual_seed(1)
    law = FunctionalActor(policy(4).actor)
    start = law.vector()
    adapt = replace(ADAPT, surrogate=surrogate)
    before = experience(law, start.expand(TASKS, -1), 0)
    thetas = vmap(lambda one: adapt.step(law, start, one))(before)
    after = experience(law, thetas, 1)
    return MetaObjective(law, adapt, before, after, start, first_order=first_order)


@surrogates
def test_the_meta_gradient_is_that_of_finite_differences(surrogate: str) -> None:
    """Each number of the gradient equals the central difference of the objective."""
    objective = made(surrogate)
    start, step = objective.start, 1e-5
    expected = []
    for direction in torch.eye(len(start)).double():
        up, down = (objective.assess(start + s * step * direction).objective for s in (1, -1))
        expected.append((up - down) / (2 * step))
    found = objective.gradient()
    assert float(found.abs().max()) > 0.01
    torch.testing.assert_close(found, torch.tensor(expected).double(), atol=1e-7, rtol=1e-5)


@surrogates
def test_the_fisher_product_is_the_hessian_of_the_divergence(surrogate: str) -> None:
    """Through the step of adaptation, on the same steps, all columns of the matrix."""
    objective = made(surrogate)
    law = objective._law
    product = objective.fisher(lambda x: x)
    found = torch.stack([product(row) for row in torch.eye(len(objective.start)).double()])
    acted = vmap(law)(objective.thetas, *objective.after.seen)

    def mean(theta: Tensor) -> Tensor:
        reached = objective.adapted(theta)
        return divergence(vmap(law)(reached, *objective.after.seen), acted).mean()

    expected = hessian(mean)(objective.start)
    plain = replace(objective._operator, rate=1e-12)
    without = MetaObjective(
        law, plain, objective.before, objective.after, objective.start, first_order=False
    ).fisher(lambda x: x)
    torch.testing.assert_close(found, expected, atol=1e-10, rtol=1e-7)
    assert float((without(found[0]) - product(found[0])).abs().max()) > 1e-3  # it matters


def test_first_order_leaves_the_second_derivatives_out() -> None:
    """Its gradient is the mean over tasks of the gradients where the adaptation arrived."""
    objective, whole = made(first_order=True), made()
    law, after = objective._law, objective.after

    def one(theta: Tensor, index: int) -> Tensor:
        score = log_prob(law(theta, after.seen[0][index]), after.action[index])
        return ((score - after.log_prob[index]).exp() * after.advantage[index]).mean()

    gradients = [
        torch.func.grad(lambda theta, i=i: one(theta, i))(objective.thetas[i]) for i in range(TASKS)
    ]
    torch.testing.assert_close(objective.gradient(), torch.stack(gradients).mean(0))
    assert float((objective.gradient() - whole.gradient()).abs().max()) > 1e-3


def test_the_clipped_objective_starts_along_the_meta_gradient() -> None:
    """At the start no ratio is clipped and nothing diverges; far away the clipping holds it."""
    objective = made("ratio")
    slope = torch.func.grad(objective.clipped)
    torch.testing.assert_close(slope(objective.start, 0.3, 0.5), objective.gradient())
    far = objective.start + 0.5 * objective.gradient() / objective.gradient().norm()
    free, clipped = objective.assess(far).objective, objective.clipped(far, 0.05, 0.0)
    assert float(clipped) < free
    assert float(objective.clipped(far, 0.05, 1.0)) < float(clipped)


def test_a_sample_of_steps_bends_where_all_of_them_arrive() -> None:
    """With a few steps the product is taken at the exact adapted parameters."""
    objective = made()

    def pick(x: TransitionBatch) -> TransitionBatch:
        action, log_prob, advantage = (part[:, :4] for part in x[1:4])
        weight = torch.full_like(log_prob, 0.25)
        return TransitionBatch((x.seen[0][:, :4],), action, log_prob, advantage, weight)

    few = pick(objective.before), pick(objective.after)
    found = objective.fisher(pick)(objective.start)
    law = objective._law
    reached = objective.adapted(objective.start, few[0])
    assert float((reached - objective.thetas).abs().max()) > 1e-3
    acted = vmap(law)(objective.thetas, *few[1].seen)

    def mean(theta: Tensor) -> Tensor:
        moved = objective.adapted(theta, few[0]) - reached + objective.thetas
        return divergence(vmap(law)(moved, *few[1].seen), acted).mean()

    expected = hessian(mean)(objective.start) @ objective.start
    torch.testing.assert_close(found, expected, atol=1e-10, rtol=1e-7)
