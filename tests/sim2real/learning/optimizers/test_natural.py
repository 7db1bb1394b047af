"""The natural-gradient step: on a quadratic, within its trust region, and where there is none."""

import logging
from typing import Any

import pytest
import torch

from sim2real.learning.optimizers.natural import NaturalStep, ObjectiveAndKL, conjugate_gradient
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
SETTINGS: dict[str, Any] = {
    "max_kl": 0.01, "cg_iterations": 20, "damping": 0.0, "backtracks": 5, "shrink": 0.5,
}  # fmt: skip
START = torch.zeros(4, dtype=torch.float64)
GRADIENT = torch.tensor([1.0, -2.0, 0.5, 3.0], dtype=torch.float64)
STRETCH = torch.tensor([4.0, 1.0, 0.5, 2.0], dtype=torch.float64)


def metric() -> Tensor:
    """Return a positive definite matrix, (4, 4)."""
    turn = torch.linalg.qr(torch.randn(4, 4, generator=torch.Generator().manual_seed(0)))[0]
    return turn.double() @ torch.diag(STRETCH) @ turn.double().T


def linear(theta: Tensor) -> ObjectiveAndKL:
    """Return an objective that rises along the gradient, and the metric's own divergence."""
    return ObjectiveAndKL(float(GRADIENT @ theta), float(theta @ metric() @ theta) / 2 * 0.999)


def test_conjugate_gradients_solve() -> None:
    """As many products as there are dimensions solve a system exactly."""
    matrix = metric()
    found = conjugate_gradient(lambda v: matrix @ v, GRADIENT, 4)
    torch.testing.assert_close(found, torch.linalg.solve(matrix, GRADIENT))


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_it_steps_to_the_edge_of_the_trust_region(damping: float) -> None:
    """On a quadratic it is F^-1 g, as long as the limit allows."""
    matrix = metric()
    step = NaturalStep(**{**SETTINGS, "damping": damping})
    taken = step(START, GRADIENT, lambda v: matrix @ v, linear)
    damped = matrix + damping * torch.eye(4)
    direction = torch.linalg.solve(damped, GRADIENT)
    length = (2 * 0.01 / (direction @ damped @ direction)).sqrt()
    torch.testing.assert_close(taken.theta, length * direction)
    assert taken.reason == "" and taken.backtracks == 0 and 0 < taken.kl < 0.01
    assert taken.gain == pytest.approx(float(GRADIENT @ taken.theta))


def test_it_is_shortened_until_it_holds() -> None:
    """Where the divergence grows faster than its quadratic model, the length is halved."""

    def steep(theta: Tensor) -> ObjectiveAndKL:
        found = linear(theta)
        return found._replace(kl=10 * found.kl)

    matrix = metric()
    taken = NaturalStep(**SETTINGS)(START, GRADIENT, lambda v: matrix @ v, steep)
    assert taken.backtracks == 2 and 0 < taken.kl < 0.01  # 10 / 4^2 is the first below 1


NAN = float("nan")
WITHOUT = {
    "the gradient is zero": {"gradient": START},
    "the gradient is not finite": {"gradient": GRADIENT * NAN},
    "a curvature of -": {"product": lambda v: -v},
    "none of 5 lengths raises the objective": {"assess": lambda v: ObjectiveAndKL(0.0, 0.0)},
    "within a divergence of 0.01": {"assess": lambda v: ObjectiveAndKL(float(GRADIENT @ v), 1.0)},
    "lengths raises": {"assess": lambda v: ObjectiveAndKL(NAN if v.any() else 0.0, 0.0)},
}


@pytest.mark.parametrize("sentence", WITHOUT)
def test_without_a_direction_it_says_so_and_keeps_the_parameters(sentence: str, caplog) -> None:
    """No gradient, no curvature, no gain: one line says which, and nothing moves."""
    given: dict[str, Any] = {"gradient": GRADIENT, "product": lambda v: v, "assess": linear}
    given |= WITHOUT[sentence]
    with caplog.at_level(logging.WARNING):
        taken = NaturalStep(**SETTINGS)(START, **given)
    assert sentence in taken.reason and sentence in caplog.text
    assert taken.theta is START and (taken.gain, taken.kl) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("max_kl", 0.0), ("damping", -1.0), ("shrink", 1.0), ("cg_iterations", 0), ("backtracks", 0)],
)
def test_values_out_of_range_are_refused(name: str, value: float) -> None:
    """A sentence names the setting, its value and what it must be."""
    with pytest.raises(Sim2RealError, match=rf"algorithm\.step: .*{name}={value} "):
        NaturalStep(**{**SETTINGS, name: value})
