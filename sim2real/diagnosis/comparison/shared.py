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

from sim2real.diagnosis.comparison.response import Response, Watch, errors, is_friction, respond
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.inference.batches import simulate_each
from sim2real.diagnosis.inference.candidates import get_nudges
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
    data, limits = simulator.data, simulator.data.settings.compared
    error = errors(simulator, watch, windows)
    worst = windows[np.argsort(-data.only(windows).window_squares(error))]
    looked = np.sort(worst[: data.settings.windows.windows_usual])
    gap = _gap(error[np.isin(windows, looked)])
    for step in (_rubbing, *[_joined] * limits.shared_max):
        tried = step(simulator, looked, watch)
        left = gap if tried is None else _gap(errors(simulator, tried, looked))
        if tried is not None and left <= (1 - limits.shared_worth) * gap:
            more = ", ".join(label for label in tried.shared if label not in watch.shared)
            log_.info("both have %s: %.3g of %.3g is left", more, left, gap)
            watch, gap = tried, left
        elif step is _joined:
            break  # the next one would be the same
    return watch


def _rubbing(simulator: Simulator, windows: np.ndarray, watch: Watch) -> Watch | None:
    """Return the watch with friction at every joint, fitted; None where there is none to fit."""
    some = tuple(option for option in watch.options if is_friction(option))
    response = respond(simulator, watch._replace(options=some), windows)
    own = _free(response, watch)
    lines = small = watch
    for k, value in zip(own, response.values(own), strict=True):
        column = response.columns[k]
        lines = lines.moved(column, value)
        small = small.moved(column, float(column.option.step[0]))
    return _fit(simulator, windows, lines, small) if own else None


def _joined(simulator: Simulator, windows: np.ndarray, watch: Watch) -> Watch | None:
    """Return the watch with the effect more that closes most, fitted; None if none is worth it."""
    response = respond(simulator, watch, windows)
    gap, closed = _gap(response.error), {}
    for k in _free(response, watch):
        (option, place), line = response.columns[k], response.change[k]
        value = -float((line * response.error).sum() / max(float((line**2).sum()), TINY_SQUARE))
        low, high = (end[place] - option.neutral[place] for end in (option.low, option.high))
        left = _gap(response.error + np.clip(value, low, high) * line)
        closed[k] = gap - left, value
    best = max(closed, key=lambda k: closed[k][0], default=None)
    if best is None or closed[best][0] < simulator.data.settings.compared.shared_worth * gap:
        return None
    column = response.columns[best]
    return _fit(simulator, windows, *(watch.moved(column, v) for v in (closed[best][1], 0.0)))


def _free(response: Response, watch: Watch) -> list[int]:
    """Return the columns of effects that the sides do not share yet."""
    return [k for k, own in enumerate(response.columns) if own.option.label not in watch.shared]


def _fit(simulator: Simulator, windows: np.ndarray, *starts: Watch) -> Watch:
    """Return the better of some starts with the shared values that leave the least square."""

    def replay(tried: list[Watch]) -> np.ndarray:
        made = simulate_each(simulator, [one.rows(windows) for one in tried])
        return np.stack([one.error.ravel() for one in made])

    def slopes(point: np.ndarray) -> np.ndarray:
        steps = get_nudges(members, point)
        points = [point, *(point + np.diag(steps))]
        base, *moved = replay([best.at(one) for one in points])
        return (np.array(moved) - base).T / steps

    best = starts[np.square(replay(list(starts))).sum(axis=1).argmin()]
    members = [option for option, _ in best.shared.values()]
    low, high, size = (
        np.concatenate([getattr(member, name) for member in members])
        for name in ("low", "high", "step")
    )
    fit = least_squares(
        lambda point: replay([best.at(point)])[0],
        np.clip(best.values, low + SMALL * size, high - SMALL * size),
        jac=slopes,  # type: ignore[arg-type]
        bounds=(low, high),
        x_scale=size,
        max_nfev=simulator.data.settings.inference.rounds,
    )
    return best.at(fit.x)


def _gap(error: np.ndarray) -> float:
    """Return the root mean square of errors."""
    return float(np.sqrt(np.mean(error**2)))
