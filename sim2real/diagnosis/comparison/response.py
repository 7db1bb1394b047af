"""What is wrong with the windows, and how it would change with each effect that is watched.

watch = watched(data, known, ("coulomb_friction", "backlash"))
response = respond(Simulator(data, watch.fixed), watch, windows)
response.error, response.change                     # (n, T, M), (P, n, T, M)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from envs.effects import Effect
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
FRICTION = {"coulomb_friction": "dof_frictionloss", "viscous_friction": "dof_damping"}  # its fields


class Watch(NamedTuple):
    """What may change, and what both sides have."""

    options: tuple[Candidate, ...]  # effects that may change
    shared: Mapping[str, tuple[Candidate, np.ndarray]]  # of both sides, with its values, by label
    fixed: tuple[Fixed, ...]  # effects of both sides that are part of the model

    def having(self, option: Candidate, values: np.ndarray) -> Watch:
        """Return the watch with a shared effect more, or with other values of it."""
        return self._replace(shared={**self.shared, option.label: (option, values)})

    def moved(self, column: Column, change: float) -> Watch:
        """Return the watch with a number of an effect changed, within its range."""
        option, place = column.option, column.place
        values = self.shared.get(option.label, (option, option.neutral))[1].copy()
        values[place] = np.clip(values[place] + change, option.low[place], option.high[place])
        return self.having(option, values)

    @property
    def both(self) -> list[tuple[Effect, str | None, np.ndarray | Sequence[float]]]:
        """What both sides have in addition to the model's: effects, places and values."""
        fixed = [(effect, effect.where, values) for effect, values in self.fixed]
        return [*fixed, *((own.effect, own.place, values) for own, values in self.shared.values())]

    @property
    def values(self) -> np.ndarray:
        """Those of the shared effects, one after the other, (P,)."""
        return np.concatenate([np.zeros(0), *(values for _, values in self.shared.values())])

    def at(self, values: np.ndarray) -> Watch:
        """Return the watch with other values of all shared effects, (P,)."""
        ends = np.cumsum([len(own) for _, own in self.shared.values()], dtype=int)
        moved = zip(self.shared.items(), np.split(values, ends)[:-1], strict=True)
        return self._replace(shared={label: (option, own) for (label, (option, _)), own in moved})

    def rows(self, windows: np.ndarray) -> Rows:
        """Return windows (n,) to be simulated with what both sides have."""
        members = tuple(option for option, _ in self.shared.values())
        return Rows(members, windows, np.tile(self.values, (len(windows), 1)))


class Column(NamedTuple):
    """One number that may change."""

    option: Candidate
    place: int  # of its parameter

    @property
    def label(self) -> str:
        """Its effect, place, and which of several numbers."""
        return self.option.label + (f" ({'xyz'[self.place]})" if self.place else "")

    @property
    def reach(self) -> tuple[float, float]:
        """Smallest and largest change from neutral."""
        own = self.option
        return tuple((end - own.neutral)[self.place] for end in (own.low, own.high))

    @property
    def typical(self) -> float:
        """Size of a typical change."""
        return float(self.option.step[self.place])

    @property
    def largest(self) -> float:
        """Size of the largest change that a diagnosis looks at."""
        return self.typical / TYPICAL


class Response(NamedTuple):
    """Errors of n windows with what both sides share, and how they change with each column."""

    error: np.ndarray  # (n, T, M)
    slope: np.ndarray  # (n, T, M) with the clock
    columns: tuple[Column, ...]
    change: np.ndarray  # (P, n, T, M) per unit of the column
    parts: Mapping[int, Parts] = MappingProxyType({})  # of columns that are made of others

    def values(self, columns: Sequence[int]) -> np.ndarray:
        """Return the changes of columns, (k,), whose straight lines together leave least."""
        lines = self.change[columns].reshape(len(columns), self.error.size)
        found, *_ = np.linalg.lstsq(lines.T, -self.error.reshape(-1), rcond=None)
        return found

    def lines(self, columns: Sequence[int]) -> dict[int, float]:
        """Return these changes by column, each within the range of an effect that is absent."""
        own = zip(columns, self.values(columns), strict=True)
        return {k: float(np.clip(value, *self.columns[k].reach)) for k, value in own}

    def along(self, changes: Mapping[int, float]) -> np.ndarray:
        """Return the errors (n, T, M) that straight lines leave."""
        return self.error + sum(value * self.change[k] for k, value in changes.items())

    def moved(self, watch: Watch, changes: Mapping[int, float]) -> Watch:
        """Return a watch with columns changed, each within its range."""
        for k, change in changes.items():
            for part, share in self.parts.get(k, ((k, 1.0),)):
                watch = watch.moved(self.columns[part], share * change)
        return watch


