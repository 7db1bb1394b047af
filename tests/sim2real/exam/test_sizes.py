"""Sizes of hidden effects: the search on a gap that is known."""

from typing import Any

import pytest

from sim2real.exam.hiding import EFFECTS, Secret
from sim2real.exam.sizes import CLOSE, search

PLAY = Secret("backlash", "hinge", "hinge", "add", 1.0, 0.0)


def test_the_search_finds_the_wanted_gap() -> None:
    """A gap that grows with the value is met within the tolerance."""
    found = search(PLAY, 0.05, 0.01, lambda entries: 2 * entries[0]["value"])
    assert found is not None
    assert found[1] == pytest.approx(0.05, rel=CLOSE - 1)
    assert found[0] == pytest.approx(0.025, rel=CLOSE - 1)


def test_what_cannot_be_seen_is_not_hidden() -> None:
    """An effect that makes no gap even at its largest is refused; a small one is taken."""
    assert search(PLAY, 0.05, 0.01, lambda entries: 1e-4) is None
    largest = EFFECTS["backlash"].high
    found = search(PLAY, 0.05, 0.01, lambda entries: 0.03 * entries[0]["value"] / largest)
    assert found == pytest.approx((largest, 0.03))


def test_a_robot_that_stops_is_given_less() -> None:
    """Sizes at which the emulated robot switches itself off are too large."""

    def gap(entries: list[dict[str, Any]]) -> float | None:
        value = entries[0]["value"]
        return None if value > 0.02 else value

    found = search(PLAY, 0.05, 0.01, gap)
    assert found is not None
    assert 0.01 <= found[1] <= 0.02
