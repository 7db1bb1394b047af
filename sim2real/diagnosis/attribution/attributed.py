"""A whole search on some windows: from the model as given to a conclusion.

    found = attributed(about)                   # found.made.report, found.floors

Where windows start from an estimate (`ground`), that estimate is the model's as given. Once a first
cause is known it is made again with this cause in the model, and the search begins anew on these
windows, among what promised most.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from envs.effects import Effect, merge_effects
from envs.plant import Fixed
from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.conclude import Conclusion, conclude, nothing, unsearched
from sim2real.diagnosis.attribution.ends import at_ends
from sim2real.diagnosis.attribution.fit import Fit, columns
from sim2real.diagnosis.attribution.joint_groups import by_family, is_spread
from sim2real.diagnosis.attribution.parsimony import simplified
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.ties import Witnessed
from sim2real.diagnosis.attribution.torque_on import refit_torque_on
from sim2real.diagnosis.attribution.verdict import is_no_gap, stands_out
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.progress import Moving
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.work import Work
from sim2real.runs.errors import Sim2RealError

Restart = Callable[[Sequence[Fixed]], Data]
WEIGHING = 0.9  # share of the work that is done then


class About(NamedTuple):
    """What a search is about.

    Args:
        data: the windows.
        exclude: effects that are no candidates.
        fixed: effects that are in the model.
        rng: for all intervals.
        on_progress: told what is being tried.
        work: counts what is simulated, by stage.
        witnessed: effects that channels measured.
    """

    data: Data
    exclude: Sequence[str]
    fixed: Sequence[Fixed]
    rng: np.random.Generator
    on_progress: Moving
    work: Work
    witnessed: Witnessed = frozenset()


class Attributed(NamedTuple):
    """What a search came to, and on which windows."""

    data: Data
    search: Search
    floors: np.ndarray  # (M,) rad or m
    made: Conclusion


def attributed(
    about: About, wrong: str | None = None, restart: Restart | None = None
) -> Attributed:
    """Search, and conclude.

    Args:
        about: what.
        wrong: what is wrong with the logs, so that no cause is looked for; None: nothing.
        restart: returns the windows whose starts were estimated with some effects in the model;
            None: starts are known.

    Raises:
        Sim2RealError: a model that cannot follow the logs.
    """
    data, rng = about.data, about.rng
    floors = data.floors()
    search = search_of(about, floors)
    if wrong is not None:
        return Attributed(data, search, floors, unsearched(search, floors, rng, wrong))
    if is_no_gap(search.before, search.floor, data, stands_out(search.base, data, floors)):
        return Attributed(data, search, floors, nothing(search, floors, rng))
    found = search.run(None if restart is None else 1)
    if restart is not None:
        search, found = _restarted(about, floors, search, found, restart)
    with about.work.during("with torque alone"):
        found = refit_torque_on(search, found)
    if is_spread(search, found):
        with about.work.during("joints at once"):
            found = by_family(search, found)
    with about.work.during("fewer values"):
        found = at_ends(search, simplified(search, found))
    search.say("weighing what was found", WEIGHING)
    with about.work.during("weighing"):
        made = conclude(search, found, floors, rng)
    return Attributed(search.problem.data, search, floors, made)


def search_of(about: About, floors: np.ndarray, only: Sequence[str] | None = None) -> Search:
    """Return a search that has not run, among candidates of these labels; None: among all."""
    data = about.data
    floor = float(np.sqrt(np.mean((floors / data.scale) ** 2)))
    tick, work = about.on_progress.tick, about.work
    problem = Problem(data, Simulator(data, about.fixed, on_run=tick, work=work))
    with work.during("as given"):
        _refuse_lost(problem)
        options = candidates(data, about.exclude, about.fixed)
        options = [option for option in options if only is None or option.label in only]
        return Search(
            problem,
            options,
            floor,
            about.rng,
            about.on_progress,
            floors / data.scale,
            about.witnessed,
            candidates(data, about.exclude, about.fixed, standing_in=True),
        )


def _restarted(
    about: About, floors: np.ndarray, search: Search, found: Found, restart: Restart
) -> tuple[Search, Found]:
    """Return the search and what it found once the windows' starts know a first cause.

    Where nothing was found, where nothing is left, or where more is left then, it is the first one.
    """
    left = search.blocks.rms(found.error)
    if not found.fit.members or left <= search.least:
        return search, found
    kept = [member.label for member in found.fit.members]
    most = about.data.settings.ground.again
    kept += [guess.candidate.label for guess in search.first.guesses[:most]]
    data = restart(merge_effects(about.fixed, causes_of(found.fit)))
    again = search_of(about._replace(data=data), floors, kept)
    more = again.run()
    return (again, more) if again.blocks.rms(more.error) < left else (search, found)


def causes_of(fit: Fit) -> tuple[tuple[Effect, tuple[float, ...]], ...]:
    """Return the members of a fit with their values."""
    places = columns(fit.members)
    return tuple(
        (member.effect, tuple(float(v) for v in fit.mean[place]))
        for member, place in zip(fit.members, places, strict=True)
    )


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
