"""Play, springs and bristles through a swing, beside an integration by scipy of the equations."""

from collections.abc import Mapping, Sequence
from functools import cache

import mujoco
import numpy as np
import pytest

from envs.effects import Effect, make
from envs.plant import Plant
from tests.envs.effects.reference import Bristles, Pendulum, follow

ARM, GRAVITY = 0.1, 9.81  # m, m/s²
TIMES = np.arange(0, 2.5, 0.01)
BOUND = 0.02  # of the swing's root mean square

PENDULUM = """<mujoco><option timestep="{step}" integrator="implicitfast"/><worldbody><body>
  <joint name="j" axis="0 1 0" armature="{rotor}"/>
  <inertial pos="0 0 -{arm}" mass="{mass}" diaginertia="{own} {own} {own}"/></body></worldbody>
<actuator><position name="j" joint="j" kp="{kp}" {kv} damping="{emf}"
  forcerange="-{limit} {limit}"/></actuator></mujoco>"""


def goals() -> np.ndarray:
    """Return a swing with reversals, then a step and a hold."""
    swing = 0.6 * np.sin(2 * np.pi * 0.5 * TIMES) + 0.15 * np.sin(2 * np.pi * 1.7 * TIMES)
    return np.where(TIMES < 1.8, swing, np.where(TIMES < 2.1, 0.3, -0.3))


@cache
def truth_of(robot: Pendulum) -> np.ndarray:
    """Return the angles of motor and link through the swing, (T, 2)."""
    return follow(robot, goals(), TIMES)


def simulated(
    robot: Pendulum, effects: Mapping[Effect, Sequence[float]], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the link's true angle and what the log's encoder says, (T,) each."""
    mass = robot.weight / GRAVITY / ARM
    own, kv = robot.link - mass * ARM**2, f'kv="{robot.kd}"' if robot.kd else ""
    servo = {"rotor": robot.rotor, "kp": robot.kp, "emf": robot.emf, "limit": robot.limit}
    text = PENDULUM.format(step=step, arm=ARM, mass=mass, own=own, kv=kv, **servo)
    plant = Plant(mujoco.MjSpec.from_string(text), fixed=list(effects.items()), threads=1)
    row, rest, sent = np.zeros(1, int), np.zeros((1, 1)), goals()
    plant.reset(row, rest, rest, np.zeros(1, np.uint64), sent[:1, None])
    found = [(0.0, 0.0)]
    for goal in sent[:-1]:
        plant.step(None, np.full((1, 1), goal), round(0.01 / step))
        found.append((plant.qpos[0, 0], plant.measured(None)[0][0, 0]))
    link, seen = np.array(found).T
    return link, seen


def apart(path: np.ndarray, other: np.ndarray) -> float:
    """Return the root mean square of a difference over that of the path."""
    return float(np.sqrt(np.mean((other - path) ** 2) / np.mean(path**2)))


SERIES = [
    ("backlash", {"play": 0.05}),
    ("backlash", {"play": 0.05, "kd": 0.1, "emf": 0.03}),
    ("backlash", {"play": 0.05, "rotor": 3e-4}),
    ("joint_compliance", {"softness": 0.1, "spring_damping": 0.02}),
    ("joint_compliance", {"softness": 0.1, "spring_damping": 0.02, "rotor": 3e-4}),
]


@pytest.mark.parametrize(("name", "sizes"), SERIES)
@pytest.mark.parametrize("side", ["motor", "link"])
@pytest.mark.parametrize("encoder", ["motor", "link"])
def test_a_swing_over_play_or_spring(name: str, sizes: dict, side, encoder) -> None:
    """The servo's encoder and the log's may each sit on either side."""
    robot = Pendulum(servo=side, **sizes)
    damping = {} if robot.play else {"damping": robot.spring_damping}
    effect = make(name, where="j", side=side, encoder=encoder, **damping)
    value = robot.play or robot.softness
    truth = truth_of(robot)
    link, seen = simulated(robot, {effect: (value,)}, 1e-3)
    read = truth[:, ("motor", "link").index(encoder)]
    assert apart(truth[:, 1], link) < BOUND
    assert apart(read, seen) < BOUND
    other = truth[:, ("link", "motor").index(encoder)]
    assert apart(other, seen) > BOUND  # the other encoder says something else


FRICTIONS = {
    "mild": Bristles(0.06, 0.12, 0.3, 60.0, 0.1),
    "steep": Bristles(0.01, 0.2, 0.1, 60.0, 0.1),
    "soft": Bristles(0.06, 0.12, 0.3, 15.0, 0.05),
    "stiff": Bristles(0.01, 0.2, 0.1, 400.0, 0.3),
    "Dahl's": Bristles(0.12, 0.12, 0.3, 15.0, 0.05),
}


@pytest.mark.parametrize("kind", FRICTIONS)
@pytest.mark.parametrize("step", [1e-3, 2e-3])
def test_a_swing_with_bristles(kind: str, step: float) -> None:
    """Friction that falls fast with the speed, and gives way before it breaks away."""
    own = FRICTIONS[kind]
    robot = Pendulum(friction=own, emf=0.06)
    truth = truth_of(robot)[:, 1]
    excess, bend = own.static - own.coulomb, own.static / own.stiffness
    ratio = own.damping / 2 / (own.stiffness * (robot.link + robot.rotor)) ** 0.5
    dry = make("coulomb_friction", where="j")
    bent = make("stribeck_friction", where="j", speed=own.speed, bristle=bend, ratio=ratio)
    link, _ = simulated(robot, {dry: (own.coulomb,), bent: (excess,)}, step)
    assert apart(truth, link) < BOUND
    rigid = make("stribeck_friction", where="j", speed=own.speed)
    without, _ = simulated(robot, {dry: (own.coulomb,), rigid: (excess,)}, step)
    assert apart(truth, without) > 1.3 * apart(truth, link)
    if kind in ("steep", "stiff"):
        assert apart(truth, without) > 1.5 * BOUND


def test_dry_friction_alone_has_bristles() -> None:
    """What does not depend on the speed is Dahl's friction; rigid friction is further off."""
    own = FRICTIONS["Dahl's"]
    robot = Pendulum(friction=own, emf=0.06)
    ratio = own.damping / 2 / (own.stiffness * (robot.link + robot.rotor)) ** 0.5
    truth, bend = truth_of(robot)[:, 1], own.static / own.stiffness
    bent = make("coulomb_friction", where="j", bristle=bend, ratio=ratio)
    link, _ = simulated(robot, {bent: (own.coulomb,)}, 1e-3)
    rigid, _ = simulated(robot, {make("coulomb_friction", where="j"): (own.coulomb,)}, 1e-3)
    assert apart(truth, link) < BOUND
    assert apart(truth, rigid) > 1.3 * apart(truth, link)


@pytest.mark.parametrize("name", ["load_dependent", "asymmetric", "stribeck"])
def test_the_bristles_of_any_friction_hold_all_of_it(name: str) -> None:
    """Those of an effect that adds none itself bend under another's."""
    robot = Pendulum(emf=0.06)
    alone = make("coulomb_friction", where="j", bristle=0.008)
    bent = make(f"{name}_friction", where="j", bristle=0.008)
    link, _ = simulated(robot, {alone: (0.12,)}, 1e-3)
    both, _ = simulated(robot, {make("coulomb_friction", where="j"): (0.12,), bent: (0.0,)}, 1e-3)
    np.testing.assert_allclose(both, link, atol=1e-12)
