"""Intervals of values: how sure one is of a cause, and of how much it shares with another."""

from dataclasses import replace

import numpy as np
import pytest

from sim2real.diagnosis.inference.fit import Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.intervals import compute_intervals
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.inference.test_fit import case_of

FRICTION, NOISE = 0.05, 3e-3


def test_an_interval_says_what_an_equivalent_may_share(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Friction of another law may have made up part of it; that of another joint may not."""
    log = arm.make_log(("coulomb_friction", {"where": "b"}, FRICTION), noise=NOISE, seconds=6.0)
    case = case_of(log, tmp_path_factory)
    case.fitter.settings = replace(case.fitter.settings, law=0.0)
    own = Hypothesis((case.options["coulomb_friction.b"],))
    (fit,) = case.fitter.fit([Start(own, np.array([[FRICTION]]))], rounds=2)
    widths = []
    for labels in ([], ["viscous_friction.b"], ["viscous_friction.a"]):
        others = [case.options[label] for label in labels]
        (ends,), _ = compute_intervals(case.fitter, fit, others)
        assert ends[0] < FRICTION < ends[1]
        widths.append(np.ptp(ends))
    alone, shared, apart = widths
    assert shared > 1.2 * alone
    assert apart == pytest.approx(alone, rel=0.01)


def test_what_cannot_join_an_explanation_shares_nothing(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """A servo has one dead zone: an equivalent of another cause may be that of all servos."""
    case = case_of(arm.make_log(noise=NOISE, seconds=4.0), tmp_path_factory)
    one, shared = (case.options[label] for label in ("dead_zone.b", "dead_zone"))
    start = Start(Hypothesis((one,)), np.array([[0.01]]))
    (fit,) = case.fitter.fit([start], rounds=0)
    alone, both = (compute_intervals(case.fitter, fit, others)[0] for others in ([], [shared]))
    np.testing.assert_array_equal(both, alone)
