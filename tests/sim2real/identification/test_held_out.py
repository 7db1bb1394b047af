"""What is held out, and how wide the band of draws is: against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from envs.distribution import Distribution, Entry
from envs.effects import make
from envs.marginals import Marginal
from sim2real.identification.held_out import crps, inflate_noise, score_held_out
from sim2real.identification.settings import DEFAULT
from tests.sim2real.identification.linear import Linear


def narrow(noise: float, std: float = 1e-6) -> Distribution:
    """Return a distribution at the truth of `linear`, as good as a point unless `std` says else."""
    entries = tuple(
        Entry(make(name, where="hinge"), (Marginal("normal", mean, std, -5.0, 5.0),))
        for name, mean in (("armature", 1.0), ("viscous_friction", -2.0))
    )
    return Distribution(entries, noise={"hinge": noise})


def linear(noise: float, episodes: int = 12, seed: int = 0) -> Linear:
    """Return a system of one robot; the parameters cannot say its noise."""
    rng = np.random.default_rng(seed)
    return Linear(np.tile([1.0, -2.0], (episodes, 1)), noise, rng, rows=400)


def test_noise_grows_to_what_the_draws_lack() -> None:
    """The errors of a point are normal with 0.3: so is the noise that holds nine tenths of them."""
    found = inflate_noise(linear(0.3), narrow(0.01), np.random.default_rng(0))
    assert found.noise["hinge"] == pytest.approx(0.3, rel=0.1)
    judged = score_held_out(linear(0.3, seed=5), found, np.random.default_rng(1))
    assert judged.coverage == pytest.approx(0.9, abs=0.02)
    assert judged.crps == pytest.approx(judged.absolute / np.sqrt(2), rel=0.03)  # of a normal law


def test_noise_never_shrinks() -> None:
    """Draws that are wide enough, or noise that is there, are left as they are."""
    assert inflate_noise(linear(0.3), narrow(0.8), np.random.default_rng(0)).noise == {"hinge": 0.8}
    wide = inflate_noise(linear(0.3), narrow(0.01, std=0.6), np.random.default_rng(0))
    assert wide.noise["hinge"] < 0.1


def test_few_readings_are_looked_at_where_there_are_many() -> None:
    """A setting says how many; the answer is about the same."""
    settings = replace(DEFAULT, compared=1000)
    found = inflate_noise(linear(0.3), narrow(0.01), np.random.default_rng(0), settings)
    assert found.noise["hinge"] == pytest.approx(0.3, rel=0.2)


@pytest.mark.parametrize(("episodes", "count"), [(4, 1), (8, 2), (13, 3)])
def test_a_quarter_of_the_episodes_is_held_out(episodes: int, count: int) -> None:
    """Whole ones, the same each time, and not every fourth in turn: names may take turns, too."""
    made = linear(0.1, episodes)
    fitted, held = made.split()
    assert held.episodes == count and fitted.episodes == episodes - count
    assert np.array_equal(held.chosen, made.split()[1].chosen)
    assert not set(held.chosen) & set(fitted.chosen)
    if episodes == 13:
        assert held.chosen.tolist() != [3, 7, 11]


def test_the_score_of_an_ensemble() -> None:
    """Of one member its absolute error; of two, |x|/2 + |y|/2 - |x - y|/4."""
    assert crps(np.array([[0.3, -0.5]])) == pytest.approx(0.4)
    assert crps(np.array([[1.0], [-2.0]])) == pytest.approx(1.5 - 3 / 4)
