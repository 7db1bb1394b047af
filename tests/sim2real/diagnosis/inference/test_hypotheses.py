"""What values of a hypothesis can physically be."""

from pathlib import Path

import numpy as np

from sim2real.diagnosis.inference.candidates import candidates
from sim2real.diagnosis.inference.hypotheses import Hypothesis, get_size
from tests.sim2real.diagnosis import arm

REACH = 20.0


def test_a_shape_may_lie_at_the_ends_of_its_range_and_a_size_may_not(tmp_path: Path) -> None:
    """A dead zone beyond which the whole error counts is a law; one of forty probes is none."""
    data = arm.data_of(arm.make_log(noise=3e-4), tmp_path)
    (zone,) = [one for one in candidates(data) if one.label == "dead_zone.b"]
    low, high = Hypothesis((zone,)).bounded(REACH)
    assert list(zone.effect.free) == ["punch"] and (zone.low[1], zone.high[1]) == (0.0, 1.0)
    assert low[1] < zone.low[1] and high[1] > zone.high[1]
    far = zone.neutral[0] + REACH * get_size(zone)[0]
    np.testing.assert_allclose(high[0], min(zone.high[0], far))
    np.testing.assert_allclose(low[0], max(zone.low[0], -far))


def test_what_no_slope_leads_to_has_values_nearby(tmp_path: Path) -> None:
    """The shape of a force that jumps is one of two laws, and free to follow nothing."""
    data = arm.data_of(arm.make_log(noise=3e-4), tmp_path)
    options = {one.label: one for one in candidates(data)}
    both = Hypothesis((options["coulomb_friction.b"], options["dead_zone.b"]))
    assert both.smooth.tolist() == [True, True, False] and both.burden == (2, 0)
    assert both.needs_short_steps and not Hypothesis(both.members[:1]).needs_short_steps
    near = both.list_near(np.tile([0.1, 0.05, 1.0], (2, 1)))
    found = sorted(tuple(one[0].round(6)) for one in near)
    edges = [(0.1, edge, 1.0) for edge in (0.04, 0.0475, 0.0525, 0.06)]
    assert found == sorted([*edges, (0.1, 0.05, 0.0)])


def test_a_wave_is_fitted_by_its_cosine_and_its_sine_part(tmp_path: Path) -> None:
    """There and back, within bounds; a mean across half a turn is no wave of the opposite phase."""
    data = arm.data_of(arm.make_log(noise=3e-4), tmp_path)
    options = {one.label: one for one in candidates(data)}
    both = Hypothesis((options["coulomb_friction.b"], options["encoder_eccentricity.b"]))
    assert both.waves == [(1, 2)]
    values = np.array([[0.1, 0.05, 3.1], [0.3, 0.05, -2.5]])
    linear = both.to_linear(values)
    np.testing.assert_allclose(linear[1], [0.3, 0.05 * np.cos(-2.5), 0.05 * np.sin(-2.5)])
    np.testing.assert_allclose(both.from_linear(linear), values)
    np.testing.assert_allclose(both.from_linear(np.array([0.1, 0.0, -2.0])), [0.1, 0.9, -np.pi / 2])
    near = both.to_linear(np.array([[0.1, 0.05, 3.1], [0.3, 0.05, 3.1 - 2 * np.pi]]))
    np.testing.assert_allclose(both.from_linear(near.mean(axis=0)), [0.2, 0.05, 3.1])
