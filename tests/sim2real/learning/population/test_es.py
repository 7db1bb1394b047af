"""Evolution strategies: the gradient is that of the smoothed fitness; states resume exactly."""

import io

import numpy as np
import pytest
import torch

from sim2real.learning.population.es import (
    EvolutionStrategy,
    StrategySettings,
    orthogonal_directions,
    shape_fitness,
)

CURVATURE = np.diag([1.0, 2.0, 3.0, 0.5])
START = np.array([1.0, -1.0, 0.5, 2.0])


def make(**changes) -> EvolutionStrategy:
    """Strategy on the quadratic."""
    options = {
        "pairs": 8, "sigma": 0.1, "learning_rate": 1.0, "optimizer": "sgd",
        "estimator": "antithetic", "shaping": "none",
    }  # fmt: skip
    return EvolutionStrategy(
        START, np.random.default_rng(0), StrategySettings(**(options | changes))
    )


def quadratic(thetas: np.ndarray) -> np.ndarray:
    """Fitness with its top at 0."""
    return -0.5 * np.einsum("jp,pq,jq->j", thetas, CURVATURE, thetas)


@pytest.mark.parametrize("estimator", ["antithetic", "forward_fd"])
@pytest.mark.parametrize("orthogonal", [False, True])
def test_gradient_of_a_quadratic(estimator: str, orthogonal: bool) -> None:
    """With SGD of rate 1 a step is the gradient; for a quadratic that is the plain one, -A m."""
    strategy = make(pairs=8_000, estimator=estimator, orthogonal=orthogonal)
    strategy.tell(quadratic(strategy.ask()))
    np.testing.assert_allclose(strategy.mean - START, -CURVATURE @ START, atol=0.2)


def test_gradient_equals_finite_differences_of_the_smoothed_fitness() -> None:
    """For a sine the step matches finite differences of its Gaussian average."""
    sigma = 0.5
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)

    def smoothed(x: float) -> float:
        return float(np.sum(weights * np.sin(3 * (x + sigma * nodes))) / weights.sum())

    expected = (smoothed(0.3 + 1e-5) - smoothed(0.3 - 1e-5)) / 2e-5
    strategy = EvolutionStrategy(
        np.array([0.3]),
        np.random.default_rng(1),
        StrategySettings(
            pairs=200_000,
            sigma=sigma,
            learning_rate=1.0,
            optimizer="sgd",
            estimator="antithetic",
            shaping="none",
        ),
    )
    strategy.tell(np.sin(3 * strategy.ask()[:, 0]))
    assert strategy.mean[0] - 0.3 == pytest.approx(expected, abs=0.01)


def test_antithetic_pairs_mirror_each_other() -> None:
    """The second half of the candidates is the first half mirrored at the mean."""
    thetas = make().ask()
    np.testing.assert_allclose(thetas[:8] + thetas[8:], np.tile(2 * START, (8, 1)))


@pytest.mark.parametrize("optimizer", ["sgd", "adam"])
@pytest.mark.parametrize("shaping", ["centred_ranks", "standardized"])
def test_climbs_to_the_optimum(optimizer: str, shaping: str) -> None:
    """Every combination of optimizer and shaping finds the maximum at 0."""
    strategy = make(optimizer=optimizer, shaping=shaping, learning_rate=0.03, pairs=16, top_k=8)
    for _ in range(300):
        strategy.tell(quadratic(strategy.ask()))
    assert np.abs(strategy.mean).max() < 0.4


def test_shaping_ignores_scale_and_equal_values_move_nothing() -> None:
    """Shaping does not see scale; ties share a rank; constant fitness makes no step."""
    fitness = np.array([3.0, 1.0, 2.0, 2.0, 10.0])
    np.testing.assert_allclose(
        shape_fitness(fitness, "centred_ranks"), [0.25, -0.5, -0.125, -0.125, 0.5]
    )
    for shaping in ("centred_ranks", "standardized"):
        np.testing.assert_allclose(
            shape_fitness(fitness, shaping), shape_fitness(1e3 * fitness - 7, shaping)
        )
        strategy = make(shaping=shaping, optimizer="adam")
        strategy.ask()
        strategy.tell(np.full(16, 5.0))
        np.testing.assert_array_equal(strategy.mean, START)


def test_top_k_keeps_the_directions_that_matter() -> None:
    """With top_k = 1 the step lies along the direction of the largest difference."""
    strategy = make(top_k=1)
    thetas = strategy.ask()
    fitness = np.zeros(16)
    fitness[3], fitness[5] = 10.0, 1.0
    strategy.tell(fitness)
    step, direction = strategy.mean - START, thetas[3] - START
    assert step @ direction == pytest.approx(np.linalg.norm(step) * np.linalg.norm(direction))


def test_orthogonal_directions_have_gaussian_lengths() -> None:
    """Directions of a block are orthogonal; squared lengths are chi-square in mean and variance."""
    directions = orthogonal_directions(np.random.default_rng(2), 4000, 10)
    block = directions[:10] @ directions[:10].T
    np.testing.assert_allclose(block - np.diag(np.diag(block)), 0, atol=1e-10)
    squared = (directions**2).sum(axis=1)
    assert squared.mean() == pytest.approx(10, rel=0.05)
    assert squared.var() == pytest.approx(20, rel=0.15)


@pytest.mark.parametrize("between", [False, True])
def test_state_resumes_bit_for_bit(between: bool) -> None:
    """A state saved to bytes goes on with the same numbers elsewhere, also between ask and tell."""
    one = make(optimizer="adam", learning_rate=0.1)
    for _ in range(3):
        one.tell(quadratic(one.ask()))
    thetas = one.ask() if between else None
    buffer = io.BytesIO()
    torch.save(one.state_dict(), buffer)
    buffer.seek(0)
    other = make(optimizer="adam", learning_rate=0.1)
    other.load_state_dict(torch.load(buffer, weights_only=True))
    for strategy in (one, other):
        if thetas is not None:
            strategy.tell(quadratic(thetas))
        for _ in range(3):
            strategy.tell(quadratic(strategy.ask()))
    np.testing.assert_array_equal(one.mean, other.mean)


def test_bad_input_is_refused() -> None:
    """Values out of range and fitness that is not finite are errors that name the value."""
    with pytest.raises(ValueError, match="sigma=-1"):
        make(sigma=-1)
    with pytest.raises(ValueError, match="top_k=9"):
        make(top_k=9)
    strategy = make()
    with pytest.raises(ValueError, match="before ask"):
        strategy.tell(np.zeros(16))
    strategy.ask()
    with pytest.raises(ValueError, match="1 not finite"):
        strategy.tell(np.r_[np.nan, np.zeros(15)])


def test_directions_that_do_not_fit_into_memory_are_refused() -> None:
    """The number that was given, what it needs and what is free."""
    words = r"algorithm.pairs=10000000000000 .* need about .* of memory, but .* free; .*fewer pairs"
    with pytest.raises(ValueError, match=words):
        EvolutionStrategy(
            START,
            np.random.default_rng(0),
            StrategySettings(
                pairs=10**13,
                sigma=0.1,
                learning_rate=0.1,
                optimizer="sgd",
                estimator="antithetic",
                shaping="none",
            ),
        )
