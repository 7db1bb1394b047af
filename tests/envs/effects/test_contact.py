from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.effects.contact import touching
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


TWO = """<mujoco><option timestep="0.001"/><worldbody>
  <geom name="table" type="box" size="2 2 0.1" pos="0 0 -0.1" friction="0.6" solref="0.01 1"/>
  <body name="left" pos="0 -0.5 0.0999"><freejoint/>
    <geom name="pad" type="box" size="0.2 0.2 0.1" friction="0.4"/></body>
  <body name="right" pos="0 0.5 0.0999"><freejoint/>
    <geom name="claw" type="box" size="0.2 0.2 0.1" friction="0.4"/></body>
  </worldbody></mujoco>"""


NAMELESS = TWO.replace('name="pad" ', "").replace('name="claw" ', "")


def pushed(effect: Any, value: float, force: float, model: str = TWO) -> np.ndarray:
    """Return how far two boxes on a table slide in 0.3 s under a part of their weight [m]."""
    plant = Plant(mujoco.MjSpec.from_string(model), [effect], 1, 1)
    row = np.zeros(1, int)
    plant.set_params(row, np.array([[value]]))
    plant.reset(row, plant.nominal.qpos0[None], np.zeros((1, 12)), np.zeros(1, np.uint64))
    plant.step(None, np.zeros((1, 0)), 300)
    before = plant.qpos[0, [0, 7]].copy()
    plant.batch.bind("xfrc_applied")[:, 1:, 0] = force * plant.model.body_mass[1:] * 9.81
    plant.step(None, np.zeros((1, 0)), 300)
    return plant.qpos[0, [0, 7]] - before


@pytest.mark.parametrize(("value", "slides"), [(0.2, True), (0.6, False), (0.9, False)])
def test_one_geom_of_any_name_has_its_own_friction(value: float, slides: bool) -> None:
    """Half the weight moves it where mu is 0.2; the other box holds on the table's 0.6."""
    moved, other = pushed(make("ground_friction", where="claw"), value, 0.5)[::-1]
    assert moved == pytest.approx(0.5 * 0.3 * 9.81 * 0.3**2 if slides else 0.0, rel=0.05, abs=1e-3)
    assert abs(other) < 1e-3


def test_more_friction_of_one_geom_leaves_the_others_as_they_were() -> None:
    """Under 0.75 of the weight the one with 0.9 holds and the other one slides on 0.6."""
    left, right = pushed(make("ground_friction", where="claw"), 0.9, 0.75)
    assert abs(right) < 3e-3
    assert left == pytest.approx(0.5 * 0.15 * 9.81 * 0.3**2, rel=0.05)


def test_a_foot_without_a_name_is_called_by_its_body() -> None:
    """What stands on the ground in the logs is found, and has a value of its own."""
    model = mujoco.MjModel.from_xml_string(NAMELESS)
    assert touching(model, model.qpos0[None]) == ("left", "right")
    left, right = pushed(make("ground_friction", where="right"), 0.2, 0.5, NAMELESS)
    assert right == pytest.approx(0.5 * 0.3 * 9.81 * 0.3**2, rel=0.05)
    assert abs(left) < 1e-3


def test_without_feet_every_geom_that_can_touch_has_one_value() -> None:
    """Both boxes slide on 0.2; the table is no plane, and nothing is called a foot."""
    moved = pushed(make("ground_friction"), 0.2, 0.5)
    assert moved == pytest.approx(0.5 * 0.3 * 9.81 * 0.3**2, rel=0.05)


def test_one_geom_has_its_own_stiffness() -> None:
    """It sinks in by 1 / factor of what the contact had, the other one as before."""
    depths = []
    for value in (1.0, 0.5):
        plant = Plant(
            mujoco.MjSpec.from_string(TWO), [make("contact_stiffness", where="claw")], 1, 1
        )
        row = np.zeros(1, int)
        plant.set_params(row, np.array([[value]]))
        plant.reset(row, plant.nominal.qpos0[None], np.zeros((1, 12)), np.zeros(1, np.uint64))
        plant.step(None, np.zeros((1, 0)), 1000)
        depths.append(0.1 - plant.qpos[0, [2, 9]])
    left, right = depths[1] / depths[0]
    assert left == pytest.approx(1.0, rel=1e-3)
    assert right == pytest.approx(2.0, rel=0.1)


def test_what_touches_is_told_from_the_poses() -> None:
    """A box that hovers does not."""
    model = mujoco.MjModel.from_xml_string(TWO)
    pose = model.qpos0.copy()
    pose[2] += 0.1
    assert touching(model, pose[None]) == ("claw",)
    assert touching(model, np.stack([pose, model.qpos0])) == ("pad", "claw")


def test_a_robot_that_nothing_can_touch_is_refused() -> None:
    """Each refusal says what is missing."""
    air = BOX.replace('type="plane" size="1 1 0.1"', 'size="0.1" contype="0" conaffinity="0"')
    with pytest.raises(EffectError, match="no geom of this model can touch the ground"):
        Plant(mujoco.MjSpec.from_string(air.format(solref="")), [make("ground_friction")], 1, 1)
    with pytest.raises(EffectError, match="needs a ground"):
        effect = make("ground_friction", where="foot")
        Plant(mujoco.MjSpec.from_string(air.format(solref="")), [effect], 1, 1)
    direct = TWO.replace('solref="0.01 1"', 'solref="-2000 -80"')
    with pytest.raises(EffectError, match="negative solref"):
        effect = make("contact_stiffness", where="claw")
        Plant(mujoco.MjSpec.from_string(direct), [effect], 1, 1)
