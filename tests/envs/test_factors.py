"""Factors around the model: their laws, their limits, and the masses that they make."""

import numpy as np
import pytest

from envs import HopperPolito, Simulation, make
from envs.errors import EffectError, ParameterError
from envs.factors import normal, uniform

MASSES = [make("link_mass", where=body, how="scale") for body in ("thigh", "leg", "foot")]


def test_a_uniform_factor_stays_within_its_width() -> None:
    """Ten thousand draws of width 0.5 fill [0.5, 1.5] evenly, each mass by itself."""
    tasks = uniform(MASSES, width=0.5)
    tasks.check(Simulation(HopperPolito(), effects=tasks.effects).space)
    drawn = tasks.sample(np.random.default_rng(0), 10_000)
    assert drawn.shape == (10_000, 3)
    assert 0.5 <= drawn.min() < 0.501 and 1.499 < drawn.max() <= 1.5
    np.testing.assert_allclose(drawn.std(axis=0), 1 / np.sqrt(12), rtol=0.02)
    assert abs(np.corrcoef(drawn.T) - np.eye(3)).max() < 0.03


def test_a_normal_factor_has_its_deviation() -> None:
    """Mean 1 and deviation 0.1, as in the study."""
    tasks = normal(MASSES, std=0.1)
    tasks.check(Simulation(HopperPolito(), effects=tasks.effects).space)
    drawn = tasks.sample(np.random.default_rng(0), 10_000)
    np.testing.assert_allclose(drawn.mean(axis=0), 1.0, atol=0.005)
    np.testing.assert_allclose(drawn.std(axis=0), 0.1, rtol=0.03)


def test_no_width_is_the_model_itself() -> None:
    """Width 0 leaves every mass, and so every step, to the last bit."""
    tasks = uniform(MASSES, width=0.0)
    randomized = Simulation(HopperPolito(), 2, effects=tasks.effects, threads=1)
    tasks.check(randomized.space)
    plain = Simulation(HopperPolito(), 2, threads=1)
    ids, seeds = np.arange(2), np.array([5, 6], np.uint64)
    values = tasks.sample(np.random.default_rng(0), 2)
    np.testing.assert_array_equal(
        randomized.reset(ids, values, seeds), plain.reset(ids, np.zeros((2, 0)), seeds)
    )
    for action in np.random.default_rng(1).uniform(-1, 1, (20, 2, 3)):
        one, other = randomized.step(None, action), plain.step(None, action)
        np.testing.assert_array_equal(one.observation, other.observation)


@pytest.mark.parametrize("width", [1.0, 1.2, -0.1, float("nan")])
def test_a_width_of_negative_masses_is_refused(width: float) -> None:
    """One sentence names the width, what it would draw, and what is allowed."""
    with pytest.raises(ParameterError, match=r"params\.width=.* from 0 to below 1"):
        uniform(MASSES, width=width)


def test_wide_normals_are_refused() -> None:
    """Six deviations of 0.2 reach a negative mass; the space says so."""
    tasks = normal(MASSES, std=0.2)
    with pytest.raises(ParameterError, match=r"draws reach \[-0\.2, 2\.2\]"):
        tasks.check(Simulation(HopperPolito(), effects=tasks.effects).space)


def test_only_what_scales_takes_a_factor() -> None:
    """A mass that is set would become a mass of about a kilogram."""
    with pytest.raises(ParameterError, match=r"how=set, but factors scale; set how: scale"):
        uniform([make("link_mass", where="leg", how="set")], width=0.1)


def test_effects_are_named_as_in_yaml() -> None:
    """A mapping with a standard name is that effect; a wrong one is refused with its place."""
    (draw,) = uniform([{"effect": "link_mass", "where": "leg", "how": "scale"}], width=0.5).draws
    assert (draw.effect.label(), draw.reach) == ("link_mass.leg", (0.5, 1.5))
    with pytest.raises(EffectError, match=r"^params.effects\[0\]: no effect 'mass'"):
        normal([{"effect": "mass"}], std=0.1)
