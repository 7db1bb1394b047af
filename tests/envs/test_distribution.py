"""Distributions of robots and their file: laws, correlations, round trips, what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy import stats

from envs.distribution import Distribution, Entry, UnidentifiedDirection
from envs.distribution_file import read, write
from envs.effects import load_effects, make, write_effects
from envs.errors import ParameterError
from envs.marginals import Marginal, uniform
from envs.plant import Plant
from envs.simulation import Simulation
from envs.tasks import Hopper

MASS = make("link_mass", where="torso", how="scale")
FRICTION = make("ground_friction")
JOINT = np.array([[1.0, 0.8], [0.8, 1.0]])


def found(**changes: object) -> Distribution:
    """Return a normal mass and a lognormal friction that go together."""
    entries = (
        Entry(MASS, (Marginal("normal", 1.2, 0.1, 0.5, 2.0),), spread=(0.08,), uncertainty=(0.06,)),
        Entry(FRICTION, (Marginal("lognormal", 2.0, 0.5, 0.1, 9.0),)),
    )
    made = Distribution(
        entries,
        JOINT,
        made_by={"method": "matching"},
        logs={"a.csv": "00ff"},
        flat=(UnidentifiedDirection({"link_mass.torso": 0.7, "ground_friction": -0.7}, 0.1),),
        noise={"hip": 0.002},
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def edited(folder: Path, **changes: object) -> Path:
    """Write the file with other values in its first entry, or of its other keys."""
    path = write(folder / "distribution.yaml", found())
    tree = yaml.safe_load(path.read_text())
    for key, value in changes.items():
        (tree if key in tree or key == "wrong_root" else tree["entries"][0])[key] = value
    path.write_text(yaml.safe_dump(tree))
    return path


@pytest.mark.parametrize(
    ("law", "same"),
    [
        (Marginal("normal", 1.2, 0.1, -9.0, 9.0), stats.norm(1.2, 0.1)),
        (Marginal("normal", 0.0, 1.0, -0.5, 3.0), stats.truncnorm(-0.5, 3.0)),
        (uniform(1.0, 3.0), stats.uniform(1.0, 2.0)),
        (Marginal("lognormal", 2.0, 0.5, 0.0, 99.0), stats.lognorm(0.24622, scale=1.940285)),
    ],
    ids=["normal", "cut", "uniform", "lognormal"],
)
def test_draws_follow_their_law(law: Marginal, same: stats.rv_continuous) -> None:
    """A Kolmogorov-Smirnov test does not tell draws from their law, and tells them from another."""
    made = Distribution((Entry(FRICTION, (law,)),))
    drawn = made.sample(np.random.default_rng(1), 5000)[:, 0]
    assert stats.kstest(drawn, same.cdf).pvalue > 0.01
    assert stats.kstest(drawn + 0.2 * same.std(), same.cdf).pvalue < 1e-6


def test_draws_go_together_as_the_joint_says() -> None:
    """The ranks of two laws of different kinds have the copula's rank correlation."""
    drawn = found().sample(np.random.default_rng(0), 8000)
    wanted = 6 / np.pi * np.arcsin(0.8 / 2)  # Spearman's of a Gaussian copula
    made: Any = stats.spearmanr(*drawn.T)
    assert made.statistic == pytest.approx(wanted, abs=0.02)


def test_the_file_is_read_back(tmp_path: Path) -> None:
    """All that was written is there again, and draws are the same to ten digits."""
    again = read(write(tmp_path / "distribution.yaml", found()))
    assert again.names == found().names
    assert again.laws == found().laws
    for name in ("flat", "noise", "made_by", "logs"):
        assert getattr(again, name) == getattr(found(), name)
    assert again.columns("spread") == pytest.approx([0.08, np.nan], nan_ok=True)
    assert again.columns("uncertainty") == pytest.approx([0.06, np.nan], nan_ok=True)
    draws = [one.sample(np.random.default_rng(3), 50) for one in (again, found())]
    np.testing.assert_allclose(*draws, rtol=1e-8)


def test_particles_are_rows_of_their_table(tmp_path: Path) -> None:
    """They are written beside the file, and drawn whole, so that what goes together stays."""
    table = np.random.default_rng(0).uniform(0.5, 1.5, (20, 2))
    laws = [
        Marginal("particles", m, s, 0.5, 1.5)
        for m, s in zip(table.mean(0), table.std(0), strict=True)
    ]
    entries = tuple(Entry(e, (law,)) for e, law in zip((MASS, FRICTION), laws, strict=True))
    again = read(write(tmp_path / "d.yaml", Distribution(entries, particles=table)))
    drawn = again.sample(np.random.default_rng(0), 100)
    assert {tuple(row) for row in drawn} <= {tuple(row) for row in table}
    (tmp_path / "d_particles.csv").unlink()
    with pytest.raises(ParameterError, match="cannot read the particles"):
        read(tmp_path / "d.yaml")


