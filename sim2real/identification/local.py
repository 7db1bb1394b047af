"""Around a point: which directions the logs know, and what each episode alone says.

    local = explore(provider, prior, best)
    local.known, local.flat        # directions (K, P), and those in which nothing is known
    estimates, covariances = local.episodes()

Directions are the eigenvectors of the information that the logs have on the parameters, measured in
deviations of the prior: along one of them an estimate is narrowed to 1/sqrt(1 + information) of the
prior's width. Errors of neighbouring rows hang together; their products with the sensitivities are
therefore summed over lags (Newey and West, Econometrica 55, 1987).
"""

from typing import NamedTuple

import numpy as np

from envs.distribution import Distribution, UnidentifiedDirection
from sim2real.diagnosis.settings import TINY, TINY_SQUARE
from sim2real.identification.providers.base import AlignedProvider
from sim2real.identification.settings import DEFAULT, Settings


class LocalSensitivity(NamedTuple):
    """The logs' sensitivity around a point."""

    point: np.ndarray  # (P,)
    scale: np.ndarray  # (P,) deviations of the prior
    known: np.ndarray  # (P, K) directions, orthonormal, in these deviations
    flat: np.ndarray  # (P, F) the others
    narrowed: np.ndarray  # (F,) by how much the estimate is narrower there than the prior, 0 to 1

    def values(self, shifts: np.ndarray) -> np.ndarray:
        """Return points (..., P) that lie at shifts (..., K) along the known directions."""
        return self.point + shifts @ self.known.T * self.scale

    def named(
        self, names: tuple[str, ...], settings: Settings = DEFAULT
    ) -> tuple[UnidentifiedDirection, ...]:
        """Return the flat directions by the names of what is in them."""
        found = []
        for direction, narrowed in zip(self.flat.T, self.narrowed, strict=True):
            order = np.argsort(-np.abs(direction), kind="stable")
            sign = np.sign(direction[order[0]])
            weights = {
                names[i]: float(sign * direction[i])
                for i in order
                if abs(direction[i]) >= settings.weight
            }
            found.append(UnidentifiedDirection(weights, float(narrowed)))
        return tuple(found)


def analyze_sensitivity(
    provider: AlignedProvider, prior: Distribution, point: np.ndarray, settings: Settings = DEFAULT
) -> LocalSensitivity:
    """Find which directions the logs know at a point.

    Args:
        provider: what simulates.
        prior: gives the widths.
        point: (P,), within the prior.
        settings: see `Settings`.
    """
    scale = prior.std
    error = provider.errors(point[None])[0]  # (W, T, M)
    change = sensitivities(provider, prior, point[None].repeat(provider.episodes, 0), settings)
    noise = np.maximum(_square(error), _floor(provider, settings))  # (M,)
    # each reading over its noise, and so often as it says something new
    weight = 1 / np.sqrt(noise * autocorrelation_time(error))
    flat = _readings(change * weight) * scale[:, None]
    information, vectors = np.linalg.eigh(flat @ flat.T)
    narrowed = 1 - 1 / np.sqrt(1 + np.maximum(information, 0.0))
    sure = narrowed >= settings.known
    return LocalSensitivity(point, scale, vectors[:, sure], vectors[:, ~sure], narrowed[~sure])


def sensitivities(
    provider: AlignedProvider, prior: Distribution, values: np.ndarray, settings: Settings = DEFAULT
) -> np.ndarray:
    """Return how errors change with each parameter, (P, W, T, M), at values (E, P) of episodes."""
    width = prior.high - prior.low
    size = values.shape[1]
    steps = settings.difference * width  # (P,)
    up = np.minimum(values[None] + np.diag(steps)[:, None], prior.high)  # (P, E, P)
    down = np.maximum(values[None] - np.diag(steps)[:, None], prior.low)
    moved = provider.errors(np.concatenate([up, down]))
    every = np.arange(size)
    length = (up - down)[every, :, every][:, provider.episode]  # (P, W)
    return (moved[:size] - moved[size:]) / np.maximum(length, TINY)[:, :, None, None]


