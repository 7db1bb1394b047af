"""Speeds at a start: averaged where motion is slow, followed where it is fast, and how unsure."""

import numpy as np
import pytest

from sim2real.diagnosis.data.speeds import NEAR, motion_at

STEP = 0.02  # s
TIME = STEP * np.arange(200)
NOISE = 5e-4  # rad
LINE = NOISE / STEP / np.sqrt(2 * sum(k**2 for k in range(1, NEAR + 1)))  # of a line's slope
ROWS = range(60, 140)


def errors(hertz: float, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much speeds of a noisy swing are off, and how unsure they are, (n,) each."""
    rng, off = np.random.default_rng(1), []
    pulse = 2 * np.pi * hertz
    for _ in range(5):
        swing = size * np.sin(pulse * TIME) + rng.normal(0.0, NOISE, len(TIME))
        for row in ROWS:
            _, (speed,), (unsure,) = motion_at(TIME, swing[:, None], row)
            off.append((speed - size * pulse * np.cos(pulse * TIME[row]), unsure))
    speed, unsure = np.array(off).T
    return speed, unsure


@pytest.mark.parametrize(
    ("hertz", "size", "most"),
    [(0.1, 0.2, 1.2), (1.0, 1.0, 4.0), (3.0, 1.0, 5.0)],  # a line alone: 1.0, 12, 300 times LINE
)
def test_noise_is_averaged_and_a_fast_swing_is_followed(
    hertz: float, size: float, most: float
) -> None:
    """Errors are as large as they are said to be, or smaller where motion passes for noise."""
    off, unsure = errors(hertz, size)
    assert np.sqrt(np.mean(off**2)) < most * LINE
    assert 0.3 < np.sqrt(np.mean((off / unsure) ** 2)) < 1.3


@pytest.mark.parametrize("after", [-0.008, 0.0, 0.01])
def test_a_swing_goes_on_between_readings(after: float) -> None:
    """By its speed and acceleration, whose change is left out: 4e-5 rad and 0.012 rad/s here."""
    pulse, row = 2 * np.pi * 1.0, 100
    (moved,), (speed,), _ = motion_at(TIME, np.sin(pulse * TIME)[:, None], row, after)
    assert moved == pytest.approx(
        np.sin(pulse * (TIME[row] + after)) - np.sin(pulse * TIME[row]), abs=2e-4
    )
    assert speed == pytest.approx(pulse * np.cos(pulse * (TIME[row] + after)), abs=3e-2)


def test_a_joint_that_rests_has_no_speed() -> None:
    """And is sure of it."""
    _, speed, unsure = motion_at(TIME, np.full((len(TIME), 1), 0.3), 100)
    assert speed == pytest.approx([0.0]) and unsure == pytest.approx([0.0])


def test_a_missing_reading_does_not_pass_for_a_jerk() -> None:
    """One reading that is off counts as noise."""
    slow = 0.1 * TIME
    slow[90] += 0.01
    _, (speed,), (unsure,) = motion_at(TIME, slow[:, None], 100)
    assert speed == pytest.approx(0.1, abs=unsure)


def test_few_readings_tell_what_they_can() -> None:
    """Two or three rows have a slope."""
    for rows in (2, 3):
        _, speed, _ = motion_at(TIME[:rows], 0.5 * TIME[:rows, None], 0)
        assert speed == pytest.approx([0.5])


def test_a_base_turns_in_its_own_frame() -> None:
    """A pose's speed is its linear velocity, and its rotation's as its body sees it."""
    turned = 3.0 * TIME  # about its own x, which points along the world's z
    stand = np.array([np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0])
    poses = []
    for k, angle in enumerate(turned):
        w, x, y, z = stand
        c, s = np.cos(angle / 2), np.sin(angle / 2)
        own = [w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s]
        poses.append([0.2 * TIME[k], 0.0, 0.0, *own])
    _, speed, _ = motion_at(TIME, np.array(poses), 100)
    assert speed == pytest.approx([0.2, 0, 0, 3.0, 0, 0], abs=1e-6)