def test_effects_takes_the_mean(tmp_path: Path) -> None:
    """effects=distribution.yaml fixes every parameter at its mean."""
    (mass, first), (friction, second) = load_effects(write(tmp_path / "d.yaml", found()))
    assert (mass.label(), mass.how, first) == ("link_mass.torso", "scale", (1.2,))
    assert (friction.label(), second) == ("ground_friction", (2.0,))


def test_zero_width_is_an_effects_file(tmp_path: Path) -> None:
    """A distribution without any width makes the same robot as effects.yaml, to the bit."""
    entries = tuple(
        Entry(effect, (Marginal("normal", value, 0.0, 0.1, 9.0),))
        for effect, value in ((MASS, 1.2), (FRICTION, 2.0))
    )
    made = read(write(tmp_path / "d.yaml", Distribution(entries)))
    write_effects(tmp_path / "e.yaml", [(MASS, (1.2,)), (FRICTION, (2.0,))])
    drawn = Simulation(Hopper(), 1, made.effects)
    fixed = Simulation(Hopper(), 1, fixed=load_effects(tmp_path / "e.yaml"))
    seeds, ids, paths = np.zeros(1, np.uint64), np.arange(1), []
    values = made.sample(np.random.default_rng(0), 1)
    for simulation, own in ((drawn, values), (fixed, np.zeros((1, 0)))):
        simulation.reset(ids, own, seeds)
        paths.append([simulation.step(None, np.full((1, 3), 0.3)).observation for _ in range(20)])
    np.testing.assert_array_equal(*paths)


def test_a_simulation_of_another_robot_is_refused() -> None:
    """What is drawn must be what the simulation has, within what its parameters mean."""
    world = Plant(Hopper().spec(), [MASS, FRICTION]).space
    found().check(world)
    with pytest.raises(ParameterError, match=r"has 2 parameters .* the simulation has 1"):
        found().check(Plant(Hopper().spec(), [MASS]).space)
    wide = Entry(FRICTION, (Marginal("normal", 1.0, 0.5, -1.0, 2.0),))
    with pytest.raises(ParameterError, match=r"ground_friction: draws reach \[-1, 2\]"):
        Distribution((Entry(MASS, found().entries[0].laws), wide)).check(world)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"effect": "grund_friction"}, "entry 1: .*grund_friction.*did you mean 'ground_friction'"),
        ({"law": "nromal"}, "link_mass.torso: law='nromal' is unknown.*did you mean 'normal'"),
        ({"std": -0.1}, "std=-0.1 is negative"),
        ({"std": None}, "std=None must be a number"),
        ({"high": 1.0, "value": None}, "mean=1.2 is not within low=0.5 and high=1"),
        ({"value": 1.3}, "value=1.3 is not mean=1.2"),
        ({"sdt": 0.1}, "unknown key 'sdt'.*did you mean 'std'"),
        ({"wrong_root": 1}, "unknown key 'wrong_root'"),
        ({"joint": [[1.0, 0.8], [0.7, 1.0]]}, "is not a correlation matrix: it is not symmetric"),
        ({"joint": [[1.0, 1.8], [1.8, 1.0]]}, "contradict each other"),
        ({"joint": [[2.0, 0.8], [0.8, 1.0]]}, "its diagonal is not 1"),
        ({"joint": [[1.0]]}, "joint must be a 2 by 2 matrix"),
        ({"joint": [[1.0, "x"], [0.0, 1.0]]}, "must be a matrix of numbers"),
        ({"law": "particles"}, "law: particles needs a table"),
        ({"entries": {}}, "a mapping with a list under `entries`"),
        ({"entries": []}, "at least one entry"),
    ],
    ids=lambda value: str(value)[:30] if isinstance(value, dict) else "",
)
def test_what_cannot_be_is_refused(tmp_path: Path, changes: dict, message: str) -> None:
    """Each mistake in a file is a sentence with the file, the entry and what is allowed."""
    with pytest.raises(ParameterError, match=message) as caught:
        read(edited(tmp_path, **changes))
    assert str(tmp_path) in str(caught.value)


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    """So is one that is not given, and an effects.yaml in its place."""
    with pytest.raises(ParameterError, match=r"params\.path=PATH"):
        read(None)
    with pytest.raises(ParameterError, match="cannot read the distribution"):
        read(tmp_path / "none.yaml")
    write_effects(tmp_path / "e.yaml", [(MASS, (1.2,))])
    with pytest.raises(ParameterError, match="effects=PATH"):
        read(tmp_path / "e.yaml")


def test_a_file_is_whole_or_absent(tmp_path: Path) -> None:
    """What cannot be written leaves the former file, and nothing beside it."""
    path = write(tmp_path / "d.yaml", found())
    before = path.read_bytes()
    with pytest.raises(yaml.YAMLError, match="represent"):
        write(path, found(made_by={"method": object()}))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["d.yaml"]
