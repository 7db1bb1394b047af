"""What the vocabulary makes of a law: one of its own is refitted, one outside is not."""

import numpy as np
import pytest

from sim2real.exam.refit import RIVAL_FLOORS
from sim2real.exam.thirdparty.hidden import put
from sim2real.exam.thirdparty.make import Made
from sim2real.exam.thirdparty.outside import OUTSIDE
from sim2real.exam.thirdparty.refit import refits
from sim2real.exam.thirdparty.rig import Rig
from sim2real.exam.thirdparty.robots import ROBOTS, make_rig

pytestmark = pytest.mark.slow
pytest.importorskip("dartpy", reason="needs DART: pip install 'sim2real[engines]'")
FLOOR = 2 * np.pi / 4096


def test_the_search_tells_inside_from_outside() -> None:
    """Viscous friction passes for one of the vocabulary; a rhythmic push does not."""
    robot = ROBOTS["pendulum"]
    bare = make_rig(robot, "dart")
    viscous = {"effect": "viscous_friction", "joint": "pivot", "value": 0.1, "extra": {}}

    def left(rig: Rig) -> dict[str, float]:
        made = Made(rig, bare, ({"joint": "pivot"},), 0.0, FLOOR)
        return refits(made, robot, seed=0)

    assert left(put(bare, viscous))["viscous_friction"] <= RIVAL_FLOORS
    pushed = OUTSIDE["push"].put(bare, "pivot", 0.2, np.random.default_rng(0))
    assert min(left(pushed).values()) > RIVAL_FLOORS
