"""The likelihood against the dense Gaussian that it stands for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t

from sim2real.diagnosis.inference import likelihood as module
from sim2real.diagnosis.inference.likelihood import FOLDS, SHIFTS, Likelihood, Trained
from sim2real.diagnosis.settings.inference import Inference

SETTINGS = Inference()
W, N, M = 4, 9, 2


class Small:
    """Windows of which everything is known, and the covariance of all of them at once."""

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.times = np.sort(rng.uniform(0, 1, (W, N)), axis=1)
        self.used = np.ones((W, N), bool)
        self.used[1, 6:] = False
        self.noise = np.array([0.1, 0.3])
        self.local = 0.4 * rng.normal(size=(W, N, M, 3))
        self.common = 0.3 * rng.normal(size=(W, N, M, 2))
        self.errors = rng.normal(size=(W, N, M))
        self.likelihood = Likelihood(
            self.times, self.used, self.noise, self.local, self.common, SETTINGS
        )

    def covariance(self, trained: Trained, shifts: np.ndarray) -> np.ndarray:
        """Return that of all errors, (W N M, W N M), those not used included."""
        total = np.zeros((W, N, M, W, N, M))
        for w in range(W):
            for j in range(M):
                size = np.clip(trained.size[j] + SHIFTS[shifts[w]], 0, SETTINGS.octaves + 1)
                size = self.likelihood.sizes[size] * self.noise[j]
                tau = SETTINGS.correlations_s[trained.time[j]]
                gap = np.abs(self.times[w][:, None] - self.times[w])
                total[w, :, j, w, :, j] = size**2 * np.exp(-gap / tau)
                total[w, :, j, w, :, j] += self.noise[j] ** 2 * np.eye(N)
            total[w, :, :, w] += np.einsum("njk,mik->njmi", self.local[w], self.local[w])
        total += np.einsum("wnjk,vmik->wnjvmi", self.common, self.common)
        return total.reshape(2 * (W * N * M,))

    def dense(self, trained: Trained, shifts: np.ndarray, windows: list[int]) -> float:
        """Return the log density of some windows' errors, by the definition."""
        keep = np.zeros((W, N, M), bool)
        keep[windows] = self.used[windows][..., None]
        own = np.flatnonzero(keep)
        covariance = self.covariance(trained, shifts)[np.ix_(own, own)]
        errors = self.errors.ravel()[own]
        square = errors @ np.linalg.solve(covariance, errors)
        return -(square + np.linalg.slogdet(2 * np.pi * covariance)[1]) / 2


