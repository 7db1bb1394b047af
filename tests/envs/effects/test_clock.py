import numpy as np
import pytest

from tests.envs.effects.conftest import CENTER, GRAVITY, INERTIA, MASS

MOTOR = '<motor name="servo" joint="hinge"/>'


def test_a_swing_takes_longer_on_a_clock_that_runs_fast(bench, one) -> None:
    """The small swing's period is 2 pi sqrt(I / m g r), times 1 + value on the log's clock."""
    values = np.array([0.0, 0.05, -0.03])
    arm = bench([one("clock_drift")], values[:, None], MOTOR, gravity=GRAVITY, armature=0.0)
    arm.reset(np.pi / 2 + 0.01)
    path = arm.run(np.zeros(6000))[0] - np.pi / 2
    true = 2 * np.pi * np.sqrt(INERTIA / (MASS * GRAVITY * CENTER))
    for one_path, value in zip(path.T, values, strict=True):
        turns = np.flatnonzero(np.diff(np.sign(one_path)))
        period = 2 * np.diff(turns).mean() * 1e-3
        assert period == pytest.approx(true * (1 + value), rel=2e-3)
