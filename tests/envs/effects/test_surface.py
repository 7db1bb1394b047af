"""How a geom bounces and slides: a dropped ball against e, a rolling one against g sin(a) 5/7."""

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.effects.surface import ratio_of, restitution_of
from envs.errors import EffectError
from envs.plant import Plant

STANDARD, DIRECT = "0.02 0.5", "-10000 -100"
BALL = """<mujoco><option timestep="0.001" gravity="{g}" cone="elliptic" impratio="10"/>
  <worldbody>
  <geom name="floor" type="plane" size="9 9 1" priority="1" friction="1 0 0" solref="{solref}"
    solimp="0.99 0.99 0.001"/>
  <body name="ball" pos="0 0 0.1"><freejoint/><geom name="ball" type="sphere" size="0.1" mass="2"/>
  </body></worldbody></mujoco>"""
TILT, GRAVITY = 0.3, 9.81  # rad, m/s²
BOUNCES = np.array([[0.1], [0.3], [0.6], [0.9]])


def plant(effects: list, rows: int, solref: str = DIRECT, tilt: float = 0.0) -> Plant:
    """Return balls above a floor under a gravity that leans towards x."""
    g = f"{GRAVITY * np.sin(tilt)} 0 {-GRAVITY * np.cos(tilt)}"
    return Plant(mujoco.MjSpec.from_string(BALL.format(g=g, solref=solref)), effects, rows, 1)


def start(made: Plant, height: float, down: float) -> None:
    """Put all balls above the floor."""
    n = made.num_rows
    qpos, qvel = np.tile([0, 0, 0.1 + height, 1, 0, 0, 0.0], (n, 1)), np.zeros((n, 6))
    qvel[:, 2] = -down
    made.reset(np.arange(n), qpos, qvel, np.zeros(n, np.uint64))


@pytest.mark.parametrize("solref", [STANDARD, DIRECT])
def test_a_ball_leaves_at_its_share_of_the_speed(solref: str) -> None:
    """Measured before and after a bounce at 3 m/s, within 0.02 of what was asked for."""
    made = plant([make("restitution", where="floor")], 4, solref)
    made.set_params(np.arange(4), BOUNCES)
    start(made, 0.01, 3.0)
    highest, impact = np.zeros(4), np.sqrt(3.0**2 + 2 * GRAVITY * 0.01)
    for _ in range(150):
        made.step(None, np.zeros((4, 0)), 1)
        highest = np.maximum(highest, made.qvel[:, 2])
    np.testing.assert_allclose(highest / impact, BOUNCES[:, 0], atol=0.02)


def test_ratio_and_restitution_undo_each_other() -> None:
    """From nearly none to all of the speed, through the ratio 1."""
    values = np.linspace(0.011, 1.0, 50)
    np.testing.assert_allclose(restitution_of(ratio_of(values)), values, atol=1e-3)
    assert restitution_of(np.array([1.0]))[0] == pytest.approx(np.exp(-2.0))


@pytest.mark.parametrize(("friction", "share"), [(1.0, 5 / 7), (0.0, 1.0)])
def test_a_ball_rolls_or_slides_down_a_slope(friction: float, share: float) -> None:
    """A solid ball rolls at 5/7 of g sin(a); without friction it slides at all of it."""
    made = plant([make("surface_friction", where="floor", how="set")], 1, tilt=TILT)
    made.set_params(np.arange(1), np.array([[friction]]))
    start(made, 0.0, 0.0)
    for _ in range(500):
        made.step(None, np.zeros((1, 0)), 1)
    wanted = share * GRAVITY * np.sin(TILT) * 0.5
    assert made.qvel[0, 0] == pytest.approx(wanted, rel=0.02)


def test_one_value_for_all_that_match_a_pattern() -> None:
    """`b*` is the ball; a pattern that nothing matches lists the names."""
    made = plant([make("link_mass", where="b*", how="scale", inertia="scaled")], 1)
    made.set_params(np.arange(1), np.array([[3.0]]))
    assert made.field("body_mass")[0, 1] == pytest.approx(6.0)
    with pytest.raises(EffectError, match=r"no body 'x\*'.*it has: ball"):
        plant([make("link_mass", where="x*")], 1)