def test_density_of_the_trained_windows_is_the_dense_gaussians() -> None:
    """Eigenbases and eliminations change nothing of the density."""
    small = Small()
    windows = np.array([0, 1, 3])
    trained = small.likelihood.train(small.likelihood.project(small.errors), windows)
    prior = small.likelihood.log_prior[trained.shift[windows]].sum()
    dense = small.dense(trained, trained.shift, [0, 1, 3])
    assert trained.density == pytest.approx(dense + prior, abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_the_last_bit_of_an_error_chooses_no_correlation_time(seed: int) -> None:
    """Readings alone leave no discrepancy: all times are alike, and the first is taken."""
    small, windows = Small(seed), np.arange(W)
    errors = 0.1 * small.noise * small.errors
    for last in np.random.default_rng(seed).uniform(-1e-14, 1e-14, (4, *errors.shape)):
        projection = small.likelihood.project(errors * (1 + last))
        trained = small.likelihood.train(projection, windows)
        assert (trained.time.tolist(), trained.size.tolist()) == ([0, 0], [0, 0])


def test_held_out_density_is_a_quotient_of_dense_gaussians() -> None:
    """p(held out | trained on) = p(both) / p(trained on), mixed over the window's own scale."""
    small = Small(1)
    projection = small.likelihood.project(small.errors)
    trained = small.likelihood.train(projection, np.array([0, 1, 2]))
    found = small.likelihood.predict(projection, trained)[3]
    known = small.dense(trained, trained.shift, [0, 1, 2])
    terms = []
    for k, weight in enumerate(small.likelihood.log_prior):
        shifts = trained.shift.copy()
        shifts[3] = k
        terms.append(weight + small.dense(trained, shifts, [0, 1, 2, 3]) - known)
    assert found == pytest.approx(np.logaddexp.reduce(terms), abs=1e-8)


def test_curvature_is_that_of_the_dense_covariance() -> None:
    """X' V^-1 X, with starts and common errors integrated out."""
    small = Small(2)
    windows = np.array([0, 2, 3])
    trained = small.likelihood.train(small.likelihood.project(small.errors), windows)
    vectors = np.random.default_rng(3).normal(size=(W, N, M, 2))
    keep = np.zeros((W, N, M), bool)
    keep[windows] = small.used[windows][..., None]
    own = np.flatnonzero(keep)
    covariance = small.covariance(trained, trained.shift)[np.ix_(own, own)]
    flat = vectors.reshape(-1, 2)[own]
    dense = flat.T @ np.linalg.solve(covariance, flat)
    found = small.likelihood.curvature(trained, vectors, windows)
    np.testing.assert_allclose(found, dense, rtol=1e-8)
    known = small.times, small.used, small.noise, small.local, small.common
    heavy = Likelihood(*known, replace(SETTINGS, temperature=1.0))
    full = heavy.curvature(trained, vectors, windows, tempered=False)
    np.testing.assert_allclose(full, dense, rtol=1e-8)
    lighter = np.linalg.eigvalsh(heavy.curvature(trained, vectors, windows) - full)
    assert (lighter > 0).all(), "a prior that keeps its weight hides less"


def test_common_errors_are_estimated_as_by_regression() -> None:
    """The posterior of weights u with errors that are those of the windows alone, by its inverse.

    (C' K^-1 C + I)^-1 is its covariance, with K the covariance without C: the weight-space view.
    """
    small = Small(4)
    windows = np.array([0, 2, 3])
    full = replace(SETTINGS, temperature=FOLDS / (W * N))  # the prior keeps its plain weight
    known = small.times, small.used, small.noise, small.local, small.common
    likelihood = Likelihood(*known, full)
    trained = likelihood.train(likelihood.project(small.errors), windows)
    keep = np.zeros((W, N, M), bool)
    keep[windows] = small.used[windows][..., None]
    own, flat = np.flatnonzero(keep), small.common.reshape(-1, 2)
    alone = small.covariance(trained, trained.shift) - flat @ flat.T
    within = np.linalg.solve(alone[np.ix_(own, own)], np.eye(len(own)))
    covariance = np.linalg.inv(flat[own].T @ within @ flat[own] + np.eye(2))
    mean = covariance @ flat[own].T @ within @ small.errors.ravel()[own]
    found = likelihood.estimate(trained, small.errors, small.common, windows)
    np.testing.assert_allclose(found, [mean, np.diag(covariance)], rtol=1e-7)


def test_training_finds_the_size_and_time_that_errors_were_drawn_with() -> None:
    """A process of eight noises and 0.2 s at one joint, nothing at the other."""
    rng = np.random.default_rng(5)
    times = np.tile(np.linspace(0, 3, 60), (12, 1))
    noise, none = np.array([0.1, 0.1]), np.zeros((12, 60, 2, 0))
    kernel = np.exp(-np.abs(times[0][:, None] - times[0]) / 0.2)
    drawn = 0.8 * rng.multivariate_normal(np.zeros(60), kernel, 12)
    errors = 0.1 * rng.normal(size=(12, 60, 2))
    errors[..., 0] += drawn
    likelihood = Likelihood(times, np.ones((12, 60), bool), noise, none, none, SETTINGS)
    trained = likelihood.train(likelihood.project(errors), np.arange(12))
    assert SETTINGS.correlations_s[trained.time[0]] == 0.2
    assert likelihood.sizes[trained.size[0]] == pytest.approx(8.0, rel=0.5)
    assert likelihood.sizes[trained.size[1]] <= 0.5


def test_a_cap_on_the_discrepancy_holds_in_every_window() -> None:
    """Neither the size nor a window's own scale goes beyond it."""
    small = Small(4)
    projection = small.likelihood.project(10 * small.errors)
    most = np.array([1.0, 2.0])
    trained = small.likelihood.train(projection, np.arange(W), (0.0, most))
    assert (small.likelihood.sizes[trained.size] <= most).all()
    free = small.likelihood.train(projection, np.arange(W))
    assert free.density > trained.density
    held = small.likelihood.predict(projection, trained, (0.0, most))
    assert (small.likelihood.predict(projection, free) > held).all()


@pytest.mark.parametrize("begin", [False, True])
def test_a_discrepancy_of_one_size_has_it_in_every_window(begin: bool) -> None:
    """Both ends hold, from wherever the training starts: all is a Gaussian of that size."""
    small = Small(5)
    projection, size = small.likelihood.project(small.noise * small.errors), (2.0, 2.0)
    free = small.likelihood.train(projection, np.arange(W)) if begin else None
    trained = small.likelihood.train(projection, np.array([0, 1, 2]), size, free)
    assert (small.likelihood.sizes[trained.size] == 2.0).all()
    none = np.full(W, np.flatnonzero(SHIFTS == 0)[0])
    small.errors = small.noise * small.errors
    dense = [small.dense(trained, none, windows) for windows in ([0, 1, 2], [0, 1, 2, 3])]
    held = small.likelihood.predict(projection, trained, size)[3]
    assert held == pytest.approx(dense[1] - dense[0], abs=1e-8)


def test_windows_scales_have_the_students_weights() -> None:
    """Their mixture of normals is the Student distribution, up to its grid."""
    freedom = replace(SETTINGS, freedom=4.0).freedom
    weights = np.exp(module._log_shifts(freedom))
    assert weights.sum() == pytest.approx(1.0)
    for x in (0.0, 1.0, 2.0):
        mixed = (weights * np.exp(-((x / 2.0**SHIFTS) ** 2) / 2) / 2.0**SHIFTS).sum()
        mixed /= np.sqrt(2 * np.pi)
        assert mixed == pytest.approx(t.pdf(x, freedom), rel=0.15)


@pytest.mark.parametrize("most", [2.0, 4.0, np.inf])
@pytest.mark.parametrize("wild", [2, 6])
def test_windows_that_need_more_do_not_keep_the_size_of_all(wild: int, most: float) -> None:
    """Of one joint, and nothing else unknown, the best of all sizes, times and scales is found."""
    rng, count, rows = np.random.default_rng(0), 12, 40
    times = np.tile(np.linspace(0, 2, rows), (count, 1))
    covariance = np.exp(-np.abs(times[0][:, None] - times[0]) / SETTINGS.correlations_s[1])
    process = rng.normal(size=(count, rows)) @ np.linalg.cholesky(covariance).T
    sizes = np.where(np.arange(count) < wild, 8.0, 1.0)[:, None]
    errors = (sizes * process + rng.normal(size=(count, rows)))[..., None]
    none, used = np.zeros((count, rows, 1, 0)), np.ones((count, rows), bool)
    likelihood = Likelihood(times, used, np.ones(1), none, none, SETTINGS)
    projection, every = likelihood.project(errors), np.arange(count)
    found = likelihood.train(projection, every, (0.0, most))
    last = int(likelihood._find_ends((0.0, most))[1, 0])
    own = np.clip(np.arange(last + 1)[:, None] + SHIFTS, 0, last)  # (S, K)
    each = likelihood.log_prior[:, None] - projection.square[:, own, 0] / 2  # (T, S, K, W)
    assert found.density == pytest.approx(each.max(axis=2).sum(axis=-1).max())


def test_usual_errors_pay_by_their_prior_what_the_evidence_weighs() -> None:
    """Twelve deviations of one direction in a log whose readings are worth hundreds of nats.

    The held-out density takes them for nothing; at the temperature they cost u^2 / 2 of evidence.
    """
    rng = np.random.default_rng(7)
    count, rows = 20, 50
    times = np.tile(np.linspace(0, 2, rows), (count, 1))
    way = 0.5 * rng.normal(size=(count, rows, 1, 1))
    noise, none = np.array([0.01]), np.zeros((count, rows, 1, 0))
    errors = 12.0 * way[..., 0] + 0.01 * rng.normal(size=(count, rows, 1))
    used = np.ones((count, rows), bool)
    likelihood = Likelihood(times, used, noise, none, way, SETTINGS)
    trained = likelihood.train(likelihood.project(errors), np.arange(0, count, 2))
    charge = likelihood.charge(trained)
    evidence = SETTINGS.temperature * count * rows / 2
    assert evidence > 1
    assert charge.sum() / 2 == pytest.approx(evidence * 12.0**2 / 2, rel=0.01)
    assert np.ptp(charge) == 0.0  # windows of as many rows pay alike


@pytest.mark.parametrize(("deviations", "usual"), [(2.4, True), (2.5, False)])
def test_common_errors_are_usual_within_their_prior(deviations: float, usual: bool) -> None:
    """Of two directions all but 5 % lie within sqrt(-2 ln 0.05) = 2.45 standard deviations."""
    likelihood = Small().likelihood
    trained = likelihood.train(likelihood.project(Small().errors), np.arange(W))
    evidence = max(SETTINGS.temperature * likelihood.used.sum() / 2, 1.0)
    mean = deviations * np.sqrt(evidence) * np.array([0.6, 0.8])
    known = trained._replace(mean=mean, precision=1e9 * np.eye(2))
    assert likelihood.is_usual(known) is usual


def test_what_readings_do_not_tell_of_common_errors_allows_no_more_of_the_others() -> None:
    """Of errors drawn from their prior one in twenty is unusual, though few directions are seen."""
    rng = np.random.default_rng(3)
    likelihood = Small().likelihood
    trained = likelihood.train(likelihood.project(Small().errors), np.arange(W))
    evidence = max(SETTINGS.temperature * likelihood.used.sum() / 2, 1.0)
    precision = np.diag(1.0 + np.array([1e6, 50.0, 2.0, *[1e-3] * 9]))
    shrinks = 1 - 1 / np.diag(precision)
    draws = np.sqrt(evidence) * shrinks * rng.normal(size=(4000, len(shrinks)))
    made = (trained._replace(mean=mean, precision=precision) for mean in draws)
    share = np.mean([likelihood.is_usual(one) for one in made])
    assert share == pytest.approx(1 - SETTINGS.level, abs=0.01)
