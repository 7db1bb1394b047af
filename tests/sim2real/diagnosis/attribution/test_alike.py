"""What the logs cannot tell apart, and how sure a cause is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim2real.diagnosis.attribution.alike import calibrated, confidence
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis import arm


def test_a_cause_without_rivals_is_as_likely_as_a_coin(tmp_path: Path) -> None:
    """What never raced against anything cannot have won: half."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    search: Any = SimpleNamespace(problem=SimpleNamespace(data=data), blocks=None)
    member: Any = SimpleNamespace(label="position_gain.a")
    rest = np.zeros((0, 0, 0))
    assert confidence(search, member, [], [], rest) <= 0.5
    raced: Any = SimpleNamespace(
        candidate=member, settled=False
    )  # the screening has ruled out all others
    assert confidence(search, member, [], [raced], rest) > 0.9


def test_a_rival_that_leaves_half_as_much_again_is_far(tmp_path: Path) -> None:
    """Of a large gap both close nearly all; what the rival leaves tells that it is none."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    blocks: Any = SimpleNamespace(rms=float, drawn=lambda error: np.full(50, float(error)))
    search: Any = SimpleNamespace(problem=SimpleNamespace(data=data), blocks=blocks)

    def raced(label: str, rms: float) -> Any:
        return SimpleNamespace(candidate=SimpleNamespace(label=label), settled=False, error=rms)

    def sure(left: float, other: float) -> float:
        rivals = [raced("own", left), raced("other", other)]
        return confidence(search, rivals[0].candidate, [], rivals, np.array(40.0))

    assert sure(1.0, 1.05) < 0.78 < sure(1.0, 1.25) < 0.9 < sure(1.0, 1.75)
    assert sure(1.0, 8.0) > 0.95
    assert sure(20.0, 21.0) < 0.85  # much is left of the same gap, and the rival is close


def test_confidence_is_that_of_a_known_law_times_that_of_this_one() -> None:
    """Any curve keeps the order of the races, and stays within the ends."""
    limits = DEFAULT.causes
    even = replace(limits, calibration=(0.0, 1.0))  # odds of one over what stays open
    assert calibrated(1.0, 0.75, even) == pytest.approx(4 / 5)
    assert calibrated(0.5, 0.75, even) == pytest.approx(2 / 5)
    found = [calibrated(sure, 0.9, limits) for sure in np.linspace(0.0, 1.0, 25)]
    assert found == sorted(found)
    ends = (limits.confidence_min, limits.confidence_max)
    assert (calibrated(0.0, 0.0, limits), calibrated(1.0, 1.0, limits)) == ends


def test_what_stays_open_is_a_reason_to_doubt() -> None:
    """The sure winner of a race closes half: a look-alike. It closes 0.97: the law itself."""
    found = [calibrated(1.0, closed, DEFAULT.causes) for closed in (0.5, 0.8, 0.9, 0.97)]
    assert found == sorted(found)
    assert found[0] < 0.3 and 0.6 < found[1] < 0.8 and found[3] > 0.95
