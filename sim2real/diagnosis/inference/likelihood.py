"""The likelihood of replayed windows: a Gaussian whose covariance says what no model knows.

    likelihood = Likelihood(times, used, noise, local, common, settings)
    projection = likelihood.project(errors)                     # errors (W, N, M)
    trained = likelihood.train(projection, windows)             # the discrepancy's size
    likelihood.predict(projection, trained)                     # (W,) nats

Errors e of window w, simulated minus measured at N rows of M joints, are

    e_w = L_w a_w + C_w u + d_w + n_w,    a_w, u ~ N(0, I)

* n: the noise of readings, white, with its standard deviation for each joint;
* L_w: one standard deviation of what is unknown of this window alone: its start, its clock;
* C_w: one standard deviation of each error of the nominal model, the same u in all windows.
  Readings are no independent evidence, `temperature` nats of them are one: so that u keeps its
  weight against them, its prior is raised to the power of what that makes of a half's readings
  (a tempered posterior, Gruenwald and van Ommen 2017, doi:10.1214/17-BA1085);
* d: the discrepancy of Kennedy and O'Hagan (2001, doi:10.1111/1467-9868.00294), for each joint j
  an Ornstein-Uhlenbeck process, (s_j m_w sigma_j)^2 exp(-|t - t'| / tau_j) (Rasmussen and
  Williams 2006, eq. 4.9). Size s and correlation time tau are estimated on a grid; m is a window's
  own scale, so that d has a Student distribution (Lange et al. 1989): where contact or sticking
  makes errors jump, a window counts less.

With exp(-|t - t'| / tau) = Q diag(lambda) Q' the noise and the discrepancy of any size are diagonal
in Q: one eigendecomposition serves a window and a correlation time. L and C, of low rank, are
integrated out by the matrix inversion lemma, L within each window and C over all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import accumulate, product
from typing import Any, NamedTuple

import numpy as np
from scipy.special import gammaincc
from scipy.stats import chi2

from sim2real.diagnosis.inference.products import (
    HALF,
    Products,
    add,
    compute_pull,
    condense,
    eliminate,
    integrate,
    predict_each,
)
from sim2real.diagnosis.settings.inference import Inference

FOLDS = 2  # halves of the windows: one is trained on, the other predicted
NEAR = sorted(product((-1, 0, 1), repeat=2), key=any)  # steps of time and size
SHIFTS = np.arange(-1, 5)  # doublings of a window's own discrepancy
STEPS = np.arange(-1, 2)  # of a window's own shift, while sizes change
ANY = 0.0, np.inf  # sizes of a discrepancy
DECIMALS = 6  # of nats: what differs by less is as good, and the first is taken, not the rounding's


class Basis(NamedTuple):
    """Eigenvectors Q and eigenvalues of the correlations of W windows' rows, for T times."""

    spread: np.ndarray  # (T, W, N)
    vectors: np.ndarray  # (T, W, N, N)

    def part(self, windows: np.ndarray) -> Basis:
        """Return that of some windows, (n,)."""
        return Basis(self.spread[:, windows], self.vectors[:, windows])


def decompose(times: np.ndarray, used: np.ndarray, correlations: Sequence[float]) -> Basis:
    """Return the basis in which a discrepancy of some correlation times [s], (T,), is diagonal.

    The times of the rows [s], and which of them there are, are (W, N).
    """
    gap = np.abs(times[:, :, None] - times[:, None, :])
    both = used[:, :, None] & used[:, None, :]
    kernels = [np.where(both, np.exp(-gap / tau), 0.0) for tau in correlations]
    return Basis(*np.linalg.eigh(np.stack(kernels)))


class Projection(NamedTuple):
    """Errors as the likelihood needs them, for each correlation time T, size S and joint."""

    turned: np.ndarray  # (T, M, W, N) in the bases of the correlation times
    cross: np.ndarray  # (T, S, M, W, D) directions' products with the whitened errors
    known: set[int]  # flat indices (T, S, M) of which these are computed: few are asked for
    square: np.ndarray  # (T, S, M, W) square of the whitened errors, and the log determinant


