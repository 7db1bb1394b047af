"""What each verdict asks for."""

import math

import numpy as np
import pytest

from sim2real.diagnosis.inference.decision import (
    Left,
    Standing,
    compute_posterior,
    compute_price,
    decide_verdict,
)
from sim2real.diagnosis.inference.score import Gain
from sim2real.diagnosis.settings.inference import Inference

SETTINGS = Inference()
TOLERANCE = SETTINGS.equivalence_tolerance
NONE = Gain(0.0, -0.01, 0.01)
NOTHING = Left(NONE, NONE)
SURE, UNSURE = Gain(500.0, 300.0, 700.0), Gain(500.0, -20.0, 900.0)


def test_nothing_left_of_the_model_as_given_is_no_gap() -> None:
    """And a log that is too weak to tell is not."""
    assert decide_verdict(Standing(0, NOTHING), SETTINGS) == "no_gap"
    weak = Gain(0.0, -2 * TOLERANCE, 2 * TOLERANCE)  # not significant: that proves nothing
    for left in (NOTHING._replace(worst=weak), NOTHING._replace(usual=False)):
        assert decide_verdict(Standing(0, left), SETTINGS) == "unexplained"


def test_explained_asks_for_equivalence_nulls_bounds_and_replays() -> None:
    """Each of them alone takes it away."""
    full = Standing(1, NOTHING, [SURE, SURE])
    assert decide_verdict(full, SETTINGS) == "explained"
    for change in (
        {"left": NOTHING._replace(worst=Gain(0.1, 0.0, 1.01 * TOLERANCE))},
        {"left": NOTHING._replace(closes=0.49)},
        {"left": NOTHING._replace(usual=False)},
        {"inside": False},
        {"replays": False},
        {"alone": False},
    ):
        assert decide_verdict(full._replace(**change), SETTINGS) == "partly_explained"
    assert decide_verdict(full._replace(over=[SURE, UNSURE]), SETTINGS) == "unexplained"


def test_a_part_is_explained_only_if_the_simulation_comes_nearer() -> None:
    """What shaves a quiet joint while the error grows explains nothing."""
    left = NOTHING._replace(worst=Gain(1.0, 0.8, 1.2))
    part = Standing(2, left, [SURE])
    assert decide_verdict(part, SETTINGS) == "partly_explained"
    worse = part._replace(left=left._replace(closes=-0.1))
    assert decide_verdict(worse, SETTINGS) == "unexplained"


def test_the_posterior_knows_of_laws_that_are_not_in_the_vocabulary() -> None:
    """Their odds are those of what is left, times their prior odds; none where nothing is left."""
    sure, unknown = compute_posterior([1.0, 0.2], [0.3, 0.3], 0.0, SETTINGS)
    assert sure[0] > 0.95
    assert unknown == 0.0
    lost, unknown = compute_posterior([1.0, 0.2], [0.3, 0.3], 3.0, SETTINGS)
    assert unknown / (1 - unknown) == pytest.approx(3.0 * SETTINGS.unlisted)
    assert lost.sum() + unknown == pytest.approx(1.0)


def test_equals_share_the_posterior_and_a_needless_member_loses_it() -> None:
    """Two that predict alike get the same; a longer one pays for its member."""
    chances, unknown = compute_posterior([1.0, 1.0, 1.01], [0.3, 0.3, 0.6], 0.0, SETTINGS)
    assert chances[0] == pytest.approx(chances[1])
    assert chances[2] < 0.05
    assert np.isfinite(unknown)


def test_a_cause_has_to_beat_the_best_of_as_many_that_do_nothing() -> None:
    """Bonferroni: of gains of chance [evidence] the best passes its price with that level."""
    rng, count, level = np.random.default_rng(0), 150, SETTINGS.level
    price = compute_price(1, 0, count, SETTINGS) / SETTINGS.temperature
    assert price == pytest.approx(math.log(count / level))
    best = rng.exponential(size=(4000, count)).max(axis=1)  # P(log odds > x) <= exp(-x)
    assert np.mean(best > price) == pytest.approx(level, abs=0.015)


def test_a_value_costs_half_the_log_of_the_evidence() -> None:
    """As in Schwarz's criterion, one piece of evidence being a temperature's nats a reading."""
    one = compute_price(1, 1, 10, SETTINGS)
    none = compute_price(1, 0, 10, SETTINGS)
    worth = math.log(1 / SETTINGS.temperature) / 2
    assert (one - none) / SETTINGS.temperature == pytest.approx(worth)
    both = compute_price(2, 1, 10, SETTINGS)
    assert both == pytest.approx(one + none)
