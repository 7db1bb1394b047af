from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.errors import EffectError
from envs.plant import Plant

BOX = """<mujoco><option timestep="0.001"/><worldbody>
  <geom name="floor" type="plane" size="1 1 0.1" friction="0.5"/>
  <body pos="0 0 0.0999"><freejoint/>
  <geom name="foot" type="box" size="0.2 0.2 0.1" friction="0.3" {solref}/></body>
  </worldbody></mujoco>"""


def boxes(effects: list, values: Any, solref: str = "") -> Plant:
    """Return boxes at rest on the floor, one for each row of values."""
    plant = Plant(mujoco.MjSpec.from_string(BOX.format(solref=solref)), effects, len(values), 1)
    n = len(values)
    ids = np.arange(n)
    plant.set_params(ids, np.array(values, dtype=float))
    start = np.tile(plant.nominal.qpos0, (n, 1))
    plant.reset(ids, start, np.zeros((n, 6)), np.zeros(n, np.uint64))
    plant.step(None, np.zeros((n, 0)), 500)
    return plant


def test_ground_friction_decides_when_a_box_slides() -> None:
    """A push of mu m g: less holds, more slides; both geoms are written, so that 0.2 counts."""
    plant = boxes([make("ground_friction")], [[0.2], [0.4], [0.8]])
    mass = plant.model.body_mass[1]
    before = plant.qpos[:, 0].copy()
    plant.batch.bind("xfrc_applied")[:, 1, 0] = 0.3 * mass * 9.81
    plant.step(None, np.zeros((3, 0)), 300)
    moved = plant.qpos[:, 0] - before
    assert moved[0] == pytest.approx(0.5 * 0.1 * 9.81 * 0.3**2, rel=0.05)
    assert np.abs(moved[1:]).max() < 1e-3


def test_mode_seed_writes_the_foot_alone() -> None:
    """Below the floor's own coefficient it changes nothing, as in the study it repeats."""
    plant = boxes([make("ground_friction", friction_mode="seed")], [[0.1]])
    assert plant.field("geom_friction")[0, :, 0] == pytest.approx([0.5, 0.1])
    with pytest.raises(EffectError, match="friction_mode='feet'"):
        make("ground_friction", friction_mode="feet")


@pytest.mark.parametrize("solref", ["", 'solref="-2000 -80"'])
def test_contact_stiffness_divides_the_sinking(solref: str) -> None:
    """A box at rest sinks in by an amount in proportion to 1 / factor."""
    factors = np.array([0.25, 0.5, 1.0])
    plant = boxes([make("contact_stiffness", where="foot")], factors[:, None], solref)
    depth = 0.1 - plant.qpos[:, 2]
    assert (depth > 0).all()
    assert depth / depth[-1] == pytest.approx(1 / factors, rel=0.1)
    assert np.abs(plant.qvel).max() < 1e-3


def test_a_robot_without_feet_must_say_where() -> None:
    """The geoms it has are listed."""
    text = BOX.replace('"foot"', '"sole"').format(solref="")
    with pytest.raises(EffectError, match="say where: one of floor, sole"):
        Plant(mujoco.MjSpec.from_string(text), [make("ground_friction")], 1, 1)
    air = text.replace('type="plane" size="1 1 0.1"', 'size="0.1"')
    with pytest.raises(EffectError, match="needs a plane"):
        Plant(mujoco.MjSpec.from_string(air), [make("ground_friction", where="sole")], 1, 1)
