"""What is wrong with the windows, and how it would change with each effect that is watched.

watch = watched(data, known, ("coulomb_friction", "backlash"))
response = respond(Simulator(data, watch.fixed), watch, windows)
response.error, response.change                     # (W, T, M), (P, n, T, M)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.inference.batches import Rows, simulate_each
from sim2real.diagnosis.inference.candidates import (
    TYPICAL,
    Candidate,
    candidates,
    get_nudges,
    in_the_way,
)

VECTORS = ("gravity_tilt",)  # effects whose values are all one thing


@dataclass(frozen=True)
class Watch:
    """What may change, and what both sides have.

    Attributes:
        options: the effects that may change.
        shared: effects that both sides have and a candidate cannot be put on top of.
        values: of `shared`, (P,).
        fixed: effects that are part of the model.
    """

    options: tuple[Candidate, ...]
    shared: tuple[Candidate, ...]
    values: np.ndarray
    fixed: tuple[Fixed, ...]

    @property
    def pairs(self) -> list[tuple[Candidate, np.ndarray]]:
        """The shared effects, each with its values."""
        ends = np.cumsum([len(member.neutral) for member in self.shared], dtype=int)
        return list(zip(self.shared, np.split(self.values, ends)[:-1], strict=True))

    def having(self, option: Candidate, values: np.ndarray) -> Watch:
        """Return the watch with a shared effect more, or with other values of the shared ones."""
        known = {member.label for member in self.shared}
        more = () if option.label in known else (option,)
        return Watch(self.options, (*self.shared, *more), values, self.fixed)

    def moved(self, column: Column, change: float) -> Watch:
        """Return the watch with a number of an effect changed, within its range."""
        option, place, start = column.option, column.place, 0
        for member in self.shared:
            if member.label == option.label:
                values = self.values.copy()
                break
            start += len(member.neutral)
        else:
            values = np.concatenate([self.values, option.neutral])
        wanted = values[start + place] + change
        values[start + place] = np.clip(wanted, option.low[place], option.high[place])
        return self.having(option, values)


class Column(NamedTuple):
    """One number that may change."""

    option: Candidate
    place: int  # of its parameter

    @property
    def label(self) -> str:
        """Its effect, place, and which of several numbers."""
        return self.option.label + (f" ({'xyz'[self.place]})" if self.place else "")

    @property
    def largest(self) -> float:
        """Size of the largest change that a diagnosis looks at."""
        return float(self.option.step[self.place]) / TYPICAL


class Response(NamedTuple):
    """Errors of n windows with what both sides share, and how they change with each column."""

    error: np.ndarray  # (n, T, M)
    slope: np.ndarray  # (n, T, M) with the clock
    columns: tuple[Column, ...]
    change: np.ndarray  # (P, n, T, M) per unit of the column
    parts: Mapping[int, Parts] = MappingProxyType({})  # of columns that are made of others


Parts = tuple[tuple[int, float], ...]  # each column, and how much of it


def watched(data: Data, known: Sequence[Fixed], names: Sequence[str]) -> Watch:
    """Return the effects of these names that the robot can have, one variant at each place."""
    every = candidates(data)
    kept: dict[tuple[str, str | None], Candidate] = {}
    for option in every:
        if option.name in names:
            kept.setdefault((option.name, option.effect.where), option)
    found = [(one, None if one[0].composes else _option(every, one)) for one in known]
    stays = [one for one, option in found if option is None]
    moved = [one for one, option in found if option is not None]
    shared = tuple(option for _, option in found if option is not None)
    for option in shared:
        if (option.name, option.effect.where) in kept:
            kept[option.name, option.effect.where] = option
    values = np.array([value for _, own in moved for value in own], float)
    alone = len(data.joints) == 1
    options = [o for o in kept.values() if not (alone and o.shared)]
    return Watch(tuple(options), shared, values, tuple(stays))


def errors(simulator: Simulator, watch: Watch, windows: np.ndarray) -> np.ndarray:
    """Return the errors of windows (n,) with what both sides have, (n, T, M)."""
    return simulate_each(simulator, [_rows(watch.shared, windows, watch.values)])[0].error


def _rows(members: Sequence[Candidate], windows: np.ndarray, point: np.ndarray) -> Rows:
    return Rows(tuple(members), windows, np.tile(point, (len(windows), 1)))


def respond(
    simulator: Simulator,
    watch: Watch,
    windows: np.ndarray,
    wanted: Callable[[Candidate], bool] = lambda option: True,
) -> Response:
    """Simulate windows with what both sides have, and with each effect a little larger.

    Args:
        simulator: of the data, with what is fixed.
        watch: what may change.
        windows: those to look at, (n,).
        wanted: which of the effects that may change are looked at; those of both sides always are.
    """
    shared, small = watch.shared, simulator.data.settings.compared.step
    known = {member.label for member in shared}
    probes = [
        probe
        for option in watch.options
        if option.label not in known and wanted(option)
        if not any(in_the_way(one.effect, option.effect) for one in shared)
        for probe in _probes(option, small)
    ]
    sets = [_rows(shared, windows, watch.values)]
    for probe in probes:
        point = np.concatenate([watch.values, probe.point])
        sets.append(_rows((*shared, probe.column.option), windows, point))
    start = 0
    for member, value in watch.pairs:
        steps = get_nudges((member,), value)
        for place in range(_count(member)):
            point = watch.values.copy()
            point[start + place] += steps[place]
            sets.append(_rows(shared, windows, point))
            probes.append(_Probe(Column(member, place), point, float(steps[place])))
        start += len(value)
    base, *moved = simulate_each(simulator, sets)
    change = [
        (one.error - base.error) / probe.step for one, probe in zip(moved, probes, strict=True)
    ]
    columns = tuple(probe.column for probe in probes)
    return Response(base.error, base.slope, columns, np.array(change))


def _count(option: Candidate) -> int:
    """Return how many numbers of an effect may change."""
    return len(option.neutral) if option.name in VECTORS else 1


class _Probe(NamedTuple):
    """A number that is moved: its effect's values, and by how much it moved."""

    column: Column
    point: np.ndarray  # (P,)
    step: float


def _probes(option: Candidate, small: float) -> list[_Probe]:
    """Return how each number of an effect is moved; what acts in proportion, by a small share.

    A factor's straight line over a quarter of its value is another one than over some per cent.
    Play and the like have no smaller steps that say anything.
    """
    sizes = np.abs(option.probes - option.neutral)
    count = _count(option)
    share = small if option.name in VECTORS or option.effect.how == "scale" else 1.0
    found = []
    for place in range(count):
        along = np.flatnonzero(sizes[:, place] > 0)
        probe = option.probes[along[np.argmin(sizes[along, place])]]
        point = np.array(probe if count == 1 else option.neutral, float)
        step = float(share * (probe[place] - option.neutral[place]))
        point[place] = option.neutral[place] + step
        found.append(_Probe(Column(option, place), point, step))
    return found


def _option(every: Sequence[Candidate], known: Fixed) -> Candidate | None:
    effect = known[0]
    return next(
        (
            option
            for option in every
            if (option.name, option.effect.where, option.effect.side)
            == (effect.name, effect.where, effect.side)
            and len(option.neutral) == len(known[1])
        ),
        None,
    )
