from typing import Literal

import numpy as np
import pytest

from envs.effects import make
from tests.envs.effects.reference import Pendulum, follow
from tests.envs.effects.test_follow import BOUND, TIMES, apart, goals, simulated

HELD = '<position name="servo" joint="hinge" kp="4000" kv="40"/>'


def test_a_loop_of_load_and_deflection_costs_four_times_friction_and_amplitude(bench, one) -> None:
    """Behind a motor that holds still, a slow load bends the spring along two branches."""
    value, friction, most = 0.1, 0.02, 0.1
    spring = one("hysteretic_compliance", friction=friction, damping=0.02)
    arm = bench([spring], [[value]], HELD, armature=1.0)
    arm.reset()
    pull = arm.plant.batch.bind("xfrc_applied")
    loads = most * np.sin(np.linspace(0, 5 * np.pi, 10000))
    bends = []
    for load in loads:
        pull[0, 1, 4] = load
        arm.plant.step(None, np.zeros((1, 1)), 1)
        bends.append(arm.plant.layout.raw_qpos[0, arm.plant.layout.joints[0].q])
    load, bend = loads[-4000:], np.array(bends)[-4000:]  # one whole loop
    amplitude = (most - friction) * value
    assert np.ptp(bend) / 2 == pytest.approx(amplitude, rel=0.02)
    area = abs(float(np.sum((load[1:] + load[:-1]) / 2 * np.diff(bend))))
    assert area == pytest.approx(4 * friction * amplitude, rel=0.05)


@pytest.mark.parametrize("side", ["motor", "link"])
def test_a_swing_over_a_spring_with_friction(side: Literal["motor", "link"]) -> None:
    """It follows an independent integration, which a spring without friction does not."""
    robot = Pendulum(servo=side, softness=0.25, spring_damping=0.005, spring_friction=0.06)
    truth = follow(robot, goals(), TIMES)[:, 1]
    made = {"where": "j", "side": side, "damping": robot.spring_damping}
    lossy = make("hysteretic_compliance", friction=robot.spring_friction, **made)
    link, _ = simulated(robot, {lossy: (robot.softness,)}, 1e-3)
    plain, _ = simulated(robot, {make("joint_compliance", **made): (robot.softness,)}, 1e-3)
    assert apart(truth, link) < BOUND
    assert apart(truth, plain) > 2 * apart(truth, link)
