"""Kinds of cases: what each of them draws."""

from itertools import islice

import numpy as np
import pytest

from sim2real.exam.cases import ALIKE
from sim2real.exam.thirdparty.hidden import WIDE
from sim2real.exam.thirdparty.kinds import KINDS, ON, Kind, draws
from sim2real.exam.thirdparty.outside import OUTSIDE


@pytest.mark.parametrize("kind", KINDS)
def test_robots_and_effects_come_evenly(kind: Kind) -> None:
    """Robots take turns; what a robot can show comes once before anything comes again."""
    found = list(islice(draws(kind, np.random.default_rng(0)), 24))
    counts = [sum(robot == one for robot, _ in found) for one in ON[kind]]
    assert max(counts) - min(counts) <= 1
    first = [effects for robot, effects in found if robot == ON[kind][0]]
    if kind in ("single", "dirty"):
        assert len(set(first)) == len(first)


def test_what_kinds_hide() -> None:
    """Outside laws are outside, pairs can be told apart, wide effects are, off-nominal is none."""

    def effects(kind: Kind) -> set[tuple[str, ...]]:
        return {names for _, names in islice(draws(kind, np.random.default_rng(1)), 40)}

    assert effects("off_nominal") == {()}
    assert effects("outside") == {(name,) for name in OUTSIDE}
    assert effects("robot_wide") <= {(name,) for name in WIDE}
    assert not [pair for pair in effects("two") if any(set(pair) <= group for group in ALIKE)]
