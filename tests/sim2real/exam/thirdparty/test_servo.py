"""A servo's firmware and motor."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim2real.exam.thirdparty.servo import Firmware, Motor, Servo

SERVO = Servo(kp=10.0, kd=0.5, limit=2.0)


def test_the_loop_is_stiff_damped_and_limited() -> None:
    """Torque per error at rest, less with speed, never beyond the limit."""
    firmware = Firmware(SERVO, 0.0005, home=0.0)
    assert firmware.tick(0.1, 0.0) == pytest.approx(1.0)
    assert firmware.tick(5.0, 0.0) == 2.0
    firmware = Firmware(SERVO, 0.0005, home=0.0)
    demands = [firmware.tick(0.0, 0.0005 * k) for k in range(200)]  # 1 rad/s
    assert demands[-1] == pytest.approx(-10 * 0.0005 * 199 - 0.5, rel=0.05)


def test_the_encoder_counts() -> None:
    """The loop knows angles to one count."""
    firmware = Firmware(replace(SERVO, kd=0.0, counts=100), 0.0005, home=0.0)
    count = 2 * math.pi / 100
    assert firmware.tick(0.0, 0.4 * count) == 0.0
    assert firmware.tick(0.0, 0.6 * count) == pytest.approx(-10 * count)


def test_a_profile_limits_speed_and_acceleration() -> None:
    """The goal moves as a trapezoid: never faster, never sharper, and it arrives."""
    servo = replace(SERVO, kd=0.0, limit=math.inf, fastest=2.0, sharpest=10.0)
    firmware = Firmware(servo, 0.001, home=0.0)
    goal = np.array([firmware.tick(1.0, 0.0) for _ in range(2000)]) / servo.kp
    speed = np.diff(goal) / 0.001
    assert speed.max() == pytest.approx(2.0, rel=0.01)
    assert np.abs(np.diff(speed)).max() / 0.001 < 10.1
    assert goal[-1] == pytest.approx(1.0, abs=1e-3)


def test_dead_zone_and_integral() -> None:
    """Small errors are ignored; the integral grows with time."""
    assert Firmware(replace(SERVO, dead_zone=0.2), 0.001, 0.0).tick(0.1, 0.0) == 0.0
    firmware = Firmware(replace(SERVO, ki=5.0), 0.001, 0.0)
    demands = [firmware.tick(0.1, 0.0) for _ in range(1001)]
    assert demands[-1] - demands[0] == pytest.approx(0.5)


def test_motors() -> None:
    """Back-EMF brakes, a knee ends at the no-load speed, a hot motor weakens, a lag is slow."""
    assert Motor(replace(SERVO, braking=0.3), 0.001)(1.0, 2.0) == pytest.approx(0.4)
    knee = Motor(replace(SERVO, stall=2.0, no_load=4.0), 0.001)
    assert knee(2.0, 2.0) == pytest.approx(1.0)
    assert knee(2.0, 5.0) == 0.0
    assert knee(-2.0, 2.0) == -2.0
    hot = Motor(replace(SERVO, heating=0.01), 0.001)
    assert [hot(2.0, 0.0) for _ in range(5001)][-1] == pytest.approx(2 * 0.84, rel=0.02)
    slow = Motor(replace(SERVO, lag=0.01), 0.001)
    assert [slow(1.0, 0.0) for _ in range(10)][-1] == pytest.approx(1 - math.exp(-1))
    weak = Motor(replace(SERVO, strength=0.8, supply=0.9), 0.001)
    assert weak(2.0, 0.0) == pytest.approx(2 * 0.8 * 0.9)
