"""What is wrong with the windows, and how it would change with each effect that is watched.

watch = watched(data, known, ("coulomb_friction", "backlash"))
response = respond(Simulator(data, watch.fixed), watch, windows)
response.error, response.change                     # (W, T, M), (P, n, T, M)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from envs.plant import Fixed
from sim2real.diagnosis.attribution.candidates import Candidate, candidates
from sim2real.diagnosis.attribution.fit import nudges
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulated, Simulator

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

    def having(self, option: Candidate, values: np.ndarray) -> Watch:
        """Return the watch with a shared effect more, or with other values of the shared ones."""
        known = {member.label for member in self.shared}
        more = () if option.label in known else (option,)
        return Watch(self.options, (*self.shared, *more), values, self.fixed)


class Column(NamedTuple):
    """One number that may change."""

    option: Candidate
    place: int  # of its parameter

    @property
    def label(self) -> str:
        """Its effect, place, and which of several numbers."""
        return self.option.label + (f" ({'xyz'[self.place]})" if self.place else "")


class Response(NamedTuple):
    """Errors of n windows with what both sides share, and how they change with each column."""

    error: np.ndarray  # (n, T, M)
    slope: np.ndarray  # (n, T, M) with the clock
    columns: tuple[Column, ...]
    change: np.ndarray  # (P, n, T, M) per unit of the column


def watched(data: Data, known: Sequence[Fixed], names: Sequence[str]) -> Watch:
    """Return the effects of these names that the robot can have, one variant at each place."""
    every = candidates(data)
    kept: dict[tuple[str, str | None], Candidate] = {}
    for option in every:
        if option.name in names:
            kept.setdefault((option.name, option.effect.where), option)
    stays = [one for one in known if one[0].composes or not _option(every, one)]
    moved = [one for one in known if one not in stays]
    shared = tuple(_option(every, one) for one in moved)
    for option in shared:
        if (option.name, option.effect.where) in kept:
            kept[option.name, option.effect.where] = option
    values = np.array([value for _, own in moved for value in own], float)
    alone = len(data.joints) == 1
    options = [o for o in kept.values() if not (alone and o.shared)]
    return Watch(tuple(options), shared, values, tuple(stays))


def errors(simulator: Simulator, watch: Watch, windows: np.ndarray) -> np.ndarray:
    """Return the errors of windows (n,) with what both sides have, (n, T, M)."""
    return _run(simulator, watch, windows).error


def _run(simulator: Simulator, watch: Watch, windows: np.ndarray) -> Simulated:
    effects = [member.effect for member in watch.shared]
    return simulator.run(effects, windows, np.tile(watch.values, (len(windows), 1)))


def respond(simulator: Simulator, watch: Watch, windows: np.ndarray) -> Response:
    """Simulate windows with what both sides have, and with each effect a little larger.

    Args:
        simulator: of the data, with what is fixed.
        watch: what may change.
        windows: those to look at, (n,).
    """
    effects, base = [member.effect for member in watch.shared], _run(simulator, watch, windows)
    columns, change = [], []
    groups: dict[str, list[Candidate]] = {}
    shared = {member.label for member in watch.shared}
    for option in watch.options:
        if option.label not in shared:
            groups.setdefault(option.group, []).append(option)
    own = base.error
    for part in groups.values():
        points, steps, told = _probes(watch, part, simulator.data.settings.compared.step)
        rows = simulator.run(
            [*effects, *(option.effect for option in part)],
            np.tile(windows, len(points)),
            np.repeat(points, len(windows), axis=0),
        ).error.reshape(len(points), *own.shape)
        change += [(error - own) / step for error, step in zip(rows, steps, strict=True)]
        columns += told
    start = 0
    for member in watch.shared:
        value = watch.values[start : start + len(member.neutral)]
        step = float(nudges([member], np.tile(value, (2, 1)))[0, 0])
        point = watch.values.copy()
        point[start] += step
        rows = simulator.run(effects, windows, np.tile(point, (len(windows), 1))).error
        change.append((rows - own) / step)
        columns.append(Column(member, 0))
        start += len(value)
    return Response(base.error, base.slope, tuple(columns), np.array(change))


def _probes(
    watch: Watch, part: Sequence[Candidate], small: float
) -> tuple[np.ndarray, list[float], list[Column]]:
    """Return points of all effects (K, P), the step of each, and what each is a step of.

    Args:
        watch: what both sides have.
        part: the effects.
        small: share of the smallest probe that is a step of what acts in proportion: a factor's
            straight line over a quarter of its value is another one than over some per cent. Play
            and the like have no smaller steps that say anything.
    """
    neutral = np.concatenate([watch.values, *(option.neutral for option in part)])
    points, steps, columns, start = [], [], [], len(watch.values)
    for option in part:
        sizes = np.abs(option.probes - option.neutral)
        count = len(option.neutral) if option.name in VECTORS else 1
        share = small if option.name in VECTORS or option.effect.how == "scale" else 1.0
        for place in range(count):
            along = np.flatnonzero(sizes[:, place] > 0)
            probe = option.probes[along[np.argmin(sizes[along, place])]]
            point = neutral.copy()
            point[start : start + len(probe)] = probe if count == 1 else option.neutral
            change = share * (probe[place] - option.neutral[place])
            point[start + place] = option.neutral[place] + change
            points.append(point)
            steps.append(float(change))
            columns.append(Column(option, place))
        start += len(option.neutral)
    return np.array(points), steps, columns


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
