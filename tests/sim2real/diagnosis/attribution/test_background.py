"""How far a model's usual errors move the values of a fit, against robots that have such errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envs.effects import EFFECTS
from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.background import shifts
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.fit import Fit, Problem, refine
from sim2real.diagnosis.attribution.quantify import intervals
from sim2real.diagnosis.attribution.usual import scaled
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm

NOISE = 3e-4  # rad
HIDDEN = ("motor_strength", {"where": "a"}, 0.4)


def searched(folder: Path, *hidden: tuple[str, dict, float], seed: int = 0) -> tuple[Search, Fit]:
    """Return a search in a log of the arm, and a fit of the motor's strength."""
    data = arm.data_of(arm.make_log(*hidden, noise=NOISE, seed=seed, seconds=4.0), folder)
    option = next(c for c in candidates(data) if c.label == "motor_strength.a")
    problem, rng = Problem(data, Simulator(data, threads=1)), np.random.default_rng(0)
    search = Search(problem, [option], NOISE, rng, lambda text, share: None)
    return search, refine(problem, (option,), np.full((1, 2, 1), 0.5), 6)


def dirty(rng: np.random.Generator, folder: Path, size: float) -> list[tuple[str, dict, float]]:
    """Return usual errors of one size and random signs."""
    members = list(scaled(arm.data_of(arm.make_log(seconds=4.0), folder)))
    signs = rng.choice([-1.0, 1.0], len(members))
    return [
        (m.name, {"where": m.effect.where, "how": "scale"}, 1 + size * sign)
        for m, sign in zip(members, signs, strict=True)
    ]


@pytest.mark.slow
def test_values_are_as_far_off_as_told(tmp_path: Path) -> None:
    """Of robots whose every mass, inertia and gain is 3 % off, whatever they hide."""
    rng, off, told = np.random.default_rng(0), [], []
    for seed in range(8):
        errors = dirty(rng, tmp_path, 0.03)
        assert all(name in EFFECTS for name, *_ in errors)
        search, fit = searched(tmp_path, *errors, HIDDEN, seed=seed)
        off.append(fit.mean[0] - HIDDEN[2])
        told.append(shifts(search, fit)[0])
    size = float(np.sqrt(np.mean(np.square(off))))
    assert size > 0.004  # the errors do matter
    assert np.sqrt(np.mean(np.square(told))) == pytest.approx(size, rel=0.4)
    assert np.mean(np.abs(off) < 1.645 * np.array(told)) >= 0.75


def test_a_fit_that_leaves_the_noise_has_no_such_doubt(tmp_path: Path) -> None:
    """And the interval is the one of the blocks; a doubt makes it wider."""
    search, fit = searched(tmp_path, HIDDEN)
    beside = shifts(search, fit)
    assert beside[0] < 0.002
    widths = []
    for more in (None, np.zeros(1), np.array([0.1])):
        ends = intervals(search.problem, fit, np.zeros(1), np.random.default_rng(0), beside=more)
        widths.append(float(np.ptp(ends.ends)) / 2)
    assert widths[0] == widths[1] < 0.02
    assert widths[2] == pytest.approx(np.hypot(widths[0], 1.645 * 0.1), rel=1e-3)


def test_the_errors_are_taken_as_no_larger_than_usual(tmp_path: Path) -> None:
    """What is left of a wrong law is no error of a mass: more of it moves the value no further."""
    search, fit = searched(tmp_path, HIDDEN, ("dead_zone", {"where": "b"}, 0.2))
    whole = shifts(search, fit)[0]
    left = np.sqrt(np.mean(search.problem.held_out(fit.members, fit.values) ** 2))
    search.floor = float(left) / 2  # takes a quarter of the square that is left
    assert shifts(search, fit)[0] == whole > 0
    search.floor = 10 * float(left)
    assert shifts(search, fit)[0] == 0
