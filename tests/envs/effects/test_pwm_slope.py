"""A limit on how fast a servo's torque changes, stated by a model."""

import mujoco
import numpy as np
import pytest

from envs.effects.pwm_slope import PwmSlope
from envs.errors import EffectError, TaskError
from envs.plant import Plant
from envs.replay.rollout import rollout

KP, RATE, DT, INERTIA, LIMIT = 5.0, 20.0, 0.001, 0.02, 1.5
NUMBER = f'<custom><numeric name="torque_rate.arm" data="{RATE}"/></custom>'
ARM = f"""<mujoco><option timestep="{DT}" gravity="0 0 0"/>{NUMBER}
  <worldbody><body><joint name="arm" axis="0 1 0" armature="{INERTIA}"/>
    <geom size="0.01" mass="1e-6"/></body></worldbody>
  <actuator><position name="arm" joint="arm" kp="{KP}" forcerange="-{LIMIT} {LIMIT}"/></actuator>
</mujoco>"""


def torques(text: str, goals: np.ndarray) -> np.ndarray:
    """Return the torque at each step of a joint that follows goals (K,), from its accelerations."""
    plant = Plant(mujoco.MjSpec.from_string(text), num_rows=2, threads=1)
    every = np.arange(2)
    plant.reset(every, np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(2, np.uint64))
    path = rollout(plant, np.tile(goals[:, None], (2, 1, 1)))[1, :, 0]
    speed = np.diff(path, prepend=0.0) / DT
    return INERTIA * np.diff(speed) / DT


def test_a_stated_rate_holds_the_torque_back_and_no_further() -> None:
    """After a step of the goal the torque grows by the rate, up to its limit, and falls by it."""
    goals = np.where(np.arange(300) < 150, 1.0, -1.0)
    goals[:20] = 0.0
    held = torques(ARM, goals)
    grows = held[20 : 20 + round(LIMIT / RATE / DT)]
    np.testing.assert_allclose(np.diff(grows), RATE * DT, rtol=1e-3)
    assert np.abs(held).max() == pytest.approx(LIMIT, rel=1e-3)
    assert np.abs(np.diff(held)).max() < RATE * DT * (1 + 1e-3)
    free = torques(ARM.replace(NUMBER, ""), goals)
    assert np.diff(free).max() == pytest.approx(LIMIT, rel=1e-3)  # at once


def test_a_rate_of_an_actuator_without_a_limit_is_refused() -> None:
    """It would do nothing: what narrows is the range of forces."""
    free = ARM.replace(f' forcerange="-{LIMIT} {LIMIT}"', "")
    with pytest.raises(TaskError, match=r"torque_rate\.arm.*no forcerange; give it"):
        Plant(mujoco.MjSpec.from_string(free))


def test_a_rate_is_stated_or_given_but_not_both() -> None:
    """Two limits of one servo would hide which one holds."""
    spec = mujoco.MjSpec.from_string(ARM)
    with pytest.raises(EffectError, match="pwm_slope is fixed twice"):
        Plant(spec, fixed=[(PwmSlope(np.array([RATE])), ())])