def fit_per_episode(
    provider: AlignedProvider,
    prior: Distribution,
    local: LocalSensitivity,
    settings: Settings = DEFAULT,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit each episode by itself, along the known directions, from the common point.

    Returns:
        Shifts (E, K), their covariances (E, K, K) and the errors that are left, (W, T, M).
    """
    count, size = provider.episodes, local.known.shape[1]
    shifts = np.zeros((count, size))
    error = provider.errors(local.point[None])[0]
    for _ in range(settings.rounds if size else 0):
        values = _inside(local.values(shifts), prior)
        change = _along(sensitivities(provider, prior, values, settings), local)
        steps = _steps(provider, local, change, error, settings)  # (D, E, K)
        trials = provider.errors(_inside(local.values(shifts + steps), prior))  # (D, W, T, M)
        costs = np.array([_costs(provider, one) for one in [error, *trials]])  # (1 + D, E)
        pick = costs.argmin(axis=0)  # (E,) 0: stay
        shifts = np.concatenate([shifts[None], shifts + steps])[pick, np.arange(count)]
        every = np.concatenate([error[None], trials])
        error = every[pick[provider.episode], np.arange(len(error))]
        if not pick.any():
            break
    values = _inside(local.values(shifts), prior)
    change = _along(sensitivities(provider, prior, values, settings), local)
    return shifts, _covariances(provider, change, error, settings), error


class MAPEstimate(NamedTuple):
    """The most likely values, and how sure they are."""

    point: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)


def maximum_a_posteriori(
    provider: AlignedProvider, prior: Distribution, settings: Settings = DEFAULT
) -> MAPEstimate:
    """Go from the prior's mean to the values that the logs and the prior make most likely.

    Damped Gauss-Newton steps. Each reading counts over its noise, which is what is left of the gap
    so far. A part of what is left may act like any parameter: it is the same in all readings, so
    that the prior counts for more against them the more of it there is. While values are looked
    for, most of what is left is that of wrong values; so it is a smaller part then (`hold`) than
    for how sure they are in the end (`model_discrepancy`).

    Args:
        provider: what simulates; all episodes together.
        prior: gives the mean, the widths and the ends.
        settings: see `Settings`; `rounds` steps at most.
    """
    scale, every = prior.std, np.arange(provider.episodes)
    shift = np.zeros(len(scale))  # in deviations of the prior

    def at(moves: np.ndarray) -> np.ndarray:  # (..., P)
        return _inside(prior.mean + moves * scale, prior)

    error = provider.errors(at(shift)[None])[0]
    for turn in range(settings.rounds + 1):
        change = sensitivities(provider, prior, at(shift)[None].repeat(len(every), 0), settings)
        noise = np.maximum(_square(error), _floor(provider, settings))  # (M,)
        flat = _readings(change / np.sqrt(noise)) * scale[:, None]
        information = flat @ flat.T
        if turn == settings.rounds:
            break
        weight = _weight(provider, error, noise, settings.hold, settings)
        curve = information + weight * np.eye(len(scale))
        down = flat @ _filled(error / np.sqrt(noise)).ravel() + weight * shift
        steps = [_step(curve, down, damping, settings) for damping in settings.dampings]
        trials = (at(shift + np.array(steps)) - prior.mean) / scale
        errors = provider.errors(at(trials))
        costs = [
            np.nansum(one**2 / noise) + weight * (move**2).sum()
            for one, move in zip([error, *errors], [shift, *trials], strict=True)
        ]
        best = int(np.argmin(costs))
        if best == 0:
            break
        shift, error = trials[best - 1], errors[best - 1]
    weight = _weight(provider, error, noise, settings.doubt, settings)
    sure = weight * np.linalg.inv(information + weight * np.eye(len(scale)))
    return MAPEstimate(at(shift), scale[:, None] * sure * scale)


def _weight(
    provider: AlignedProvider, error: np.ndarray, noise: np.ndarray, part: float, settings: Settings
) -> float:
    """Return how many readings the prior counts as, 1 where all that is left is noise."""
    beyond = np.minimum(1 - _floor(provider, settings) / noise, _lasting(error))
    share = float(np.clip(beyond, 0.0, 1.0).max())
    return 1 + part**2 * share * int(np.isfinite(error).sum())


def _step(curve: np.ndarray, down: np.ndarray, damping: float, settings: Settings) -> np.ndarray:
    step = -np.linalg.solve(curve + damping * np.diag(np.diag(curve)), down)
    return step * min(1.0, settings.longest_step / max(np.linalg.norm(step), TINY))


def _inside(values: np.ndarray, prior: Distribution) -> np.ndarray:
    return np.clip(values, prior.low, prior.high)


def _along(change: np.ndarray, local: LocalSensitivity) -> np.ndarray:
    """Return changes along the known directions, (K, W, T, M), of those with parameters."""
    return np.tensordot((local.known * local.scale[:, None]).T, change, axes=1)


def _costs(provider: AlignedProvider, error: np.ndarray) -> np.ndarray:
    """Return the sum of squares of each episode, (E,)."""
    each = np.nansum(error**2, axis=(1, 2))
    return np.bincount(provider.episode, each, provider.episodes)


def _steps(
    provider: AlignedProvider,
    local: LocalSensitivity,
    change: np.ndarray,
    error: np.ndarray,
    settings: Settings,
) -> np.ndarray:
    """Return a step for each damping and episode, (D, E, K)."""
    size = len(change)
    steps = np.zeros((len(settings.dampings), provider.episodes, size))
    noise = np.maximum(_square(error), _floor(provider, settings))
    for e in range(provider.episodes):
        own = provider.episode == e
        flat = _readings(change[:, own] / np.sqrt(noise))
        curve, down = flat @ flat.T, flat @ _filled(error[own] / np.sqrt(noise)).ravel()
        for d, damping in enumerate(settings.dampings):
            matrix = curve + damping * np.diag(np.diag(curve)) + np.eye(size)
            step = -np.linalg.solve(matrix, down)
            longest = np.linalg.norm(step)
            steps[d, e] = step * min(1.0, settings.longest_step / max(longest, TINY))
    return steps


def _covariances(
    provider: AlignedProvider, change: np.ndarray, error: np.ndarray, settings: Settings
) -> np.ndarray:
    """Return how well each episode knows its shifts, (E, K, K)."""
    size, lags = len(change), int(np.ceil(autocorrelation_time(error).max()))
    floor = _floor(provider, settings)
    found = np.empty((provider.episodes, size, size))
    for e in range(provider.episodes):
        own = provider.episode == e
        part, left = change[:, own], error[own]
        noise = np.maximum(_square(left), floor)  # (M,)
        flat = _readings(part / np.sqrt(noise))
        inverse = np.linalg.inv(flat @ flat.T + np.eye(size))  # the prior counts as a reading
        pull = _filled(part * left / noise).sum(axis=-1)  # (K, W, T)
        lift = noise / np.maximum(_square(left), TINY_SQUARE)  # what the floor adds
        meat = _newey_west(pull, lags) * float(lift.max()) + np.eye(size)
        freedom = np.isfinite(left).sum() / max(np.isfinite(left).sum() - size, 1)
        found[e] = freedom * inverse @ meat @ inverse
    return found


def _newey_west(pull: np.ndarray, lags: int) -> np.ndarray:
    """Return the covariance of the sum of a series (K, W, T), neighbours hanging together."""
    meat = np.einsum("kwt,lwt->kl", pull, pull)
    for lag in range(1, min(lags, pull.shape[2] - 1) + 1):
        cross = np.einsum("kwt,lwt->kl", pull[:, :, lag:], pull[:, :, :-lag])
        meat += (1 - lag / (lags + 1)) * (cross + cross.T)
    return meat


def model_discrepancy(
    provider: AlignedProvider,
    prior: Distribution,
    local: LocalSensitivity,
    left: np.ndarray,
    settings: Settings,
) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much what is left of the gap may have shifted all episodes alike.

    What is left beyond noise, and lasts from one row to the next, is something that no parameter
    says. It is the same in every episode, so that more of them make it no smaller;
    `model_discrepancy` of it may act like a change along any direction.

    Args:
        provider: what simulates.
        prior: gives the widths.
        local: the point and its directions.
        left: errors that are left when every episode is fitted, (W, T, M).
        settings: `model_discrepancy` is used.

    Returns:
        A covariance along the directions (K, K), and the rest of what is left that such shifts do
        not make, each reading's root mean square (M,).
    """
    values = local.point[None].repeat(provider.episodes, 0)
    change = _along(sensitivities(provider, prior, values, settings), local)
    floor = _floor(provider, settings)
    noise = np.maximum(_square(left), floor)  # (M,)
    flat = _readings(change / np.sqrt(noise))
    beyond = float(np.clip(np.minimum(1 - floor / noise, _lasting(left)), 0.0, 1.0).max())
    count = int(np.isfinite(left).sum())
    inverse = np.linalg.inv(flat @ flat.T / count + np.eye(len(change)))
    shared = settings.doubt**2 * beyond * inverse
    made = np.nansum(change * np.tensordot(shared, change, axes=1), axis=0)  # (W, T, M)
    made = np.where(np.isnan(left), np.nan, made)
    rest = np.maximum(
        _square(left) - np.nanmean(made, axis=(0, 1)), np.minimum(floor, _square(left))
    )
    return shared, np.sqrt(rest)


def autocorrelation_time(error: np.ndarray) -> np.ndarray:
    """Return the autocorrelation time of errors (W, T, M) in rows, (M,); 1: uncorrelated.

    Their integrated autocorrelation time, up to the first lag that is not positive (Sokal 1997).
    """
    rest = _filled(error - np.nanmean(error, axis=(0, 1)))
    square = np.maximum((rest**2).sum(axis=(0, 1)), TINY_SQUARE)  # (M,)
    found, going = np.ones(error.shape[2]), np.ones(error.shape[2], bool)
    for lag in range(1, error.shape[1]):
        share = (rest[:, lag:] * rest[:, :-lag]).sum(axis=(0, 1)) / square
        going &= share > 0
        if not going.any():
            break
        found += np.where(going, 2 * share, 0.0)
    return found


def _lasting(error: np.ndarray) -> np.ndarray:
    """Return the correlation of errors (W, T, M) with those of the row before, (M,); of one row 1.

    Noise of a reading has none.
    """
    if error.shape[1] == 1:
        return np.ones(error.shape[2])
    rest = _filled(error)
    both = (rest[:, 1:] * rest[:, :-1]).sum(axis=(0, 1))
    return both / np.maximum((rest**2).sum(axis=(0, 1)), TINY_SQUARE)


def _square(error: np.ndarray) -> np.ndarray:
    """Return each reading's mean square, (M,)."""
    return np.nanmean(error**2, axis=(0, 1))


def _floor(provider: AlignedProvider, settings: Settings) -> np.ndarray:
    """Return the least mean square error that counts, (M,): noise, and what simulations resolve."""
    motion = np.nanstd(provider.real, axis=(0, 1))
    return np.maximum(provider.floor**2 + (settings.resolution * motion) ** 2, TINY_SQUARE)


def _filled(values: np.ndarray) -> np.ndarray:
    return np.nan_to_num(values, nan=0.0)


def _readings(change: np.ndarray) -> np.ndarray:
    """Return changes (K, W, T, M) as (K, n), a column a reading; K may be 0."""
    return _filled(change).reshape(len(change), int(np.prod(change.shape[1:])))
