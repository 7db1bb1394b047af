"""Effects that both sides share, fitted before anything is compared.

    watch = share(simulator, watch, windows)

First the friction of every joint, which no model knows; then the effect whose straight line closes
most of the gap that is left joins and is fitted, and the next one, as long as each closes enough.
The windows with the largest gap are looked at. That is less than a diagnosis: it moves the
simulation close to the robot, so that a change has the response it has there. Where a diagnosis was
made, give `effects=`.
"""

import logging
from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from sim2real.diagnosis.comparison.response import Watch, errors, is_friction, respond
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.inference.batches import simulate_each
from sim2real.diagnosis.inference.candidates import get_nudges

log_ = logging.getLogger(__name__)
SMALL = 1e-6  # of a typical change: a start has to be inside its bounds


def share(simulator: Simulator, watch: Watch, windows: np.ndarray) -> Watch:
    """Return the watch with what both sides have; `windows` (n,) are those of first logs."""
    data, settings = simulator.data, simulator.data.settings
    enough, every = 1 - settings.numerics.change, watch.options
    error = errors(simulator, watch, windows)
    worst = windows[np.argsort(-data.only(windows).window_squares(error))]
    looked = np.sort(worst[: settings.windows.windows_usual])
    gap = _gap(error[np.isin(windows, looked)])
    friction = tuple(option for option in every if is_friction(option))
    for options in (friction, *[every] * settings.inference.members_max):
        rubs = options is friction
        response = respond(simulator, watch._replace(options=options), looked)
        free = [k for k, own in enumerate(response.columns) if own.option.label not in watch.shared]
        lines = [response.lines(some) for some in ([free] if rubs else [[k] for k in free]) if some]
        line = min(lines, key=lambda one: _gap(response.along(one)), default={})
        if not rubs and _gap(response.along(line)) > enough * gap:
            break
        starts = [response.moved(watch, {k: v * way for k, v in line.items()}) for way in (1, 0)]
        tried = _fit(simulator, looked, starts) if line else watch
        left = _gap(errors(simulator, tried, looked))
        if left <= enough * gap:
            more = ", ".join(label for label in tried.shared if label not in watch.shared)
            log_.info("both have %s: %.3g of %.3g is left", more, left, gap)
            watch, gap = tried, left
        elif not rubs:
            break  # the next one would be the same
    return watch


def _fit(simulator: Simulator, windows: np.ndarray, starts: Sequence[Watch]) -> Watch:
    """Return the better of some starts with the shared values that leave the least square."""

    def replay(tried: Sequence[Watch]) -> np.ndarray:
        made = simulate_each(simulator, [one.rows(windows) for one in tried])
        return np.stack([one.error.ravel() for one in made])

    def slopes(point: np.ndarray) -> np.ndarray:
        steps = get_nudges(members, point)
        points = [point, *(point + np.diag(steps))]
        base, *moved = replay([best.at(one) for one in points])
        return (np.array(moved) - base).T / steps

    best = starts[np.square(replay(starts)).sum(axis=1).argmin()]
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
