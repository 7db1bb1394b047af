"""What a motor's voltage, current loop and integrator do, against closed forms."""

from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.errors import EffectError
from envs.plant import Plant

INERTIA, DT = 0.02, 1e-4  # kg·m², s
WHEEL = """<mujoco><option timestep="{dt}" gravity="0 0 0"/><worldbody><body>
    <joint name="hub" axis="0 0 1" {joint}/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.02 0.02 0.02"/></body></worldbody>
    <actuator>{actuator}</actuator></mujoco>"""
MOTOR = '<motor name="m" joint="hub" gear="{gear}" {limit}/>'


def run(effect: Any, value: float, actuator: str, command: float, seconds: float, joint: str = ""):
    """Return times, speeds and actuator forces of a wheel under one command, (T,) each."""
    text = WHEEL.format(dt=DT, joint=joint, actuator=actuator)
    plant = Plant(mujoco.MjSpec.from_string(text), [effect], 1, 1)
    row = np.zeros(1, int)
    values = [value, *plant.space.neutral[1:]]
    plant.set_params(row, np.array([values]))
    force = plant.batch.bind("actuator_force")
    plant.reset(row, np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, np.uint64))
    found = []
    for _ in range(round(seconds / 1e-3)):
        plant.step(None, np.array([[command]]), round(1e-3 / DT))
        found.append((plant.time[0], plant.qvel[0, 0], force[0, 0]))
    return np.array(found).T


@pytest.mark.parametrize(("gear", "sign"), [(1, 1), (2, 1), (-2, -1)])
def test_beyond_the_knee_the_speed_nears_the_no_load_speed(gear: int, sign: int) -> None:
    """A constant torque up to the knee, then an exponential towards twice its speed."""
    limit, knee = 0.5, 4.0
    motor = MOTOR.format(gear=gear, limit=f'forcerange="{-limit} {limit}"')
    time, speed, _ = run(make("torque_speed_knee", where="m"), knee, motor, 9.0, 1.0)
    torque = limit * abs(gear)
    reached = INERTIA * knee / torque  # s
    rate = torque / (INERTIA * knee)  # 1/s: the torque falls by all of it over one more knee
    slow = torque / INERTIA * time
    fast = 2 * knee - knee * np.exp(-rate * (time - reached))
    expected = sign * np.where(time < reached, slow, fast)
    assert speed == pytest.approx(expected, abs=0.02)


def test_the_knee_leaves_braking_alone() -> None:
    """Against the motion the whole torque is there at any speed."""
    text = WHEEL.format(
        dt=DT, joint="", actuator=MOTOR.format(gear=1, limit='forcerange="-0.5 0.5"')
    )
    plant = Plant(mujoco.MjSpec.from_string(text), [make("torque_speed_knee", where="m")], 1, 1)
    row = np.zeros(1, int)
    plant.set_params(row, np.array([[1.0]]))
    plant.reset(row, np.zeros((1, 1)), np.full((1, 1), 10.0), np.zeros(1, np.uint64))
    plant.step(None, np.array([[-9.0]]), 1000)
    assert plant.qvel[0, 0] == pytest.approx(10.0 - 0.5 / INERTIA * 0.1, rel=1e-6)


def test_a_lagging_torque_builds_up_exponentially() -> None:
    """After the first substep's step command: w = u / J (t - T (1 - exp(-t / T)))."""
    lag = 0.05
    effect = make("actuator_lag", where="m")
    text = WHEEL.format(dt=DT, joint="", actuator=MOTOR.format(gear=1, limit=""))
    plant = Plant(mujoco.MjSpec.from_string(text), [effect], 1, 1)
    row = np.zeros(1, int)
    plant.set_params(row, np.array([[lag]]))
    plant.reset(row, np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, np.uint64))
    plant.step(None, np.zeros((1, 1)), 1)  # at rest, from where the torque starts
    plant.step(None, np.array([[0.3]]), 2000)
    time = 2000 * DT
    expected = 0.3 / INERTIA * (time - lag * (1 - np.exp(-time / lag)))
    assert plant.qvel[0, 0] == pytest.approx(expected, rel=5e-3)


def test_a_lag_stays_within_the_torque_limit() -> None:
    """What it follows is the limited torque, so that it never exceeds it."""
    motor = MOTOR.format(gear=1, limit='forcerange="-0.2 0.2"')
    _, _, force = run(make("actuator_lag", where="m"), 0.01, motor, 5.0, 0.1)
    assert force.max() == pytest.approx(0.2, rel=1e-3) and force.max() <= 0.2 + 1e-12


SERVO = '<position name="m" joint="hub" kp="4" {limit}/>'


def test_a_held_servo_pushes_harder_in_proportion_to_time() -> None:
    """A joint that cannot move: force = kp e (1 + value t)."""
    stuck = 'armature="1e9"'
    servo = SERVO.format(limit="")
    time, _, force = run(make("integral_action", where="m"), 2.0, servo, 0.1, 1.0, stuck)
    assert force == pytest.approx(4 * 0.1 * (1 + 2.0 * time), rel=1e-3)
    before = make("integral_action", where="m", held=0.03)  # rad, from before the episode
    _, _, carried = run(before, 2.0, servo, 0.1, 1.0, stuck)
    assert carried - force == pytest.approx(4 * 0.03, rel=1e-3)


def test_the_sum_stands_still_at_the_torque_limit() -> None:
    """It does not wind up: at the limit the force is the limit, and the sum stays as it was."""
    text = WHEEL.format(
        dt=DT, joint='armature="1e9"', actuator=SERVO.format(limit='forcerange="-0.5 0.5"')
    )
    plant = Plant(mujoco.MjSpec.from_string(text), [make("integral_action", where="m")], 1, 1)
    row = np.zeros(1, int)
    plant.set_params(row, np.array([[2.0]]))
    plant.reset(row, np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, np.uint64))
    force = plant.batch.bind("actuator_force")
    plant.step(None, np.array([[0.1]]), 20000)
    assert force[0, 0] == pytest.approx(0.5)
    plant.step(None, np.array([[0.0]]), 1)
    assert force[0, 0] == pytest.approx(0.1, abs=2e-3)  # what the sum had reached: 0.5 - kp 0.1


def test_a_drive_without_what_it_needs_is_refused() -> None:
    """A knee needs a limit that can fall, an integral term a position loop."""
    text = WHEEL.format(dt=DT, joint="", actuator=MOTOR.format(gear=1, limit=""))
    for name in ("torque_speed_knee", "integral_action"):
        with pytest.raises(EffectError, match=f"'m' cannot have {name}; it can have: .*torque"):
            Plant(mujoco.MjSpec.from_string(text), [make(name, where="m")], 1, 1)