Parts = tuple[tuple[int, float], ...]  # each column, and how much of it


def is_friction(option: Candidate) -> bool:
    """Return whether an effect is the friction of a single joint."""
    return option.name in FRICTION and not option.shared


def watched(data: Data, known: Sequence[Fixed], names: Sequence[str]) -> Watch:
    """Return the effects of these names that the robot can have, one variant at each place."""
    kept: dict[tuple[str, str | None], Candidate] = {}
    variants: dict[tuple[str, str | None, str | None, int], Candidate] = {}
    for option in candidates(data):
        own = option.effect
        variants.setdefault((own.name, own.where, own.side, len(option.neutral)), option)
        if option.name in names and not (option.shared and len(data.joints) == 1):
            kept.setdefault((own.name, own.where), option)
    watch = Watch((), {}, ())
    for effect, values in known:
        option = variants.get((effect.name, effect.where, effect.side, len(values)))
        if option is None or effect.composes:
            watch = watch._replace(fixed=(*watch.fixed, (effect, values)))
        else:
            watch = watch.having(option, np.array(values, float))
            if (effect.name, effect.where) in kept:
                kept[effect.name, effect.where] = option
    return watch._replace(options=tuple(kept.values()))


def errors(simulator: Simulator, watch: Watch, windows: np.ndarray) -> np.ndarray:
    """Return the errors of windows (n,) with what both sides have, (n, T, M)."""
    return simulate_each(simulator, [watch.rows(windows)])[0].error


def respond(simulator: Simulator, watch: Watch, windows: np.ndarray) -> Response:
    """Simulate windows (n,) with what both sides have, and with each effect a little larger."""
    probes = list(_probes(watch))
    sets = [watch, *(moved for _, _, moved in probes)]
    base, *made = simulate_each(simulator, [one.rows(windows) for one in sets])
    change = [
        (one.error - base.error) / step for one, (_, step, _) in zip(made, probes, strict=True)
    ]
    columns = tuple(column for column, _, _ in probes)
    return Response(base.error, base.slope, columns, np.array(change))


_Probe = tuple[Column, float, Watch]  # a number that is moved, by how much, and the watch with it


def _probes(watch: Watch) -> Iterator[_Probe]:
    """Yield how each number of an effect is moved: as far as a fit moves it.

    An absent factor or tilt is moved as one of typical size is: by some per cent, as it changes.
    Play and the like say nothing below their smallest probe.
    """
    shared = [option.effect for option, _ in watch.shared.values()]
    for option in watch.options:
        if option.label in watch.shared or any(in_the_way(one, option.effect) for one in shared):
            continue
        if option.name in VECTORS or option.effect.how == "scale":
            steps = get_nudges((option,), option.neutral + option.step)
            yield from _nudged(watch, option, option.neutral, steps)
        else:
            sizes = np.abs(option.probes - option.neutral)[:, 0]
            probe = option.probes[np.argmin(np.where(sizes > 0, sizes, np.inf))]
            step = float(probe[0] - option.neutral[0])
            yield Column(option, 0), step, watch.having(option, np.array(probe, float))
    for option, values in watch.shared.values():
        yield from _nudged(watch, option, values, get_nudges((option,), values))


def _nudged(
    watch: Watch, option: Candidate, values: np.ndarray, steps: np.ndarray
) -> Iterator[_Probe]:
    """Yield each number of an effect, or the first one that says its size, moved by its step."""
    for place in range(len(steps) if option.name in VECTORS else 1):
        point = values.copy()
        point[place] += steps[place]
        yield Column(option, place), float(steps[place]), watch.having(option, point)
