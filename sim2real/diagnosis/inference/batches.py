"""Simulations of several sets of effects, in as few batches as they fit into.

    for result in simulate_each(simulator, [Rows(members, windows, values), ...]): ...

Effects that are stepped from Python cost about as much for one row as for a hundred, so what is
simulated for several fits at a time shares a batch: a row has the effects of the others at their
neutral values, which changes no bit of it. Effects that add to the structure share one with their
own kind alone, and those that only write model fields are kept apart from stepped ones.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from envs.effects.base import RULES
from sim2real.diagnosis.data.simulate import Run, Simulated, Simulator, key_of
from sim2real.diagnosis.inference.candidates import Candidate


class Rows(NamedTuple):
    """Windows to be simulated under values of some effects."""

    members: tuple[Candidate, ...]
    windows: np.ndarray  # (R,) indices of windows
    values: np.ndarray  # (R, P) of the members' parameters, one after the other
    off: str = ""  # what all misremember at their start; see `Effect.memory`


class _Batch:
    """Rows of several sets side by side, with the effects of all of them."""

    def __init__(self, structure: tuple[Any, ...]) -> None:
        self.structure = structure
        self.members: dict[tuple[Any, ...], Candidate] = {}
        self.parts: list[tuple[int, Rows]] = []

    def takes(self, one: Rows) -> bool:
        """Return whether the set's effects stand in the same order here, with the same values.

        What adds to a field, or multiplies it, depends on what came before.
        """
        place = {key: number for number, key in enumerate(self.members)}
        labels = {m.effect.label(): m.effect.free for m in self.members.values()}
        if any(labels.get(m.effect.label(), m.effect.free) != m.effect.free for m in one.members):
            return False
        wanted = [place.get(_key(member), len(place)) for member in one.members]
        return wanted == sorted(wanted)

    def add(self, number: int, one: Rows) -> None:
        """Append the rows of a set."""
        self.parts.append((number, one))
        self.members |= {_key(m): m for m in one.members if _key(m) not in self.members}

    def run(self) -> Run:
        """Return all rows, what a set lacks at its neutral value."""
        members = list(self.members.values())
        ends = np.cumsum([len(m.neutral) for m in members], dtype=int)
        place = {
            k: np.arange(e - len(m.neutral), e)
            for (k, m), e in zip(self.members.items(), ends, strict=True)
        }
        neutral = np.concatenate([np.zeros(0), *(m.neutral for m in members)])
        values = []
        for _, one in self.parts:
            own = np.tile(neutral, (len(one.windows), 1))
            own[:, np.concatenate([np.zeros(0, int), *(place[_key(m)] for m in one.members)])] = (
                one.values
            )
            values.append(own)
        windows = np.concatenate([one.windows for _, one in self.parts])
        off = np.repeat([one.off for _, one in self.parts], [len(v) for v in values])
        return Run(tuple(m.effect for m in members), windows, np.concatenate(values), off)


def simulate_each(simulator: Simulator, sets: Sequence[Rows]) -> list[Simulated]:
    """Simulate several sets of rows, and return what each came to."""
    batches: list[_Batch] = []
    for number, one in enumerate(sets):
        structure = _structure(one.members)
        fits = (b for b in batches if b.structure == structure and b.takes(one))
        batch = next(fits, None)
        if batch is None:
            batches.append(batch := _Batch(structure))
        batch.add(number, one)
    results: dict[int, Simulated] = {}
    found = simulator.run_each([batch.run() for batch in batches])
    for batch, every in zip(batches, found, strict=True):
        start = 0
        for number, one in batch.parts:
            own = slice(start, start := start + len(one.windows))
            results[number] = Simulated(*(part[own] for part in every))
    return [results[number] for number in range(len(sets))]


def _key(member: Candidate) -> tuple[Any, ...]:
    return key_of(member.effect)


def _structure(members: Sequence[Candidate]) -> tuple[Any, ...]:
    """Return what must be the same of sets in one batch: what adds to the model, and who steps."""
    added = tuple(_key(m) for m in members if m.adds_structure)
    return (any(m.group == RULES for m in members), *added)
