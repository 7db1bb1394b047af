"""What integral action has summed up when a window starts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.effects.drive import _Integral
from envs.plant import Plant
from sim2real.diagnosis.data.windup import Windup
from tests.sim2real.diagnosis import arm


@pytest.mark.parametrize(
    ("rate", "limit", "held"), [(0.5, 10.0, 0.05), (4.0, 10.0, 0.0), (4.0, 0.7, -0.05)]
)
def test_windows_start_as_wound_up_as_one_long_replay_gets(
    tmp_path: Path, rate: float, limit: float, held: float
) -> None:
    """The integral at each window's start is that of the whole log, also where it was frozen."""
    joint: dict[str, Any] = {"where": "a"}
    hidden = ("integral_action", joint | {"held": held}, rate), ("torque_limit", joint, limit)
    log = arm.make_log(*hidden, seconds=20.0)
    data = arm.data_of(log, tmp_path)
    windows = np.arange(len(data.windows))
    effects = [make(name, **arguments) for name, arguments, _ in hidden]
    plants = [Plant(data.specs[0], effects, n) for n in (len(windows), 1)]
    for plant in plants:
        plant.set_params(np.arange(plant.num_rows), np.tile([rate, limit], (plant.num_rows, 1)))
    rules = [next(r for r in p.substep_rules if isinstance(r, _Integral)) for p in plants]
    Windup(data).start(plants[0], windows)
    truth = arm.replay_whole(plants[1], log, lambda: rules[1].sum[0])
    expected = truth[[window.start for window in data.windows]]
    assert np.abs(expected).max() * rate > 0.02  # rad by which a goal is shifted
    np.testing.assert_allclose(rules[0].sum * rate, expected * rate, atol=0.01)
