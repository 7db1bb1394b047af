"""Effects that both sides share, fitted before anything is compared.

    watch = share(simulator, watch, windows)

First the friction of every joint, which no model knows; then the effect whose straight line closes
most of the gap that is left joins and is fitted, and the next one, as long as each closes enough.
The windows with the largest gap are looked at. That is less than a
diagnosis: it moves the simulation close to the robot, so that a change has the response it has
there. Where a diagnosis was made, give `effects=`.
"""

import logging

import numpy as np
from scipy.optimize import least_squares

from sim2real.diagnosis.comparison.alike import FIELDS
from sim2real.diagnosis.comparison.response import Response, Watch, errors, respond
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.inference.batches import Rows, simulate_each
from sim2real.diagnosis.inference.candidates import Candidate, get_nudges
from sim2real.diagnosis.settings import TINY_SQUARE

log_ = logging.getLogger(__name__)
SMALL = 1e-6  # of a typical change: a start has to be inside its bounds


def share(simulator: Simulator, watch: Watch, windows: np.ndarray) -> Watch:
    """Return the watch with what both sides have.

    Args:
        simulator: of all windows.
        watch: what may change.
        windows: the first ones of each motion, (n,).
    """
    limits = simulator.data.settings.compared
    error = errors(simulator, watch, windows)
    worst = windows[np.argsort(-simulator.data.only(windows).window_squares(error))]
    looked = np.sort(worst[: simulator.data.settings.windows.windows_usual])
    gap = _gap(error[np.isin(windows, looked)])
    for step in (_rubbing, *[_joined] * limits.shared_max):
        tried = step(simulator, looked, watch)
        left = gap if tried is None else _gap(errors(simulator, tried, looked))
        if tried is None or left > (1 - limits.shared_worth) * gap:
            if step is _joined:
                break  # the next one would be the same
            continue
        labels = ", ".join(member.label for member in tried.shared[len(watch.shared) :])
        log_.info("both have %s: %.3g of %.3g is left", labels, left, gap)
        watch, gap = tried, left
    return watch


def _rubbing(simulator: Simulator, windows: np.ndarray, watch: Watch) -> Watch | None:
    """Return the watch with friction at every joint, fitted; None where there is none to fit."""
    response = respond(simulator, watch, windows, _is_friction)
    taken = {member.label for member in watch.shared}
    own = [k for k, c in enumerate(response.columns) if c.option.label not in taken]
    if not own:
        return None
    flat = response.change[own].reshape(len(own), -1)
    found, *_ = np.linalg.lstsq(flat.T, -response.error.reshape(-1), rcond=None)
    options = [response.columns[k].option for k in own]
    starts = [
        np.clip(o.neutral + value, o.low, o.high) for o, value in zip(options, found, strict=True)
    ]
    small = [np.clip(o.neutral + o.step, o.low, o.high) for o in options]
    points = np.stack([np.concatenate([watch.values, *point]) for point in (starts, small)])
    values = _fit(simulator, windows, (*watch.shared, *options), points)
    for option in options:
        watch = watch.having(option, values)
    return watch


def _is_friction(option: Candidate) -> bool:
    return option.name in FIELDS and not option.shared


def _joined(simulator: Simulator, windows: np.ndarray, watch: Watch) -> Watch | None:
    """Return the watch with the effect more that closes most, fitted; None if none is worth it."""
    limits = simulator.data.settings.compared
    response = respond(simulator, watch, windows)
    taken = {member.label for member in watch.shared}
    free = [c for c, own in enumerate(response.columns) if own.option.label not in taken]
    best = max(free, key=lambda c: _closed(response, c), default=None)
    if best is None or _closed(response, best) < limits.shared_worth * _gap(response.error):
        return None
    option, place = response.columns[best].option, response.columns[best].place
    start = option.neutral.copy()
    start[place] += _value(response, best)
    points = [np.clip(start, option.low, option.high), option.neutral]
    starts = np.stack([np.concatenate([watch.values, point]) for point in points])
    return watch.having(option, _fit(simulator, windows, (*watch.shared, option), starts))


def _fit(
    simulator: Simulator, windows: np.ndarray, members: tuple[Candidate, ...], starts: np.ndarray
) -> np.ndarray:
    """Return the values, (P,), of effects that leave the least squared error in some windows."""

    def replay(points: np.ndarray) -> np.ndarray:
        rows = [
            Rows(members, windows, np.tile(p, (len(windows), 1))) for p in np.atleast_2d(points)
        ]
        return np.stack([made.error.ravel() for made in simulate_each(simulator, rows)])

    def slopes(point: np.ndarray) -> np.ndarray:
        steps = get_nudges(members, point)
        base, *moved = replay(np.vstack([point, point + np.diag(steps)]))
        return (np.array(moved) - base).T / steps

    low = np.concatenate([member.low for member in members])
    high = np.concatenate([member.high for member in members])
    size = np.concatenate([member.step for member in members])
    best = starts[np.square(replay(starts)).sum(axis=1).argmin()]
    inside = np.clip(best, low + SMALL * size, high - SMALL * size)
    rounds = simulator.data.settings.inference.rounds
    fit = least_squares(
        lambda point: replay(point)[0],
        inside,
        jac=slopes,  # type: ignore[arg-type]
        bounds=(low, high),
        x_scale=size,
        max_nfev=rounds,
    )
    return fit.x


def _gap(error: np.ndarray) -> float:
    """Return the root mean square of errors."""
    return float(np.sqrt(np.mean(error**2)))


def _value(response: Response, column: int) -> float:
    along = response.change[column]
    return -float((along * response.error).sum() / max(float((along**2).sum()), TINY_SQUARE))


def _closed(response: Response, column: int) -> float:
    """Return by how much the straight line of a column lowers the gap, within its range."""
    option, place = response.columns[column].option, response.columns[column].place
    low, high = (end[place] - option.neutral[place] for end in (option.low, option.high))
    value = np.clip(_value(response, column), low, high)
    return _gap(response.error) - _gap(response.error + value * response.change[column])