class Trained(NamedTuple):
    """The discrepancy and the common errors as some windows tell them."""

    time: np.ndarray  # (M,) index of the correlation time
    size: np.ndarray  # (M,) index of the size
    shift: np.ndarray  # (W,) index of a window's own shift
    mean: np.ndarray  # (U,) of the common errors
    precision: np.ndarray  # (U, U)
    density: float  # log density of the windows [nats]


class _Course(NamedTuple):
    """A discrepancy on its way, and what it is trained on."""

    projection: Projection
    windows: np.ndarray  # (n,) indices
    ends: np.ndarray  # (2, M) indices of the smallest and the largest size of each joint
    time: np.ndarray  # these are changed in place, see `Trained`
    size: np.ndarray
    shift: np.ndarray

    @property
    def own(self) -> np.ndarray:
        """Each window's shift, (n,)."""
        return self.shift[self.windows]


class Likelihood:
    """Log densities of the errors of W windows.

    Args:
        times: of the compared rows [s], (W, N).
        used: which of them there are, (W, N) bool.
        noise: standard deviation of a reading of each joint, in the units of errors, (M,).
        local: one standard deviation of each unknown of a window, (W, N, M, L).
        common: one standard deviation of each error of all windows, (W, N, M, U).
        settings: the grid of the discrepancy, and how long it is refined.
        basis: of these times, see `decompose`; None: it is computed.
    """

    def __init__(
        self,
        times: np.ndarray,
        used: np.ndarray,
        noise: np.ndarray,
        local: np.ndarray,
        common: np.ndarray,
        settings: Inference,
        basis: Basis | None = None,
    ) -> None:
        self.used, self.noise, self.settings = used, noise, settings
        self.basis = decompose(times, used, settings.correlations_s) if basis is None else basis
        self.sizes = np.concatenate([[0.0], 2.0 ** np.arange(-1, settings.octaves)])  # (S,)
        self.log_prior = _log_shifts(settings.freedom)
        growth = np.maximum(self.basis.spread, 0.0)[:, None]
        scale = 1 + self.sizes[:, None, None] ** 2 * growth  # (T, S, W, N)
        variance = scale[:, :, None] * noise[:, None, None] ** 2  # (T, S, M, W, N)
        self._inverse = 1.0 / variance
        rows = used.sum(axis=1)
        plain = rows * np.log(2 * np.pi * noise[:, None] ** 2)  # (M, W)
        self._log_det = np.log(scale).sum(axis=-1)[:, :, None] + plain
        self._local = local.shape[-1]
        self._evidence = max(settings.temperature * int(rows.sum()) / FOLDS, 1.0)
        directions = np.concatenate([local, common / np.sqrt(self._evidence)], axis=-1)
        self._turned = self._turn(np.where(used[..., None, None], directions, 0.0))
        count = directions.shape[-1]
        self._gram = np.empty((*self._inverse.shape[:-1], count, count))  # (T, S, M, W, D, D)
        self._known = set[int]()  # flat indices (T, S, M) of which it is computed: few

    def _turn(self, values: np.ndarray) -> np.ndarray:
        """Return values (W, N, M, ...) in the bases of all correlation times, (T, M, W, N, ...)."""
        flat = values.reshape(*values.shape[:2], -1)  # (W, N, M ...)
        turned = (self.basis.vectors.mT @ flat).reshape(len(self.basis.vectors), *values.shape)
        return np.ascontiguousarray(np.moveaxis(turned, 3, 1))

    def project(self, errors: np.ndarray) -> Projection:
        """Return errors (W, N, M) as the other methods need them."""
        turned = self._turn(np.where(self.used[..., None], errors, 0.0))  # (T, M, W, N)
        square = np.einsum("tsmwn,tmwn->tsmw", self._inverse, turned**2) + self._log_det
        cross = np.empty((*square.shape, self._gram.shape[-1]))
        return Projection(turned, cross, set(), square)

    def train(
        self,
        projection: Projection,
        windows: np.ndarray,
        sizes: Sequence[Any] = ANY,
        near: Trained | None = None,
    ) -> Trained:
        """Return the discrepancy that makes some windows most probable.

        Args:
            projection: of the errors.
            windows: to train on, (n,) indices.
            sizes: smallest and largest of the discrepancy, in a joint's noise, numbers or (M,).
            near: where to begin; None: at each joint's own best.
        """
        ends = self._find_ends(sizes)
        start = self._begin(projection, windows, ends, near)
        course = _Course(projection, windows, ends, *start)
        for _ in range(self.settings.turns):
            before = [one.copy() for one in start]
            self._sweep(course)
            self._assign(course)
            if all((a == b).all() for a, b in zip(before, start, strict=True)):
                break
        density, mean, precision = condense(self._whole(course, course.own))
        prior = self.log_prior[course.own].sum()
        return Trained(*start, mean, precision, float(density + prior))

    def predict(
        self, projection: Projection, trained: Trained, sizes: Sequence[Any] = ANY
    ) -> np.ndarray:
        """Return the log predictive density of each window given those trained on, (W,) nats.

        A window's own scale is unknown beforehand and integrated out; see `train` for `sizes`.
        """
        every, known = np.arange(len(self.used)), (trained.time, trained.size, trained.shift)
        course = _Course(projection, every, self._find_ends(sizes), *known)
        own = self._whole(course, np.arange(len(SHIFTS))[:, None])
        found = predict_each(own, trained.mean, trained.precision)  # (K, W)
        return np.logaddexp.reduce(self.log_prior[:, None] + found)

    def charge(self, trained: Trained) -> np.ndarray:
        """Return what the common errors of a half cost by their prior, dealt to rows, (W,) nats.

        The held-out density alone takes them for free: whatever one half tells helps the other.
        """
        share = FOLDS * self.used.sum(axis=1) / self.used.sum()
        return HALF * share * (trained.mean @ trained.mean)

    def is_usual(self, trained: Trained) -> bool:
        """Return whether common errors are as small as their prior lets expect.

        Their estimates shrink: of a direction that readings tell to a share k, the estimate is k
        times as far from zero as the errors themselves, and k^2 of a square is expected. The sum of
        such squares is as a chi-square variable of the same mean and variance (Satterthwaite 1946,
        doi:10.2307/3002019), and exceeds what is allowed here with probability `level`.
        """
        squares = float(trained.mean @ trained.mean) / self._evidence
        told = 1 - 1 / np.linalg.eigvalsh(trained.precision)  # the precision of the prior is 1
        if not (told > 0).any():
            return True
        expected = np.square(told)
        scale = float(expected @ expected / expected.sum())
        freedom = float(expected.sum()) / scale
        return bool(squares <= scale * chi2.isf(self.settings.level, freedom))

    def curvature(
        self,
        trained: Trained,
        vectors: np.ndarray,
        windows: np.ndarray,
        tempered: bool = True,
    ) -> np.ndarray:
        """Return X' V^-1 X over some windows, V the covariance under a trained discrepancy, (P, P).

        The vectors X are (W, N, M, P), the windows (n,) indices; `tempered`: the prior of the
        common errors keeps its weight against readings.
        """
        count = self._turned.shape[-1]
        some = np.where(self.used[windows][..., None, None], vectors[windows], 0.0)
        gram = np.zeros((len(windows), *2 * (count + some.shape[-1],)))
        for joint, (time, size) in enumerate(zip(trained.time, trained.size, strict=True)):
            own = self._shifted(size, trained.shift[windows], (0, len(self.sizes) - 1))
            basis = self.basis.vectors[time, windows]
            turned = basis.mT @ some[:, :, joint]
            both = np.concatenate([self._turned[time, joint, windows], turned], axis=-1)
            weight = self._inverse[time, own, joint, windows]
            gram += (both * weight[..., None]).mT @ both
        gram = eliminate(gram, self._local).sum(axis=0)
        return eliminate(gram, count - self._local, 1.0 if tempered else 1 / self._evidence)

    def estimate(
        self, trained: Trained, errors: np.ndarray, directions: np.ndarray, windows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the posterior mean and variance of common errors, (P,) each.

        With V the covariance of errors e and D one standard deviation of each common error, they
        are D' V^-1 e and the diagonal of I - D' V^-1 D (Rasmussen and Williams 2006, eq. A.6).
        Errors e are (W, N, M), directions D (W, N, M, P); V has what is common in itself. Windows,
        (n,) indices, are those that tell.
        """
        vectors = np.concatenate([errors[..., None], directions], axis=-1)
        gram = self.curvature(trained, vectors, windows) / self._evidence
        return gram[0, 1:], 1 - np.diag(gram)[1:]

    def _find_ends(self, sizes: Sequence[Any]) -> np.ndarray:
        """Return indices of the smallest and the largest size of each joint, (2, M)."""
        found = [np.searchsorted(self.sizes, one, side="right") - 1 for one in sizes]
        return np.stack([np.broadcast_to(one, self.noise.shape) for one in found])

    def _shifted(self, size: Any, shift: np.ndarray, ends: Any) -> np.ndarray:
        """Return indices of sizes, between the ends, that windows' own shifts lead to."""
        return np.clip(size + SHIFTS[shift], *ends)

    def _whole(self, course: _Course, shift: np.ndarray) -> Products:
        """Return the products of all joints, each window's own unknowns integrated out."""
        return integrate(reduce(add, self._parts(course, shift)), self._local)

    def _parts(self, course: _Course, shift: np.ndarray) -> list[Products]:
        """Return the products of each joint in windows of some shifts."""
        joints = enumerate(zip(course.time, course.size, course.ends.T, strict=True))
        cells = [
            (t, self._shifted(s, shift, own), joint, course.windows)
            for joint, (t, s, own) in joints
        ]
        return [self._products(course.projection, cell) for cell in cells]

    def _products(self, projection: Projection, cell: Any) -> Products:
        """Return the products at times, sizes, joints and windows."""
        for one in self._list_new(self._known, *cell[:3]):
            turned = self._turned[one[0], one[2]]  # (W, N, D)
            self._gram[one] = (turned * self._inverse[one][..., None]).mT @ turned
        for one in self._list_new(projection.known, *cell[:3]):
            weighed = self._inverse[one] * projection.turned[one[0], one[2]]  # (W, N)
            directions = self._turned[one[0], one[2]]
            projection.cross[one] = (weighed[:, None] @ directions)[:, 0]
        return Products(self._gram[cell], projection.cross[cell], projection.square[cell])

    def _list_new(self, known: set[int], time: Any, size: Any, joint: int) -> list[tuple[Any, ...]]:
        """Return which of some cells are not known yet; from then on they are."""
        shape = self._inverse.shape[:3]
        new = set(np.ravel((time * shape[1] + size) * shape[2] + joint).tolist()) - known
        known |= new
        return [np.unravel_index(one, shape) for one in new]

    def _begin(
        self, projection: Projection, windows: np.ndarray, ends: np.ndarray, near: Trained | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where a training starts: time (M,), size (M,), shift (W,)."""
        if near is not None:
            return near.time.copy(), np.clip(near.size, *ends), near.shift.copy()
        alone = np.median(projection.square[..., windows], axis=-1)  # (T, S, M)
        time, size = np.zeros_like(ends[0]), ends[0].copy()
        for joint, (first, last) in enumerate(ends.T):
            own = alone[:, first : last + 1, joint]
            best = np.argmin(own.round(DECIMALS))  # of size 0 all times are alike
            time[joint], size[joint] = np.add(np.unravel_index(best, own.shape), (0, first))
        return time, size, np.full(len(self.used), int(np.flatnonzero(SHIFTS == 0)[0]))

    def _sweep(self, course: _Course) -> None:
        """Let each joint's discrepancy in turn be the best near to what it is, in place.

        Windows' own scales follow by a step: else those that need a larger discrepancy would keep
        the size of all from becoming smaller.
        """
        projection, windows, ends, time, size, shift = course
        _, mean, _ = condense(self._whole(course, course.own))
        shifts = np.clip(course.own + STEPS[:, None], 0, len(SHIFTS) - 1)  # (3, n)
        parts = self._parts(course, shifts)
        later = [*accumulate(reversed(parts), add)][-2::-1]  # those after each joint but the last
        before: list[Products] = []  # those before it
        for joint in range(len(self.noise)):
            others, tried = before + later[joint : joint + 1], dict[tuple[int, int], float]()
            last, own_ends = len(self.basis.vectors) - 1, ends[:, joint]
            best, kept = (int(time[joint]), int(size[joint])), dict[tuple[int, int], np.ndarray]()
            while near := [one for one in _list_near(*best, last, own_ends) if one not in tried]:
                times, sizes = np.transpose(near)[..., None, None]
                own = self._shifted(sizes, shifts, own_ends)  # (c, 3, n)
                cells = self._products(projection, (times, own, joint, windows))
                whole = integrate(reduce(add, others, cells), self._local)
                found, picked = self._follow(whole, shifts, mean)
                tried |= dict(zip(near, found.round(DECIMALS).tolist(), strict=True))
                kept |= dict(zip(near, picked, strict=True))
                best = max(tried, key=tried.__getitem__)
            time[joint], size[joint], shift[windows] = *best, kept[best]
            own = self._shifted(best[1], shifts, own_ends)
            cells = self._products(projection, (best[0], own, joint, windows))
            before = [reduce(add, before, cells)]

    def _follow(
        self, whole: Products, shifts: np.ndarray, mean: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the log densities (c,) of windows whose shifts fit best, and these, (c, n).

        Products are (c, 3, n) of shifts (3, n), which fit these common errors or stay.
        """
        worth = self.log_prior[shifts] - HALF * (whole.square + compute_pull(whole, mean))
        best = np.argmax(worth, axis=1)  # (c, n)
        steps = np.stack([np.ones_like(best), best])  # (2, c, n)
        places = np.arange(len(best))[:, None], steps, np.arange(best.shape[1])
        picked = shifts[places[1:]]
        density = condense(Products(*(one[places] for one in whole)))[0]
        density += self.log_prior[picked].sum(axis=-1)  # (2, c)
        better = np.argmax(density, axis=0), np.arange(len(best))
        return density[better], picked[better]

    def _assign(self, course: _Course) -> None:
        """Give each window the scale that fits it best, the common errors as they are, in place."""
        _, mean, _ = condense(self._whole(course, course.own))
        own = self._whole(course, np.arange(len(SHIFTS))[:, None])  # (K, n)
        found = self.log_prior[:, None] - HALF * (own.square + compute_pull(own, mean))
        course.shift[course.windows] = np.argmax(found, axis=0)


def _log_shifts(freedom: float) -> np.ndarray:
    """Return the log probability of each of `SHIFTS` under a Student distribution's scale.

    The scale m has 1 / m^2 ~ Gamma(freedom / 2, rate freedom / 2).
    """
    edges = 2.0 ** (SHIFTS[:-1] + 1 / 2)
    below = gammaincc(freedom / 2, freedom / 2 / edges**2)
    return np.log(np.diff([0.0, *below, 1.0]))


def _list_near(time: int, size: int, last: int, ends: np.ndarray) -> list[tuple[int, int]]:
    """Return indices of a time and a size, and of their neighbours: itself first."""
    found = [(time + one, size + other) for one, other in NEAR]
    return [(t, s) for t, s in found if 0 <= t <= last and ends[0] <= s <= ends[1]]
