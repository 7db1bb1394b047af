"""The estimate of a base against the true one of a simulation."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim2real.diagnosis.ground.estimate import Estimate, estimated
from sim2real.diagnosis.settings import DEFAULT
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis.ground.walk import Walk, hops, stretch, sway, trot, without


@pytest.fixture(scope="module")
def walk() -> Walk:
    """Return three seconds of a trot."""
    return trot()


def of(walk: Walk, *kinds: str) -> Estimate:
    """Return the estimate from a log without some channels."""
    found = estimated(without(walk.log, *kinds), walk.model, DEFAULT.ground)
    assert found is not None
    return found


def tilt(found: Estimate, walk: Walk) -> np.ndarray:
    """Return by how many degrees the upward direction is off, (T,)."""
    up = [
        Rotation.from_quat(q[:, 3:7], scalar_first=True).inv().apply([0.0, 0.0, 1.0])
        for q in (found.qpos, walk.qpos)
    ]
    return np.degrees(np.arccos(np.clip((up[0] * up[1]).sum(axis=1), -1.0, 1.0)))


def test_orientation_height_and_speed_are_near_the_truth(walk: Walk) -> None:
    """Within a degree, 3 mm and 0.1 m/s, while the base moves faster and farther than that."""
    found = of(walk, "accelerometer")
    assert tilt(found, walk).max() < 1.0
    assert np.sqrt(np.mean((found.qpos[:, 2] - walk.qpos[:, 2]) ** 2)) < 0.003
    wrong = found.qvel[:, :3] - walk.qvel[:, :3]
    stance = found.walk.touch.max(axis=1) > 0.5
    assert np.sqrt(np.mean(wrong[stance] ** 2, axis=0)).max() < 0.1
    assert np.abs(walk.qvel[:, :3]).max() > 0.2


def test_an_accelerometer_makes_the_speed_no_worse(walk: Walk) -> None:
    """The same channels and one more."""
    off = [
        np.sqrt(np.mean((of(walk, *kinds).qvel[:, :3] - walk.qvel[:, :3]) ** 2))
        for kinds in ((), ("accelerometer",))
    ]
    assert off[0] < 1.1 * off[1]


def test_gyro_and_accelerometer_take_the_place_of_an_orientation(walk: Walk) -> None:
    """The tilt is then integrated, and brought upright by what is felt."""
    found = of(walk, "quat")
    assert np.sqrt(np.mean(tilt(found, walk) ** 2)) < 3.0
    assert np.allclose(found.qvel[:, 3:6], walk.qvel[:, 3:6], atol=1e-6)


def test_an_orientation_alone_tells_the_angular_velocity(walk: Walk) -> None:
    """By its slope."""
    found = of(walk, "gyro", "accelerometer")
    wrong = found.qvel[2:-2, 3:6] - walk.qvel[2:-2, 3:6]
    assert np.sqrt(np.mean(wrong**2)) < 0.3 * np.sqrt(np.mean(walk.qvel[:, 3:6] ** 2))


def test_the_log_holds_the_base_as_if_it_had_been_measured(walk: Walk) -> None:
    """Seven positions and six speeds of the free joint; the rest is as it was."""
    found = of(walk)
    for k in range(7):
        assert np.array_equal(found.log.column(f"qpos.root.{k}"), found.qpos[:, k])
    assert "qvel.root.5" in found.log.columns
    assert estimated(found.log, walk.model, DEFAULT.ground) is None


def test_without_an_imu_a_free_base_is_refused(walk: Walk) -> None:
    """The message names the columns that would do."""
    with pytest.raises(Sim2RealError, match=r"`quat.imu.w` to `.z`, or"):
        estimated(without(walk.log, "quat", "gyro", "accelerometer"), walk.model, DEFAULT.ground)
    with pytest.raises(Sim2RealError, match="neither"):
        estimated(without(walk.log, "quat", "accelerometer"), walk.model, DEFAULT.ground)


def test_a_robot_that_rests_needs_no_imu() -> None:
    """The plane of its feet is the ground: encoders alone, as `record` writes them."""
    walk = sway()
    found = of(walk, "quat", "gyro", "accelerometer")
    assert not found.felt
    assert tilt(found, walk).max() < 1.0
    assert np.sqrt(np.mean((found.qpos[:, 2] - walk.qpos[:, 2]) ** 2)) < 0.003


def test_a_boom_needs_no_imu() -> None:
    """Its slides follow from the foot while it stands."""
    walk = hops()
    found = estimated(walk.log, walk.model, DEFAULT.ground)
    assert found is not None
    assert not found.base.is_free
    stands = found.walk.touch[:, -1] > 0.5
    high = _gaps(walk)
    assert stands[high < 0.0].mean() > 0.9
    assert stands[high > 0.015].mean() < 0.2
    assert (high > 0.015).mean() > 0.1
    off = np.abs(found.qpos[:, 1] - walk.qpos[:, 1])[stands & (high < 0.002)]
    assert np.sqrt(np.mean(off**2)) < 0.004
    climb = (found.qvel[:, 1] - walk.qvel[:, 1])[stands]
    assert np.sqrt(np.mean(climb**2)) < 0.15


def _gaps(walk: Walk) -> np.ndarray:
    """Return how far hopper2's foot is above the ground [m], (T,)."""
    data, found = mujoco.MjData(walk.model), []
    foot = walk.model.geom("foot")
    for pose in walk.qpos:
        data.qpos[:] = pose
        mujoco.mj_kinematics(walk.model, data)
        found.append(data.geom_xpos[foot.id][2] - foot.size[0])
    return np.array(found)


def test_a_base_is_the_less_sure_the_longer_no_sole_stands() -> None:
    """In the middle of a flight more than at its ends, and least in stance."""
    walk = hops()
    found = estimated(walk.log, walk.model, DEFAULT.ground)
    assert found is not None
    unsure = found.walk.unsure[:, -1]
    stands = found.walk.touch.max(axis=1) > 0.9
    rows = np.arange(len(stands))
    away = np.abs(rows[:, None] - rows[stands]).min(axis=1)  # rows from the nearest stance
    assert away.max() >= 4
    assert unsure[away >= 4].mean() > unsure[away == 2].mean() > unsure[away == 0].mean()


def test_a_sole_that_slips_is_told() -> None:
    """More of the time on ice than on a ground that grips."""
    slid = []
    for friction in (0.2, 3.0):
        walk = stretch(friction)
        found = of(walk, "accelerometer")
        on = found.walk.touch > 0.5
        slid.append(float((found.walk.slip[on] > DEFAULT.ground.slip_m_s).mean()))
    assert slid[0] > slid[1] + 0.1
