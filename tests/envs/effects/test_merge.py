"""Two lists of effects as one: the same simulation as both of them."""

import mujoco
import numpy as np
import pytest

from envs.effects import make, merge_effects
from envs.errors import EffectError
from envs.plant import Fixed, Plant

ROBOT = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="link">
      <joint name="hinge" axis="0 1 0" armature="0.001"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/>
    </body>
  </worldbody>
  <actuator><position name="hinge" joint="hinge" kp="2" kv="0.05"/></actuator>
</mujoco>
"""
KNOWN: list[Fixed] = [
    (make("position_gain", where="hinge"), (0.5,)),
    (make("coulomb_friction", where="hinge"), (0.01,)),
    (make("encoder_offset", where="hinge"), (0.02,)),
]
FOUND: list[Fixed] = [
    (make("link_mass", where="link"), (0.03,)),
    (make("position_gain", where="hinge"), (0.8,)),
    (make("coulomb_friction", where="hinge"), (0.02,)),
]


def motion(plant: Plant) -> np.ndarray:
    """Return a second of a step command, (T,) rad."""
    path = []
    for _ in range(50):
        plant.step(None, np.full((1, 1), 0.7), 10)
        path.append(float(plant.qpos[0, 0]))
    return np.array(path)


def test_places_are_there_once_with_both_values() -> None:
    """Factors multiply, amounts add, the rest stays in its order."""
    effects = merge_effects(KNOWN, FOUND)
    names = ["position_gain", "coulomb_friction", "encoder_offset", "link_mass"]
    assert [effect.name for effect, _ in effects] == names
    values = [values for _, values in effects]
    np.testing.assert_allclose(values, [(0.4,), (0.03,), (0.02,), (0.03,)])


def test_it_moves_as_one_on_top_of_the_other() -> None:
    """A plant with the combined effects moves as one that draws the second list on the first."""
    spec = mujoco.MjSpec.from_string(ROBOT)
    drawn = Plant(spec, [effect for effect, _ in FOUND], num_rows=1, fixed=KNOWN)
    drawn.set_params(np.arange(1), np.concatenate([values for _, values in FOUND])[None])
    both, first = (Plant(spec, num_rows=1, fixed=f) for f in (merge_effects(KNOWN, FOUND), KNOWN))
    expected = motion(drawn)
    np.testing.assert_allclose(motion(both), expected, atol=1e-12)
    assert np.abs(motion(first) - expected).max() > 0.01


def test_what_cannot_be_combined_is_refused_by_the_plant() -> None:
    """Two plays at one joint are neither added nor multiplied; nothing is lost silently."""
    play: list[Fixed] = [(make("backlash", where="hinge", side="link"), (0.02,))]
    effects = merge_effects(play, play)
    assert len(effects) == 2
    with pytest.raises(EffectError, match="fixed twice"):
        Plant(mujoco.MjSpec.from_string(ROBOT), num_rows=1, fixed=effects)


def test_a_value_that_was_set_is_changed() -> None:
    """More on top of a set value sets more; a factor on an amount has no value of its own."""
    heavy = make("link_mass", where="link", how="set")
    more, factor = (make("link_mass", where="link", how=how) for how in ("add", "scale"))  # type: ignore[arg-type]
    assert merge_effects([(heavy, (0.2,))], [(more, (0.1,))])[0][1] == pytest.approx((0.3,))
    assert merge_effects([(heavy, (0.2,))], [(factor, (1.5,))])[0][1] == pytest.approx((0.3,))
    assert len(merge_effects([(more, (0.1,))], [(factor, (1.5,))])) == 2
