"""The further values of a hidden friction: how far a joint yields, and what loads its gear."""

import numpy as np
import pytest

from envs.effects import make
from hardware.config import load_robot
from hardware.emulator.hidden import make_hidden
from tests.hardware.emulator.host import put
from tests.hardware.emulator.test_hidden import MOMENT, world_with


@pytest.mark.parametrize(("bristle", "yields"), [(0.0, 5e-4), (4e-3, 4e-3)])
def test_friction_yields_before_it_breaks_away(bristle: float, yields: float) -> None:
    """In proportion to the load, as a diagnosis writes it; without a number, by the emulator's."""
    world = world_with(effect="coulomb_friction", value=0.06, bristle=bristle, ratio=0.5)
    start, mechanics = 0.15, world.mechanics
    mechanics.data.qpos[mechanics.qpos] = start
    put(world, torque_enable=0)
    world.advance(1.0)
    share = MOMENT * np.sin(mechanics.angle[0]) / 0.06
    assert start - mechanics.angle[0] == pytest.approx(share * yields, rel=0.03)


@pytest.mark.parametrize("name", ["coulomb", "stribeck", "load_dependent"])
def test_a_diagnosed_friction_can_be_hidden(name: str) -> None:
    """With all further values of the library's effect, which a diagnosis writes."""
    effect = make(f"{name}_friction", where="hinge")
    entry = {"effect": effect.name, "where": "hinge", "value": 0.02, "extra": effect.extra}
    hidden = make_hidden([entry], load_robot("bench1"))
    for extra, value in effect.extra.items():
        assert hidden[f"{effect.name}.{extra}"] == [value]


def test_load_dependent_friction_counts_what_the_load_pulls_as_well() -> None:
    """With the motor off gravity alone loads the gear; its own friction then holds the pendulum."""
    fell = {}
    for external in (0.0, 1.0):
        world = world_with(effect="load_dependent_friction", value=1.5, external=external)
        world.mechanics.data.qpos[world.mechanics.qpos] = 0.3
        put(world, torque_enable=0)
        world.advance(0.5)
        fell[external] = 0.3 - world.mechanics.angle[0]
    assert fell[0.0] > 0.1
    assert abs(fell[1.0]) < 0.01
