"""Around a point: which directions the logs know, and what each episode alone says.

    around = Surroundings(provider, prior)
    local = around.explore(best)
    local.known, local.flat        # directions (P, K), and those in which nothing is known
    shifts, covariances, left = around.fit_per_episode(local)

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

    def along(self, change: np.ndarray) -> np.ndarray:
        """Return changes along the known directions, (K, W, T, M), of those with parameters."""
        return np.tensordot((self.known * self.scale[:, None]).T, change, axes=1)

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


class MAPEstimate(NamedTuple):
    """The most likely values, and how sure they are."""

    point: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)


class Surroundings:
    """What an aligned provider's data say around points of a prior.

    The prior gives the mean, the widths and the ends.
    """

    def __init__(
        self, provider: AlignedProvider, prior: Distribution, settings: Settings = DEFAULT
    ) -> None:
        self._provider, self._prior, self._settings = provider, prior, settings
        motion = np.nanstd(provider.real, axis=(0, 1))
        # the least mean square error that counts: noise, and what simulations resolve, (M,)
        self._floor = np.maximum(
            provider.floor**2 + (settings.resolution * motion) ** 2, TINY_SQUARE
        )

    def explore(self, point: np.ndarray) -> LocalSensitivity:
        """Find which directions the logs know at a point (P,) within the prior."""
        scale = self._prior.std
        error = self._provider.errors(point[None])[0]  # (W, T, M)
        change = self._sensitivities(self._all(point))
        # each reading over its noise, and so often as it says something new
        weight = 1 / np.sqrt(self._noise(error) * autocorrelation_time(error))
        flat = _readings(change * weight) * scale[:, None]
        information, vectors = np.linalg.eigh(flat @ flat.T)
        narrowed = 1 - 1 / np.sqrt(1 + np.maximum(information, 0.0))
        sure = narrowed >= self._settings.known
        return LocalSensitivity(point, scale, vectors[:, sure], vectors[:, ~sure], narrowed[~sure])

    def fit_per_episode(self, local: LocalSensitivity) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fit each episode by itself, along the known directions, from the common point.

        Returns:
            Shifts (E, K), their covariances (E, K, K) and the errors that are left, (W, T, M).
        """
        provider = self._provider
        count, size = provider.episodes, local.known.shape[1]
        shifts = np.zeros((count, size))
        error = provider.errors(local.point[None])[0]
        for _ in range(self._settings.rounds if size else 0):
            change = local.along(self._sensitivities(self._inside(local.values(shifts))))
            steps = self._steps(change, error)  # (D, E, K)
            trials = provider.errors(self._inside(local.values(shifts + steps)))  # (D, W, T, M)
            costs = np.array([self._costs(one) for one in [error, *trials]])  # (1 + D, E)
            pick = costs.argmin(axis=0)  # (E,) 0: stay
            shifts = np.concatenate([shifts[None], shifts + steps])[pick, np.arange(count)]
            every = np.concatenate([error[None], trials])
            error = every[pick[provider.episode], np.arange(len(error))]
            if not pick.any():
                break
        change = local.along(self._sensitivities(self._inside(local.values(shifts))))
        return shifts, self._covariances(change, error), error

    def maximum_a_posteriori(self) -> MAPEstimate:
        """Go from the prior's mean to the values that the logs and the prior make most likely.

        Damped Gauss-Newton steps, `rounds` at most, on all episodes together. Each reading counts
        over its noise, which is what is left of the gap so far. A part of what is left may act like
        any parameter: it is the same in all readings, so that the prior counts for more against
        them the more of it there is. While values are looked for, most of what is left is that of
        wrong values; so it is a smaller part then (`hold`) than for how sure they are in the end
        (`model_discrepancy`).
        """
        provider, prior, settings = self._provider, self._prior, self._settings
        scale = prior.std
        shift = np.zeros(len(scale))  # in deviations of the prior

        def at(moves: np.ndarray) -> np.ndarray:  # (..., P)
            return self._inside(prior.mean + moves * scale)

        error = provider.errors(at(shift)[None])[0]
        for turn in range(settings.rounds + 1):
            change = self._sensitivities(self._all(at(shift)))
            noise = self._noise(error)  # (M,)
            flat = _readings(change / np.sqrt(noise)) * scale[:, None]
            information = flat @ flat.T
            if turn == settings.rounds:
                break
            weight = self._weight(error, noise, settings.hold)
            curve = information + weight * np.eye(len(scale))
            down = flat @ _filled(error / np.sqrt(noise)).ravel() + weight * shift
            steps = [
                self._step(curve + damping * np.diag(np.diag(curve)), down)
                for damping in settings.dampings
            ]
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
        weight = self._weight(error, noise, settings.doubt)
        sure = weight * np.linalg.inv(information + weight * np.eye(len(scale)))
        return MAPEstimate(at(shift), scale[:, None] * sure * scale)

    def model_discrepancy(
        self, local: LocalSensitivity, left: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much what is left of the gap may have shifted all episodes alike.

        What is left beyond noise, and lasts from one row to the next, is something that no
        parameter says. It is the same in every episode, so that more of them make it no smaller;
        `doubt` of it may act like a change along any direction.

        Args:
            local: the point and its directions.
            left: errors that are left when every episode is fitted, (W, T, M).

        Returns:
            A covariance along the directions (K, K), and the rest of what is left that such shifts
            do not make, each reading's root mean square (M,).
        """
        change = local.along(self._sensitivities(self._all(local.point)))
        noise, square = self._noise(left), _square(left)  # (M,)
        flat = _readings(change / np.sqrt(noise))
        count = int(np.isfinite(left).sum())
        inverse = np.linalg.inv(flat @ flat.T / count + np.eye(len(change)))
        shared = self._settings.doubt**2 * self._beyond(left, noise) * inverse
        made = np.nansum(change * np.tensordot(shared, change, axes=1), axis=0)  # (W, T, M)
        made = np.where(np.isnan(left), np.nan, made)
        least = np.minimum(self._floor, square)
        return shared, np.sqrt(np.maximum(square - np.nanmean(made, axis=(0, 1)), least))

    def _all(self, point: np.ndarray) -> np.ndarray:
        """Return the same values (P,) for every episode, (E, P)."""
        return point[None].repeat(self._provider.episodes, 0)

    def _inside(self, values: np.ndarray) -> np.ndarray:
        return np.clip(values, self._prior.low, self._prior.high)

    def _noise(self, error: np.ndarray) -> np.ndarray:
        """Return the mean square that each reading's errors count by, (M,)."""
        return np.maximum(_square(error), self._floor)

    def _sensitivities(self, values: np.ndarray) -> np.ndarray:
        """Return how errors change with parameters, (P, W, T, M), at values (E, P) of episodes."""
        prior, size = self._prior, values.shape[1]
        steps = self._settings.difference * (prior.high - prior.low)  # (P,)
        up = np.minimum(values[None] + np.diag(steps)[:, None], prior.high)  # (P, E, P)
        down = np.maximum(values[None] - np.diag(steps)[:, None], prior.low)
        moved = self._provider.errors(np.concatenate([up, down]))
        every = np.arange(size)
        length = (up - down)[every, :, every][:, self._provider.episode]  # (P, W)
        return (moved[:size] - moved[size:]) / np.maximum(length, TINY)[:, :, None, None]

    def _weight(self, error: np.ndarray, noise: np.ndarray, part: float) -> float:
        """Return how many readings the prior counts as, 1 where all that is left is noise."""
        return 1 + part**2 * self._beyond(error, noise) * int(np.isfinite(error).sum())

    def _beyond(self, error: np.ndarray, noise: np.ndarray) -> float:
        """Return the largest share of a reading's errors that is beyond noise, and lasts."""
        beyond = np.minimum(1 - self._floor / noise, _lasting(error))
        return float(np.clip(beyond, 0.0, 1.0).max())

    def _step(self, matrix: np.ndarray, down: np.ndarray) -> np.ndarray:
        step = -np.linalg.solve(matrix, down)
        return step * min(1.0, self._settings.longest_step / max(np.linalg.norm(step), TINY))

    def _costs(self, error: np.ndarray) -> np.ndarray:
        """Return the sum of squares of each episode, (E,)."""
        each = np.nansum(error**2, axis=(1, 2))
        return np.bincount(self._provider.episode, each, self._provider.episodes)

    def _steps(self, change: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return a step for each damping and episode, (D, E, K)."""
        size, dampings = len(change), self._settings.dampings
        steps = np.zeros((len(dampings), self._provider.episodes, size))
        noise = self._noise(error)
        for e in range(self._provider.episodes):
            own = self._provider.episode == e
            flat = _readings(change[:, own] / np.sqrt(noise))
            curve, down = flat @ flat.T, flat @ _filled(error[own] / np.sqrt(noise)).ravel()
            for d, damping in enumerate(dampings):
                matrix = curve + damping * np.diag(np.diag(curve)) + np.eye(size)
                steps[d, e] = self._step(matrix, down)
        return steps

    def _covariances(self, change: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return how well each episode knows its shifts, (E, K, K)."""
        size, lags = len(change), int(np.ceil(autocorrelation_time(error).max()))
        found = np.empty((self._provider.episodes, size, size))
        for e in range(self._provider.episodes):
            own = self._provider.episode == e
            part, left = change[:, own], error[own]
            noise = self._noise(left)  # (M,)
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


def _filled(values: np.ndarray) -> np.ndarray:
    return np.nan_to_num(values, nan=0.0)


def _readings(change: np.ndarray) -> np.ndarray:
    """Return changes (K, W, T, M) as (K, n), a column a reading; K may be 0."""
    return _filled(change).reshape(len(change), int(np.prod(change.shape[1:])))
