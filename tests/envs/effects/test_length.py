"""A link's length: the stretched model is the one that is built longer."""

import mujoco
import numpy as np
import pytest

from envs.effects import RobotScale, make
from envs.errors import EffectError
from envs.plant import Plant

ARM = """<mujoco><worldbody><body name="upper" pos="0 0 1">
  <joint name="shoulder" axis="0 1 0" pos="0.05 0 0"/>
  <geom name="rod" type="box" pos="{middle} 0 0" size="{half} 0.01 0.02" mass="0.4" euler="0 0 0"/>
  <site name="eye" pos="{eye} 0 0.03"/>
  <body name="lower" pos="{end} 0 0"><joint name="elbow" axis="0 1 0"/>
    <geom type="capsule" size="0.01" fromto="0 0 0 0 0 0.1" mass="0.1" contype="{kind}"
      conaffinity="0"/>
  </body></body></worldbody>
  <actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>"""


def arm(length: float, kind: int = 1) -> mujoco.MjSpec:
    """Return an arm whose upper link reaches so far [m] from its joint at x = 0.05."""
    stretch = length / 0.2
    at = {name: 0.05 + stretch * x for name, x in (("middle", 0.1), ("eye", 0.15), ("end", 0.2))}
    text = ARM.format(half=0.1 * stretch, kind=kind, **at)
    return mujoco.MjSpec.from_string(text)


def swing(plant: Plant) -> np.ndarray:
    """Return the states of a free swing, (T, rows, 4)."""
    ids = np.arange(plant.num_rows)
    start = np.tile([0.3, -0.4], (len(ids), 1))
    plant.reset(ids, start, np.zeros_like(start), np.zeros(len(ids), np.uint64))
    states = []
    for _ in range(50):
        assert not plant.step(None, np.zeros((len(ids), 2)), 4).any()
        states.append(np.hstack([plant.qpos, plant.qvel]))
    return np.array(states)


def test_a_stretched_link_is_one_that_was_built_longer() -> None:
    """Swings, masses, shapes and places are those of a model of that length."""
    effect = make("link_length", where="upper")
    plant = Plant(arm(0.2), [effect], 2, 1)
    plant.set_params(np.arange(2), np.array([[1.0], [1.6]]))
    longer = Plant(arm(0.32), [], 1, 1)
    states = swing(plant)
    np.testing.assert_allclose(states[:, 1], swing(longer)[:, 0], atol=1e-9)
    assert (states[:, 0] == swing(Plant(arm(0.2), [], 1, 1))[:, 0]).all()
    for name in ("geom_size", "geom_pos", "site_pos", "body_pos", "body_mass", "body_ipos"):
        wanted = getattr(longer.model, name)
        np.testing.assert_allclose(plant.field(name)[1], wanted, atol=1e-12)


def test_a_shape_that_cannot_be_stretched_is_refused() -> None:
    """A capsule that collides and lies across the link; one that does not collide may stay."""
    across = ARM.replace('type="box"', 'type="capsule"').replace("{half} 0.01 0.02", "0.01 0.2")
    at = {"middle": 0.15, "eye": 0.2, "end": 0.25, "half": 0.1, "kind": 1}
    with pytest.raises(EffectError, match=r"link_length\.upper: geom rod collides"):
        Plant(mujoco.MjSpec.from_string(across.format(**at)), [make("link_length", where="upper")])


def test_no_search_looks_for_it() -> None:
    """A diagnosis has no such candidate; a randomization draws it by its place."""
    model = arm(0.2).compile()
    assert make("link_length", where="upper").places(RobotScale(model)) == []
