import numpy as np
import pytest

from envs.replay import rollout

MOTOR = '<motor name="servo" joint="hinge"/>'


def test_it_says_a_sine_of_the_angle_too_much(bench, one) -> None:
    """Also along whole paths, and its speed is the slope of what it says."""
    value, phase = 0.03, 0.7
    arm = bench([one("encoder_eccentricity", phase=phase)], [[value]], MOTOR)
    arm.reset(w=2.0)
    true, measured = arm.run(np.zeros(3000))
    assert np.ptp(true) > 5.0
    assert measured == pytest.approx(true + value * np.sin(true + phase), abs=1e-12)
    speed = arm.plant.measured(None)[1][0, 0]
    assert speed == pytest.approx((measured[-1, 0] - measured[-2, 0]) / 1e-3, rel=1e-3)
    arm.reset(w=2.0)
    assert rollout(arm.plant, np.zeros((1, 3000, 1)))[0, 1:] == pytest.approx(measured, abs=1e-12)


def test_a_servo_goes_where_its_encoder_says_the_goal_is(bench, one) -> None:
    """Without load it rests at an angle that reads as the goal."""
    value, phase = 0.05, -0.4
    arm = bench([one("encoder_eccentricity", phase=phase)], [[value]])
    arm.reset()
    for goal in (-1.2, 0.0, 0.9):
        true = arm.hold(goal, 3.0)[0]
        assert true + value * np.sin(true + phase) == pytest.approx(goal, abs=1e-6)


def test_a_measured_start_is_where_the_encoder_says(bench, one) -> None:
    """Readings become true angles and back."""
    arm = bench([one("encoder_eccentricity", phase=1.0)], [[0.1], [0.5]], MOTOR)
    arm.reset(0.8, measured=True)
    assert arm.plant.measured(None)[0][:, 0] == pytest.approx(0.8, abs=1e-9)
    assert np.abs(arm.plant.qpos[:, 0] - 0.8).min() > 0.05
