"""Robots in other engines: with nothing hidden they are what their models describe."""

import numpy as np
import pytest

from sim2real.exam.logs import difference, overall
from sim2real.exam.measure import apart
from sim2real.exam.thirdparty.robots import ROBOTS, make_rig, nominal, plan

pytestmark = pytest.mark.slow
pytest.importorskip("pydrake", reason="needs Drake: pip install 'sim2real[engines]'")
COUNT = 2 * np.pi / 4096  # rad


@pytest.mark.parametrize("name", ROBOTS)
def test_with_nothing_hidden_the_gap_is_below_one_floor(name: str) -> None:
    """MuJoCo replays Drake's log as well as Drake repeats it under other noise."""
    robot = ROBOTS[name]
    ctrl = plan(robot, seconds=5.0, rng=np.random.default_rng(4))
    rig = make_rig(robot)
    log, again = rig.drive(ctrl, seed=1), rig.drive(ctrl, seed=2)
    floor = max(overall(difference(log, again)), COUNT)
    gap = overall(apart(log, nominal(robot)))
    assert gap < floor
    moved = np.ptp([log.column(f"qpos.{joint}") for joint in rig.driven], axis=1)
    assert moved.min() > 0.3


def test_dart_moves_as_drake_does() -> None:
    """Two engines that share nothing but the bodies' numbers write the same log."""
    pytest.importorskip("dartpy", reason="needs DART: pip install 'sim2real[engines]'")
    robot = ROBOTS["arm3"]
    ctrl = plan(robot, seconds=2.0, rng=np.random.default_rng(4))
    logs = [make_rig(robot, engine).drive(ctrl, seed=1) for engine in ("drake", "dart")]
    assert overall(difference(*logs)) < 0.1 * COUNT
