"""Shares go to an end of their range unless being in between is worth it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.ends import at_ends, ended, shares
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm


@pytest.mark.parametrize(
    ("name", "free", "found"),
    [
        ("dead_zone", ("punch",), ["punch"]),
        ("dead_zone", (), []),
        ("load_dependent_friction", ("external",), ["external"]),
        ("cogging", ("count", "phase"), []),  # no end of a phase is another law
    ],
)
def test_shares_are_free_scalars_without_unit(
    name: str, free: tuple[str, ...], found: list[str]
) -> None:
    """A punch is one; a count has a unit, and what is a constant needs no end."""
    assert shares(make(name, where="a", free=free)) == found


@pytest.mark.parametrize(("punch", "stays"), [(0.0, False), (0.5, True)])
def test_a_share_goes_to_its_end_where_that_costs_nothing(
    punch: float, stays: bool, tmp_path: Path
) -> None:
    """A zone that is left from its edge is found with its width; a true half stays a half."""
    width = 0.06
    hidden = ("dead_zone", {"where": "a", "punch": punch}, width)
    data = arm.data_of(arm.make_log(hidden, noise=3e-4), tmp_path)
    (zone,) = (c for c in candidates(data) if c.label == "dead_zone.a")
    problem = Problem(data, Simulator(data, threads=1))
    search = Search(problem, [zone], 3e-4, np.random.default_rng(0), lambda text, share: None)
    values = np.tile([width + 0.003, 0.05] if not stays else [width, 0.5], (2, 1))
    start = Fit((zone,), values, np.zeros(2))
    found = at_ends(search, Found(start, problem.held_out((zone,), values)))
    (member,) = found.fit.members
    assert bool(member.effect.free) == stays
    if not stays:
        assert member.effect.extra["punch"] == 0.0
        assert member.label == zone.label and member.probes.shape[1] == 1
        assert found.fit.mean == pytest.approx([width], rel=0.02)


def test_a_held_scalar_is_no_parameter_any_more(tmp_path: Path) -> None:
    """Its column goes, the others stay in order."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    (rubs,) = (c for c in candidates(data) if c.label == "load_dependent_friction.a")
    held = ended(rubs, "external", 1.0)
    assert held.effect.extra["external"] == 1.0 and held.effect.free == ()
    assert len(held.neutral) == len(held.low) == len(held.high) == len(rubs.neutral) - 1
    assert rubs.effect.free == ("external",)  # the other one is as it was
