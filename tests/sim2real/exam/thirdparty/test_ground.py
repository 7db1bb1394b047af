"""A robot on its feet in Drake: it carries its weight, and slips where the ground is slippery."""

import mujoco
import numpy as np
import pytest

from hardware.config import load_robot
from sim2real.exam.thirdparty.ground import Ground, feet_of, floating
from sim2real.runs.errors import Sim2RealError

pytest.importorskip("pydrake", reason="needs Drake; pip install 'sim2real[engines]'")

STEP, KP, KD = 0.0005, 4.2, 0.24


@pytest.fixture(scope="module")
def spec() -> mujoco.MjSpec:
    """quad8 as its file has it."""
    return mujoco.MjSpec.from_file(str(load_robot("quad8").model))


def stood(spec: mujoco.MjSpec, seconds: float, tilt: float = 0.0) -> tuple[Ground, np.ndarray]:
    """Let servos hold the home pose on a ground that is tilted; return how far the base slid."""
    model, tree = spec.compile(), floating(spec)
    gravity = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    tree = type(tree)(tree.links, gravity)
    ground = Ground(tree, feet_of(model), dict.fromkeys(tree.names, 0.0045), STEP, 0.3)
    home = model.key("home").qpos
    ground.stand(home[7:], home[2])
    q, v = home[7:].copy(), np.zeros(8)
    for _ in range(round(seconds / STEP)):
        q, v = ground.step(KP * (home[7:] - q) - KD * v)
    return ground, ground.base()[0]


def test_it_stands_and_the_ground_carries_its_weight(spec: mujoco.MjSpec) -> None:
    """The sum of all contact forces is m g, straight up; the base is upright and still."""
    ground, _ = stood(spec, 0.8)
    weight = 9.81 * float(spec.compile().body_subtreemass[0])
    np.testing.assert_allclose(ground.push(), [0, 0, weight], atol=0.02 * weight)
    place, quaternion, turn = ground.base()
    assert 0.13 < place[2] < 0.1441
    assert abs(quaternion[0]) > 0.9999
    assert np.abs(turn).max() < 0.01


def test_it_slides_down_what_is_steeper_than_its_friction(spec: mujoco.MjSpec) -> None:
    """With a coefficient of 0.3 it stays on a slope of 0.2 and slides on one of 0.4."""
    _, stays = stood(spec, 0.6, np.arctan(0.2))
    _, slides = stood(spec, 0.6, np.arctan(0.4))
    free = 0.5 * 9.81 * (np.sin(np.arctan(0.4)) - 0.3 * np.cos(np.arctan(0.4))) * 0.6**2
    assert abs(stays[0]) < 0.02
    assert slides[0] == pytest.approx(free, rel=0.25)


def test_a_robot_without_a_free_base_is_refused() -> None:
    """An arm on a table has nothing that walks."""
    with pytest.raises(Sim2RealError, match="0 free joints"):
        floating(mujoco.MjSpec.from_file(str(load_robot("arm2").model)))
