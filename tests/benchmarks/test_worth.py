"""The benchmark of `worth` against the emulated robot: what it hides, and how costs are scored."""

from typing import Any

import numpy as np
import pytest

from benchmarks import worth as bench
from hardware.config import load_robot
from hardware.emulator.hidden import make_hidden

pytestmark = pytest.mark.slow  # trainings and walks: a minute together


def cost(case: str, predicted: float, measured: float, spread: float = 0.01) -> dict[str, str]:
    """Return a row of the table."""
    row = dict.fromkeys(bench.FIELDS, "")
    ends = {"measured_low": measured - spread, "measured_high": measured + spread}
    values = {"predicted": predicted, "measured": measured, **ends}
    return {**row, "case": case, "robot": "quad8", **{k: str(v) for k, v in values.items()}}


def test_robots_hide_two_to_four_effects_that_they_can_have() -> None:
    """Each kind once, within its sizes, and the emulator takes them."""
    for name in bench.ROBOTS:
        robot = load_robot(name)
        for seed in range(20):
            hidden = bench.drawn(robot, np.random.default_rng(seed))
            kinds = [one["effect"] for one in hidden]
            assert 2 <= len(kinds) == len(set(kinds)) <= 4
            for one in hidden:
                low, high = bench.SIZES[one["effect"]][name]
                assert low <= abs(one["value"]) <= high
            make_hidden(hidden, robot)


def test_only_costs_beyond_noise_count_for_the_sign() -> None:
    """Two of three are; one of these has the wrong sign."""
    rows = [cost("1-0", 0.1, 0.2), cost("1-0", 0.1, -0.2), cost("1-1", -0.1, 0.005)]
    cells: list[Any] = bench.score(rows).rows
    whole = cells[0]
    assert whole[:4] == ("all", 2, 3, 2)
    assert whole[4].value == 0.5


def test_costs_in_the_same_order_go_together() -> None:
    """Spearman's of predicted and measured costs, over all robots."""
    rows = [cost(f"1-{k}", 0.1 * k, 0.3 * k**2) for k in range(5)]
    found = bench.correlation(rows, sorted({row["case"] for row in rows}))
    assert found is not None and found.value == pytest.approx(1.0)
