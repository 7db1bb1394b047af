"""Causes change places, and go, while something does better beside the others."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim2real.diagnosis.attribution.contenders import Contender, Found, Raced
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.looking_back import look_back
from sim2real.diagnosis.settings import DEFAULT

LEAST = 1.0  # a gain that counts, in the table's units
Sizes = Mapping[str, float]


class Table:
    """A search whose errors stand in a table, by the letters of who is in the model."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = {frozenset(names): size for names, size in sizes.items()}
        letters = sorted(set().union(*self.sizes))
        self.options: dict[str, Any] = {
            one: SimpleNamespace(
                label=one, name=one, effect=SimpleNamespace(where=None), neutral=np.zeros(1)
            )
            for one in letters
        }
        self.blocks: Any = SimpleNamespace(rms=lambda error: float(error))
        self.settings, self.witnessed = DEFAULT.search, frozenset()
        self.problem: Any = SimpleNamespace(data=SimpleNamespace(settings=DEFAULT))
        self.floor, self.races = 0.0, []

    def fit(self, names: str) -> Fit:
        """Return a fit of some letters."""
        members = tuple(self.options[one] for one in names)
        return Fit(members, np.zeros((2, len(names))), np.zeros(2))

    def error(self, fit: Fit) -> np.ndarray:
        """Return what a fit leaves."""
        return np.array(self.sizes[frozenset(m.label for m in fit.members)])

    def found(self, names: str) -> Found:
        """Return letters as found."""
        fit = self.fit(names)
        return Found(fit, self.error(fit))

    def keep(self, found: Found, fit: Fit, error: np.ndarray) -> None:
        """Let a fit be the best."""
        found.fit, found.error = fit, error

    def joins(self, best: Contender, found: Found, contenders: list[Contender]) -> bool:
        """Return whether it gains enough."""
        assert best in contenders
        return float(found.error) - float(best.error) > LEAST

    def polish(self, best: Contender) -> Contender:
        """Return the winner as it is."""
        return best

    def place_of(self, own: Contender) -> Raced:
        """Return who stands in the table beside the others; races are counted."""
        rest = "".join(m.label for m in own.fit.members if m is not own.candidate)
        self.races.append(rest)
        made = [
            Contender(self.options[one], self.fit(rest + one), np.array(size))
            for one in self.options
            if one not in rest and (size := self.sizes.get(frozenset(rest + one))) is not None
        ]
        fit = self.fit(rest)
        return Raced(fit, self.error(fit), sorted(made, key=lambda c: float(c.error)))


def looked(sizes: Sizes, names: str) -> tuple[str, Table, Found]:
    """Return the letters that stay of some that were found, the table, and what was found."""
    table = Table(sizes)
    found = table.found(names)
    look_back(table, found)
    return "".join(sorted(m.label for m in found.fit.members)), table, found


def test_the_exchange_that_closes_most_is_made_first() -> None:
    """A delay (d) and a wrong limit (k): a drifting clock (c) fits beside that limit only.

    The first member that finds anybody better must not take it before the others were looked at.
    """
    alone = {"d": 60.0, "k": 70.0, "c": 65.0, "v": 80.0}
    sizes = {"": 100.0, **alone, "dk": 15.0, "ck": 14.9, "dv": 2.0, "ct": 14.0, "cv": 30.0}
    kept, table, found = looked({**sizes, "t": 75.0, "dt": 20.0}, "dk")
    assert kept == "dv"
    assert float(found.error) == 2.0
    assert set(found.rivals) == {"d", "v"}
    assert [c.candidate.label for c in found.rivals["v"]][:2] == ["v", "k"]
    assert sorted(table.races) == ["d", "k", "v"]  # none is run twice beside the same others


def test_who_is_worth_nothing_goes() -> None:
    """Then the others are looked at again without it; the last one stays."""
    sizes = {"": 100.0, "a": 10.0, "b": 50.0, "c": 60.0, "ab": 9.5, "ac": 9.0, "bc": 45.0}
    kept, _, found = looked({**sizes, "abc": 8.8}, "abc")
    assert kept == "a"
    assert float(found.error) == 10.0


def test_nothing_better_changes_nothing() -> None:
    """Each place is looked at once, and its contenders are told."""
    sizes = {"": 100.0, "a": 50.0, "b": 50.0, "ab": 2.0, "ac": 20.0, "bc": 30.0, "c": 70.0}
    kept, table, found = looked(sizes, "ab")
    assert (kept, len(table.races)) == ("ab", 2)
    assert [c.candidate.label for c in found.rivals["b"]] == ["b", "c"]


@pytest.mark.parametrize("most", [0, 1])
def test_exchanges_are_bounded(most: int) -> None:
    """A setting says how many are made."""
    sizes = {"": 100.0, "ab": 9.0, "ac": 8.0, "cd": 5.0, **dict.fromkeys("abcd", 50.0), "bd": 40.0}
    table = Table(sizes)
    table.settings = type(DEFAULT.search)(exchanges=most)
    found = table.found("ab")
    look_back(table, found)
    assert float(found.error) == (9.0, 8.0)[most]
