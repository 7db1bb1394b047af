"""Rows that bring their own gains, beside a loop over MuJoCo written by hand."""

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.errors import TaskError
from envs.plant import Plant
from envs.replay import Recording, replay, switchable, with_impedance, without_impedance

LEG = """<mujoco>
  <option timestep="0.002" integrator="{integrator}"/>
  <worldbody><body name="thigh"><joint name="hip" axis="0 1 0" armature="0.01" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/>
    <body name="shank" pos="0 0 -0.2"><joint name="knee" axis="0 1 0" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/></body></body>
  </worldbody>
  <actuator><motor name="hip" joint="hip" ctrlrange="-6 6"/>
    <motor name="knee" joint="knee" forcerange="-2 2" gear="2"/></actuator>
</mujoco>"""
GEAR, LIMIT = np.array([1.0, 2.0]), np.array([6.0, 4.0])  # limit at the joint, N·m
START = np.array([0.3, -0.5])


def rows(seed: int, count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Return desired positions (T, 2) and laws at the joints (T, 2, 4), at 100 Hz."""
    rng = np.random.default_rng(seed)
    goal = rng.uniform(-0.8, 0.8, (count // 25, 2)).repeat(25, axis=0)
    low, high = np.array([0.0, 0.0, -3.0, -1.0]), np.array([20.0, 0.6, 3.0, 1.0])
    law = rng.uniform(low, high, (count // 10, 2, 4)).repeat(10, axis=0)
    law[:30, 0, :2] = 0.0  # at first the hip is free but for its feed-forward
    return goal, law


def replayed(
    integrator: str, count: int = 200, delay: float = 0.0, **strength: float
) -> np.ndarray:
    """Return what the replay makes of the rows, (T, 2)."""
    goal, law = rows(0, count)
    spec = mujoco.MjSpec.from_string(LEG.format(integrator=integrator))
    gains = {name: (10.0 / g**2, 0.3 / g**2) for name, g in zip(("hip", "knee"), GEAR, strict=True)}
    own = law * np.stack([1 / GEAR**2, 1 / GEAR**2, GEAR, 1 / GEAR], axis=1)
    fixed = [(make("motor_strength", where=n), (v,)) for n, v in strength.items()]
    fixed += [(make("command_delay"), (delay,))] if delay else []
    plant = Plant(switchable(with_impedance(spec, gains)), fixed=fixed, threads=1)
    time = np.arange(count) * 0.01
    recording = Recording(time, goal * GEAR, START, np.zeros(2), law=own)
    return replay(plant, [recording])[0]


def by_hand(integrator: str, late: int = 0, strength: float = 1.0) -> np.ndarray:
    """Return the same of a loop over `mj_step`.

    Under Euler the law is a torque on the motors; the implicit integrators know its damping, so
    there the actuators' own entries are written before each step.
    """
    goal, law = rows(0)
    model = mujoco.MjModel.from_xml_string(LEG.format(integrator=integrator))
    data, found = mujoco.MjData(model), [START.copy()]
    data.qpos[:] = START
    implicit = integrator != "Euler"
    model.actuator_forcelimited[:], model.actuator_ctrllimited[:] = True, False
    limit = (LIMIT / GEAR * [strength, 1.0])[:, None] * [-1, 1]
    model.actuator_forcerange[:] = limit
    for step in range(199 * 5):
        row = max(step - late, 0) // 5
        kp, kd, speed, forward = law[row].T
        factor = np.array([strength, 1.0])
        if implicit:
            model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_AFFINE
            model.actuator_gainprm[:, 0] = factor * kp / GEAR
            model.actuator_biasprm[:, 0] = factor * (kd * speed + forward) / GEAR
            model.actuator_biasprm[:, 1] = -factor * kp / GEAR**2
            model.actuator_biasprm[:, 2] = -factor * kd / GEAR**2
            data.ctrl[:] = goal[row]
        else:
            torque = kp * (goal[row] - data.qpos) + kd * (speed - data.qvel) + forward
            data.ctrl[:] = factor * torque / GEAR
        mujoco.mj_step(model, data)
        if step % 5 == 4:
            found.append(data.qpos.copy())
    return np.array(found)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_rows_with_gains_are_replayed_exactly(integrator: str) -> None:
    """Gains, desired speeds and feed-forward of each row, limits and gears included."""
    hand = by_hand(integrator)
    assert np.ptp(hand, axis=0).min() > 0.5
    assert replayed(integrator) == pytest.approx(hand, abs=1e-9)


def test_a_strength_scales_the_whole_torque() -> None:
    """Also the feed-forward, and the limit."""
    assert replayed("implicitfast", hip=0.7) == pytest.approx(
        by_hand("implicitfast", strength=0.7), abs=1e-9
    )


def test_a_delay_is_that_of_the_whole_row() -> None:
    """The gains and the feed-forward come as late as the desired position."""
    late = replayed("implicitfast", delay=0.02)
    assert late == pytest.approx(by_hand("implicitfast", late=10), abs=1e-9)


def test_without_rows_of_gains_it_is_a_servo() -> None:
    """The reference gains hold, and nothing pushes."""
    spec = mujoco.MjSpec.from_string(LEG.format(integrator="implicitfast"))
    gains = {"hip": (10.0, 0.3), "knee": (2.5, 0.1)}
    paths = []
    for made in (with_impedance(spec, gains), without_impedance(with_impedance(spec, gains))):
        time, goal = np.arange(100) * 0.01, np.tile([0.2, -0.4], (100, 1))
        recording = Recording(time, goal, START, np.zeros(2))
        paths.append(replay(Plant(switchable(made), threads=1), [recording])[0])
    assert paths[0] == pytest.approx(paths[1], abs=1e-12)


def test_an_actuator_of_another_kind_is_refused() -> None:
    """A muscle has no gain that a row could set."""
    text = LEG.format(integrator="Euler").replace(
        '<motor name="hip" joint="hip" ctrlrange="-6 6"/>',
        '<muscle name="hip" joint="hip" lengthrange="-1 1"/>',
    )
    with pytest.raises(TaskError, match="'hip' of the model cannot have impedance control"):
        with_impedance(mujoco.MjSpec.from_string(text), {"hip": (1.0, 0.1)})
