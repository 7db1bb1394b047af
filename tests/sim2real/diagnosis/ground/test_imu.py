"""A faulty IMU as a cause: windows that start without its fault follow, and it is a candidate."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import errors_as_given
from sim2real.diagnosis.ground.estimate import Estimate, estimate_all
from sim2real.diagnosis.ground.starts import clear_starts
from sim2real.diagnosis.ground.windows import grounded
from sim2real.diagnosis.inference.candidates import candidates
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis.ground.walk import trot, without

MOUNT = [0.05, -0.04, 0.0]
FAULTS = ("imu_mounting", "imu_delay", "gyro_bias", "gyro_scale")


@pytest.fixture(scope="module")
def log() -> Log:
    """Return a trot whose IMU says orientation and angular velocity."""
    return without(trot(seconds=1.5).log, "accelerometer")


def with_imu(log: Log, turn: Rotation, spin: np.ndarray) -> Log:
    """Return a log whose IMU says something else."""
    columns = dict(log.columns)
    for i, axis in enumerate("wxyz"):
        columns[f"quat.imu.{axis}"] = turn.as_quat(scalar_first=True)[:, i]
    for i, axis in enumerate("xyz"):
        columns[f"gyro.imu.{axis}"] = spin[:, i]
    return replace(log, columns=columns)


def said(log: Log) -> tuple[Rotation, np.ndarray]:
    """Return what a log's IMU says."""
    quaternion = np.column_stack([log.column(f"quat.imu.{axis}") for axis in "wxyz"])
    gyro = np.column_stack([log.column(f"gyro.imu.{axis}") for axis in "xyz"])
    return Rotation.from_quat(quaternion, scalar_first=True), gyro


def askew(log: Log) -> Log:
    """Return the log of an IMU that is mounted askew."""
    turn, spin = said(log)
    mount = Rotation.from_rotvec(MOUNT)
    return with_imu(log, turn * mount, mount.inv().apply(spin))


def late(log: Log) -> Log:
    """Return the log of an IMU that is one row late."""
    turn, spin = said(log)
    before = np.maximum(np.arange(len(spin)) - 1, 0)
    return with_imu(log, Rotation.from_quat(turn.as_quat()[before]), spin[before])


def left(estimates: list[Estimate], name: str | None, values: list[float]) -> float:
    """Return what windows leave with an effect in the model, root mean square [rad]."""
    fixed = [] if name is None else [(make(name), tuple(values))]
    data = grounded(Data.of([one.log for one in estimates]), estimates, fixed)
    error = errors_as_given(data, data.windows, fixed)
    assert data.starts is not None
    cleared = clear_starts(error, data.starts, DEFAULT.ground.error_rad)
    return float(np.sqrt(data.mean_squares(cleared).mean()))


@pytest.mark.slow
def test_an_imu_that_is_askew_is_not_blamed_on_the_ground(log: Log) -> None:
    """The mounting leaves a third of what the model as given leaves, or less; a slope does not."""
    seen = estimate_all([askew(log)], None, DEFAULT.ground)
    given, right = left(seen, None, []), left(seen, "imu_mounting", MOUNT)
    slope = min(left(seen, "gravity_tilt", [s * MOUNT[0], s * MOUNT[1]]) for s in (1, -1))
    assert right < given / 3
    assert right < slope / 2


@pytest.mark.slow
def test_an_imu_that_is_late_is_followed(log: Log) -> None:
    """With the delay of one row less than half is left."""
    seen = estimate_all([late(log)], None, DEFAULT.ground)
    given, right = left(seen, None, []), left(seen, "imu_delay", [0.02])
    assert right < given / 2


def test_faults_of_an_imu_are_candidates_where_it_is_compared(log: Log) -> None:
    """Beside friction and masses; not where the base was measured by something else."""
    estimates = estimate_all([log], None, DEFAULT.ground)
    plain = Data.of([one.log for one in estimates])
    found = {one.name: one for one in candidates(grounded(plain, estimates))}
    assert set(FAULTS) < set(found)
    assert all((found[name].step > 0).all() for name in FAULTS)
    assert not set(FAULTS) & {one.name for one in candidates(plain)}
