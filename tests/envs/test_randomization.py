"""Distributions of robots: their laws, and what is refused before work starts."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from envs.effects import make
from envs.errors import EffectError, ParameterError
from envs.params import ParamSpace
from envs.plant import Plant
from envs.randomization import Draw, Randomization
from envs.tasks import Hopper

MASS = make("link_mass", where="torso", how="set")
FRICTION = make("ground_friction")


def space(*effects: Any) -> ParamSpace:
    """Return the parameter space of a Hopper under these effects."""
    return Plant(Hopper().spec(), effects).space


def samples(draw: Draw, n: int = 5000) -> np.ndarray:
    """Draw n values of a Hopper's parameter, (n,)."""
    tasks = Randomization([draw])
    tasks.check(space(draw.effect))
    return tasks.sample(np.random.default_rng(0), n)[:, 0]


@pytest.mark.parametrize(
    ("draw", "law"),
    [
        (Draw(MASS, "uniform", low=1.0, high=9.0), stats.uniform(1.0, 8.0)),
        (Draw(MASS, "normal", mean=6.0, std=0.5), stats.norm(6.0, 0.5)),
        (
            Draw(MASS, "truncated_normal", mean=6.0, std=1.5, low=0.5, high=7.0),
            stats.truncnorm(-5.5 / 1.5, 1.0 / 1.5, loc=6.0, scale=1.5),
        ),
    ],
    ids=["uniform", "normal", "truncated_normal"],
)
def test_draws_follow_their_law(draw: Draw, law: Any) -> None:
    """A Kolmogorov-Smirnov test does not tell draws from their law, and tells them from another."""
    drawn = samples(draw)
    assert stats.kstest(drawn, law.cdf).pvalue > 0.01
    assert stats.kstest(drawn + 0.2 * law.std(), law.cdf).pvalue < 1e-6


def test_parameters_are_independent_and_in_order() -> None:
    """Columns follow the space's order, and one column does not tell of another."""
    tasks = Randomization([Draw(FRICTION, low=1.5, high=2.5), Draw(MASS, low=3.0, high=9.0)])
    world = space(*tasks.effects)
    tasks.check(world)
    values = tasks.sample(np.random.default_rng(0), 4000)
    assert world.names == ("ground_friction", "link_mass.torso")
    assert values[:, 0].max() <= 2.5
    assert values[:, 1].min() >= 3.0
    assert abs(np.corrcoef(values.T)[0, 1]) < 0.05


def test_the_generator_decides() -> None:
    """Equal generators draw equal values; no draw has another source of randomness."""
    draw = Draw(MASS, "truncated_normal", mean=6.0, std=1.5, low=0.5, high=9.5)
    np.testing.assert_array_equal(samples(draw, 50), samples(draw, 50))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"low": 9.0, "high": 1.0}, r"low=9 is above high=1; swap them"),
        ({"low": 1.0}, "uniform also needs high"),
        ({"distribution": "normal", "mean": 1.0}, "normal also needs std"),
        ({"distribution": "normal", "mean": 1.0, "std": 0.0}, "std=0 must be positive"),
        ({"distribution": "gauss", "low": 1.0, "high": 2.0}, "'gauss' is unknown.*uniform, normal"),
        ({"distribution": "unifrom", "low": 1, "high": 2}, r"did you mean 'uniform'"),
        ({"low": float("nan"), "high": 2.0}, "low=nan must be a finite number"),
        ({"low": 0.0, "high": float("inf")}, "high=inf must be a finite number"),
    ],
)
def test_a_wrong_draw_is_refused(arguments: dict[str, Any], message: str) -> None:
    """Each mistake is one sentence with the parameter's name."""
    with pytest.raises(ParameterError, match=f"link_mass.torso: .*{message}"):
        Draw(MASS, **arguments)


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (Draw(MASS, low=-1.0, high=9.0), r"reach \[-1, 9\] kg, outside .*narrow the range"),
        (Draw(MASS, "normal", mean=2.0, std=1.0), r"reach \[-4, 8\] kg, outside"),
    ],
)
def test_a_draw_that_could_leave_the_space_is_refused(draw: Draw, message: str) -> None:
    """A negative mass is refused before the first draw, whatever the law."""
    with pytest.raises(ParameterError, match=message):
        Randomization([draw]).check(space(MASS))


def test_spaces_must_fit() -> None:
    """Draws without their effect, effects without a draw and draws before a check are refused."""
    tasks = Randomization([Draw(MASS, low=1.0, high=2.0)])
    with pytest.raises(ParameterError, match="before drawing"):
        tasks.sample(np.random.default_rng(0), 1)
    with pytest.raises(ParameterError, match="made without it"):
        tasks.check(space(FRICTION))
    with pytest.raises(ParameterError, match=r"has ground_friction, but nothing.*params=NAME"):
        tasks.check(space(MASS, FRICTION))
    with pytest.raises(ParameterError, match=r"link_mass\.torso, link_mass\.torso repeat one"):
        Randomization([*tasks.draws, *tasks.draws]).check(space(MASS))
    with pytest.raises(ParameterError, match="per='episode' is unknown"):
        Randomization([], per="episode")  # type: ignore[arg-type]


def test_an_unknown_place_lists_the_names() -> None:
    """A body that the robot lacks is refused with the nearest name and all of them."""
    with pytest.raises(
        EffectError, match=r"'torsoo'.*did you mean 'torso'.*torso, thigh, leg, foot"
    ):
        space(make("link_mass", where="torsoo"))


def test_a_mapping_is_the_draw_that_it_names() -> None:
    """Standard name, arguments of the effect and law lie side by side, as in YAML."""
    entry = {"effect": "link_mass", "where": "torso", "inertia": "scaled", "low": 0.1, "high": 2}
    (read,) = Randomization([entry]).draws
    effect = read.effect
    assert (effect.name, effect.where, effect.how) == ("link_mass", "torso", "add")
    assert effect.options() == {"inertia": "scaled"}
    assert (read.distribution, read.reach) == ("uniform", (0.1, 2))
    (tilted,) = Randomization(
        [{"effect": "stribeck_friction", "speed": 0.2, "low": 0, "high": 1}]
    ).draws
    assert tilted.effect.extra["speed"] == 0.2


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"effect": "link_mas", "low": 0}, r"no effect 'link_mas' \(did you mean 'link_mass'\?\)"),
        ({"effect": "goal", "hihg": 1}, r"goal has no 'hihg' \(did you mean 'high'.*has: .*axes"),
        ({"effect": "goal", "axis": 2}, r"goal has no 'axis' \(did you mean 'axes'\?\)"),
        ({"low": 0, "high": 1}, "effect=None must be the standard name of an effect"),
        ({"effect": "link_mass", "where": 3}, "where=3 must be a name of the model"),
        ({"effect": "goal", "how": "scale"}, "goal cannot 'scale' a value; it can: set"),
        ({"effect": "goal", "low": 0}, "goal: uniform also needs high"),
        ({"effect": "goal", "low": "0", "high": 1}, "goal: low='0' must be a finite number"),
    ],
)
def test_a_mapping_that_names_no_draw_says_where(entry: dict[str, Any], message: str) -> None:
    """Place, value and the nearest name that there is."""
    with pytest.raises((EffectError, ParameterError), match=rf"^draws\[1\]: .*{message}"):
        Randomization([Draw(FRICTION, low=1.0, high=2.0), entry])
