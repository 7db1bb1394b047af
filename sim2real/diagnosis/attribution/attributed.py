"""A whole search on some windows: from the model as given to a conclusion.

    found = attributed(about)                   # found.made.report, found.floors
    found = restarted(about, found, restart)    # windows whose starts know the causes

Where windows start from an estimate (`ground`), that estimate is the model's as given. It is made
again with the causes in the model, and what explained the logs, with what promised most beside it,
is fitted and judged anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from envs.effects import Effect, combined
from envs.plant import Fixed
from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.conclude import Conclusion, conclude, nothing, unsearched
from sim2real.diagnosis.attribution.fit import Fit, Problem, columns
from sim2real.diagnosis.attribution.joint_groups import by_family, is_spread
from sim2real.diagnosis.attribution.parsimony import simplified
from sim2real.diagnosis.attribution.torque_on import refit_torque_on
from sim2real.diagnosis.attribution.verdict import is_no_gap, stands_out
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.noise_floor import noise_floor, rounding
from sim2real.diagnosis.data.progress import Moving
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.runs.errors import Sim2RealError

WEIGHING = 0.9  # share of the work that is done then


class About(NamedTuple):
    """What a search is about.

    Args:
        data: the windows.
        exclude: effects that are no candidates.
        fixed: effects that are in the model.
        rng: for all intervals.
        on_progress: told what is being tried.
    """

    data: Data
    exclude: Sequence[str]
    fixed: Sequence[Fixed]
    rng: np.random.Generator
    on_progress: Moving


class Attributed(NamedTuple):
    """What a search came to, and on which windows."""

    data: Data
    search: Search
    floors: np.ndarray  # (M,) rad or m
    made: Conclusion


def attributed(
    about: About, wrong: str | None = None, only: Sequence[str] | None = None
) -> Attributed:
    """Search, and conclude.

    Args:
        about: what.
        wrong: what is wrong with the logs, so that no cause is looked for; None: nothing.
        only: labels of the candidates; None: all there are.

    Raises:
        Sim2RealError: a model that cannot follow the logs.
    """
    data, rng, progress = about.data, about.rng, about.on_progress
    floors = floors_of(data)
    floor = float(np.sqrt(np.mean((floors / data.scale) ** 2)))
    problem = Problem(data, Simulator(data, about.fixed, on_run=progress.tick))
    _refuse_lost(problem)
    options = candidates(data, about.exclude, about.fixed)
    options = [option for option in options if only is None or option.label in only]
    search = Search(problem, options, floor, rng, progress, floors / data.scale)
    made = _searched(search, data, floors, rng) if wrong is None else None
    made = made or unsearched(search, floors, rng, wrong or "")
    return Attributed(data, search, floors, made)


def restarted(
    about: About, first: Attributed, restart: Callable[[Sequence[Fixed]], Data]
) -> Attributed:
    """Return what is left to be said once the windows' starts know the causes.

    Args:
        about: as it was searched first.
        first: what was found; if it leaves nothing, it stays.
        restart: returns the windows whose starts were estimated with some effects in the model.
    """
    gap, search = first.made.report.gap, first.search
    causes = causes_of(first.made.fit)
    if not causes or gap.after is None or gap.after <= search.least:
        return first
    kept = [member.label for member in first.made.fit.members]
    most = first.data.settings.ground.again
    kept += [guess.candidate.label for guess in search.first.guesses[:most]]
    again = attributed(about._replace(data=restart(combined(about.fixed, causes))), only=kept)
    after = again.made.report.gap.after
    return again if after is not None and after < gap.after else first


def causes_of(fit: Fit) -> tuple[tuple[Effect, tuple[float, ...]], ...]:
    """Return the members of a fit with their values."""
    places = columns(fit.members)
    return tuple(
        (member.effect, tuple(float(v) for v in fit.mean[place]))
        for member, place in zip(fit.members, places, strict=True)
    )


def _searched(
    search: Search, data: Data, floors: np.ndarray, rng: np.random.Generator
) -> Conclusion:
    if is_no_gap(search.before, search.floor, data, stands_out(search.base, data, floors)):
        return nothing(search, floors, rng)
    found = refit_torque_on(search, search.run())
    if is_spread(search, found):
        found = by_family(search, found)
    found = simplified(search, found)
    search.say("weighing what was found", WEIGHING)
    return conclude(search, found, floors, rng)


def floors_of(data: Data) -> np.ndarray:
    """Return the noise floor of each joint [rad or m], (M,)."""
    found = noise_floor(data.logs, data.settings)
    return np.array([max(found.get(j.name, 0.0), rounding(j.count)) for j in data.joints])


def _refuse_lost(problem: Problem) -> None:
    """Raise Sim2RealError if the model as given cannot follow the logs."""
    data = problem.data
    every = np.arange(len(data.windows))
    lost = problem.simulator.run((), every, np.zeros((len(every), 0))).lost
    if np.isfinite(lost).any():
        first = int(np.argmax(np.isfinite(lost)))
        window = data.windows[first]
        path = data.logs[window.log].path or "the log"
        moment = data.logs[window.log].time[window.first] + float(lost[first])
        raise Sim2RealError(
            f"{path}, episode {window.episode}: the model cannot follow the log, it diverges at "
            f"about {moment:.2f} s; try a smaller timestep, or check masses, gains and units"
        )
