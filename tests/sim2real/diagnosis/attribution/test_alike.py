"""What the logs cannot tell apart, and how sure a cause is."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from sim2real.diagnosis.attribution.alike import confidence
from tests.sim2real.diagnosis import arm


def test_a_cause_without_rivals_is_as_likely_as_a_coin(tmp_path: Path) -> None:
    """What never raced against anything cannot have won: half, even where all is closed."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    search: Any = SimpleNamespace(problem=SimpleNamespace(data=data), blocks=None)
    member: Any = SimpleNamespace(label="position_gain.a")
    rest = np.zeros((0, 0, 0))
    assert confidence(search, member, [], [], rest, closed=1.0) <= 0.5
    raced: Any = SimpleNamespace(
        candidate=member, settled=False
    )  # the screening has ruled out all others
    assert confidence(search, member, [], [raced], rest, closed=1.0) > 0.9
