"""A finding says why causes that close a gap do not explain it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.attribution import judge
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.conclude import conclude
from sim2real.diagnosis.attribution.doubts import doubts
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.attribution.test_equivalents import FLOOR, search_of


def test_a_pair_that_acts_like_another_law_is_told_with_what_parts_it(tmp_path: Path) -> None:
    """The joint, both effects, the law that may be there, and an experiment for each."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    every = {option.label: option for option in candidates(data)}
    falling, rising = every["stribeck_friction.a"], every["viscous_friction.a"]
    (told,) = doubts([rising, falling], frozenset())
    assert (told.check, told.where) == ("imitation", "a")
    for word in ("stribeck_friction and viscous_friction", "dry friction"):
        assert word in told.finding
    assert falling.effect.experiment in told.fix
    assert rising.effect.experiment in told.fix
    assert doubts([falling, every["position_gain.a"]], frozenset()) == []


def test_a_cause_without_a_witness_is_told(tmp_path: Path) -> None:
    """Unless a channel measured it."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    (clock,) = (option for option in candidates(data) if option.name == "clock_drift")
    (told,) = doubts([clock], frozenset())
    assert (told.check, told.where) == ("unwitnessed", None)
    assert doubts([clock], frozenset({("clock_drift", None)})) == []


@pytest.mark.slow
def test_what_imitates_a_withheld_effect_does_not_explain_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dry friction that may not be named: Stribeck's with viscous friction follows it."""
    log = arm.make_log(("coulomb_friction", {"where": "a"}, 0.15), noise=FLOOR)
    search = search_of(log, tmp_path, "stribeck_friction.a", "viscous_friction.a")
    found, floors = search.run(), np.full(2, FLOOR)
    made = conclude(search, found, floors, np.random.default_rng(0)).report
    assert {cause.effect for cause in made.causes} == {"stribeck_friction", "viscous_friction"}
    assert made.gap.closed is not None and made.gap.closed > 0.95
    assert made.verdict == "partly_explained"
    assert [finding.check for finding in made.preflight] == ["imitation"]
    monkeypatch.setattr(judge, "imitations", lambda members: [])
    assert conclude(search, found, floors, np.random.default_rng(0)).report.verdict == "explained"
