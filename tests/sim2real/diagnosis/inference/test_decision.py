"""What each verdict asks for."""

import numpy as np
import pytest

from sim2real.diagnosis.inference.decision import Standing, compute_posterior, decide_verdict
from sim2real.diagnosis.inference.score import Gain
from sim2real.diagnosis.settings.inference import Inference

SETTINGS = Inference()
TOLERANCE = SETTINGS.equivalence_tolerance
NOTHING = Gain(0.0, -0.01, 0.01)
SURE, UNSURE = Gain(500.0, 300.0, 700.0), Gain(500.0, -20.0, 900.0)


def test_nothing_left_of_the_model_as_given_is_no_gap() -> None:
    """And a log that is too weak to tell is not."""
    assert decide_verdict(Standing(0, NOTHING), SETTINGS) == "no_gap"
    weak = Gain(0.0, -2 * TOLERANCE, 2 * TOLERANCE)  # not significant: that proves nothing
    assert decide_verdict(Standing(0, weak), SETTINGS) == "unexplained"


def test_explained_asks_for_equivalence_nulls_bounds_and_replays() -> None:
    """Each of them alone takes it away."""
    full = Standing(1, NOTHING, [SURE, SURE])
    assert decide_verdict(full, SETTINGS) == "explained"
    for change in (
        {"left": Gain(0.1, 0.0, 1.01 * TOLERANCE)},
        {"inside": False},
        {"replays": False},
        {"closes": 0.49},
        {"alone": False},
    ):
        assert decide_verdict(full._replace(**change), SETTINGS) == "partly_explained"
    assert decide_verdict(full._replace(over=[SURE, UNSURE]), SETTINGS) == "unexplained"


def test_a_part_is_explained_only_if_the_simulation_comes_nearer() -> None:
    """What shaves a quiet joint while the error grows explains nothing."""
    part = Standing(2, Gain(1.0, 0.8, 1.2), [SURE])
    assert decide_verdict(part, SETTINGS) == "partly_explained"
    assert decide_verdict(part._replace(closes=-0.1), SETTINGS) == "unexplained"


def test_the_posterior_knows_of_laws_that_are_not_in_the_vocabulary() -> None:
    """They are as probable as their share of the gap; where nothing is left, the best one is."""
    sure, unknown = compute_posterior([1.0, 0.2], [1, 1], 0.0, SETTINGS)
    assert sure[0] > 0.95
    assert unknown == 0.0
    lost, unknown = compute_posterior([1.0, 0.2], [1, 1], 3.0, SETTINGS)
    assert unknown == pytest.approx(0.75)
    assert lost.sum() + unknown == pytest.approx(1.0)


def test_equals_share_the_posterior_and_a_needless_member_loses_it() -> None:
    """Two that predict alike get the same; a longer one pays for its member."""
    chances, unknown = compute_posterior([1.0, 1.0, 1.01], [1, 1, 2], 0.0, SETTINGS)
    assert chances[0] == pytest.approx(chances[1])
    assert chances[2] < 0.05
    assert np.isfinite(unknown)
