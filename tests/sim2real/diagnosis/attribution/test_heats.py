"""Heats of a race, against the same race simulated as it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.contenders import Contender
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.heats import ahead
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis import arm

TRUTH = (("coulomb_friction", {"where": "a"}, 0.1), ("position_gain", {"where": "b"}, 0.7))
LABELS = (
    "coulomb_friction.a", "stribeck_friction.a", "viscous_friction.a", "position_gain.b",
    "motor_strength.b", "armature.b", "command_delay",
)  # fmt: skip
NOISE = 3e-4


def search_of(folder: Path, exact: bool = False) -> Search:
    """Return a search among a few candidates; an exact one races as it is, and drops nobody."""
    data = arm.data_of(arm.make_log(*TRUTH, noise=NOISE), folder)
    own = DEFAULT.search
    limits = replace(own, lagging=-np.inf, judged=2.0) if exact else own
    trusted = replace(DEFAULT.fitting, trusted=np.inf, still=-1.0, timing_s=1e9)
    settings = replace(DEFAULT, search=limits, fitting=trusted if exact else DEFAULT.fitting)
    data = replace(data, settings=settings)
    options = [option for option in candidates(data) if option.label in LABELS]
    problem = Problem(data, Simulator(data, threads=1))
    rng = np.random.default_rng(0)
    search = Search(problem, options, NOISE, rng, lambda text, share: None)
    search.coarse = None if exact else search.coarse
    return search


@pytest.mark.slow
def test_a_race_ends_as_one_that_is_simulated_in_full(tmp_path: Path) -> None:
    """The same one wins with the same values, for less; whoever is judged has the same errors."""
    fast, full = search_of(tmp_path), search_of(tmp_path, exact=True)
    assert fast.coarse is not None
    one, other = (search.race(search.none, search.base) for search in (fast, full))
    assert fast.work.steps["race"] < 0.8 * full.work.steps["race"]
    assert one[0].candidate.label == other[0].candidate.label
    assert one[0].fit.mean == pytest.approx(other[0].fit.mean, rel=0.02)
    told = {c.candidate.label: fast.blocks.rms(c.error) for c in other}
    for contender in one:
        if contender.candidate.label in told:
            least = told[contender.candidate.label]
            assert fast.blocks.rms(contender.error) == pytest.approx(least, rel=0.03)


@pytest.mark.slow
def test_looking_back_takes_races_that_were_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last one that joined has raced beside the others: nothing is simulated again."""
    search = search_of(tmp_path)
    monkeypatch.setattr(search, "pair", lambda found: None)  # which would put both in at once
    found = search.ahead(2)
    last = found.fit.members[-1]
    own = Contender(last, found.fit, found.error)
    before = search.work.total
    rest, error, raced = search.place_of(own)
    assert search.work.total == before
    again = search.without(found.fit, last)
    assert rest.mean == pytest.approx(again.mean, rel=0.01)
    anew = search.problem.held_out(again.members, again.values)
    assert search.blocks.rms(error) == pytest.approx(search.blocks.rms(anew), rel=0.01)
    contenders = search.race(again, anew, replacing=own)
    known = {c.candidate.label for c in raced}
    missed = [c for c in contenders if c.candidate.label not in known]
    assert last.label in known
    assert all(search.blocks.rms(c.error) > search.blocks.rms(own.error) for c in missed)


def test_who_closes_next_to_nothing_does_not_go_on(tmp_path: Path) -> None:
    """Only where another one closes most of the gap, be it the one whose place is raced for."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    problem = Problem(data, Simulator(data, threads=1))
    error = np.ones((len(data.windows), *data.measured.shape[1:])) * data.mask[..., None]

    def fits(*sizes: float) -> list[Fit]:
        return [Fit((), np.zeros((2, 0)), np.full(2, size**2)) for size in sizes]

    def kept(sizes: tuple[float, ...], against: float | None = None) -> int:
        known = None if against is None else against * error
        return len(ahead(fits(*sizes), problem, error, 0.25, known))

    assert kept((0.1, 0.7, 0.9)) == 2
    assert kept((0.8, 0.9, 0.99)) == 3
    assert kept((0.8, 0.9, 0.99), against=0.1) == 0
    assert kept((0.5, 0.9), against=0.1) == 1
