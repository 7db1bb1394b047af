"""What is said of an IMU and of feet, from walks whose faults are planted."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hardware.log import Log
from sim2real.diagnosis.ground.estimate import estimated
from sim2real.diagnosis.ground.findings import check_ground
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis.ground.walk import Walk, stretch, trot, without

Change = Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def walk() -> Walk:
    """Return three seconds of a trot."""
    return trot()


def found(walk: Walk, change: Change = dict) -> list[Finding]:
    """Return what is said of a walk whose columns are changed."""
    plain = without(walk.log, "accelerometer")
    log: Log = replace(plain, columns={**plain.columns, **change(dict(plain.columns))})
    estimate = estimated(log, walk.model, DEFAULT.ground)
    assert estimate is not None
    return check_ground([estimate], [walk.model], DEFAULT.ground)


def said(findings: list[Finding], check: str) -> dict[str | None, str]:
    """Return what the findings of a check say, by place."""
    return {f.where: f.finding for f in findings if f.check == check}


def test_a_sound_imu_is_not_blamed(walk: Walk) -> None:
    """Only that the base was estimated, and how sure that is."""
    findings = found(walk)
    assert list(said(findings, "base")) == ["root"]
    assert said(findings, "imu") == {}


def test_a_bias_a_scale_and_a_latency_of_the_gyro_are_told(walk: Walk) -> None:
    """Each at its axis, with its value."""

    def faulty(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        late = np.interp(columns["time"] - 0.012, columns["time"], columns["gyro.imu.x"])
        return {
            "gyro.imu.x": late,
            "gyro.imu.y": 1.3 * columns["gyro.imu.y"],
            "gyro.imu.z": columns["gyro.imu.z"] + 0.1,
        }

    told = said(found(walk, faulty), "imu")
    assert "ms behind" in told["gyro.x"]
    assert "times too large" in told["gyro.y"]
    assert "is off by 0." in told["gyro.z"]


def test_an_imu_that_is_mounted_askew_is_told(walk: Walk) -> None:
    """By the plane of the feet that stand: 0.05 rad about y."""

    def turned(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        names = [f"quat.imu.{axis}" for axis in "wxyz"]
        own = Rotation.from_quat(np.column_stack([columns[n] for n in names]), scalar_first=True)
        askew = (own * Rotation.from_rotvec([0.0, 0.05, 0.0])).as_quat(scalar_first=True)
        return dict(zip(names, askew.T, strict=True))

    told = said(found(walk, turned), "imu")["orientation"]
    assert "0.0 rad" not in told
    about = [float(part) for part in re.findall(r"-?0\.\d+|-?\d\.?\d*e-\d+", told)[:2]]
    assert np.allclose(np.abs(about), [0.0, 0.05], atol=0.015)


def test_feet_that_slip_are_named() -> None:
    """Front legs drawn against back legs, on ice."""
    assert "foot_fl" in said(found(stretch(0.1)), "slip")[None]
    gripped = said(found(stretch(3.0)), "slip").get(None, "")
    assert "foot_bl" not in gripped
