"""What an IMU says that is mounted askew, late, biased or scaled, against rotations known."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from envs.effects import RobotScale, make
from envs.effects.imu import inverse, product, rotated, turn_by
from envs.errors import EffectError
from envs.plant import Plant
from envs.replay.rollout import rollout
from envs.tasks.servo.base import ASSETS

IDS, SEEDS = np.arange(1), np.zeros(1, np.uint64)
VALUES = {
    "imu_mounting": [0.06, -0.03, 0.02],
    "imu_delay": [0.012],
    "gyro_bias": [0.1, -0.2, 0.05],
    "gyro_scale": [1.3],
}


def quad8(*names: str) -> Plant:
    """Return a standing quad8 with effects, its IMU as they make it."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / "quad8.xml"))
    return Plant(spec, [make(name) for name in names], 1, 1)


def started(plant: Plant, values: list[float], measured: bool = False) -> tuple:
    """Put a plant into a turned, turning start, and return it, (nq,) and (nv,)."""
    model = plant.nominal
    qpos, qvel = model.key("home").qpos.copy(), np.zeros(model.nv)
    qpos[3:7] = Rotation.from_rotvec([0.1, 0.05, 0.4]).as_quat(scalar_first=True)
    qvel[3:6] = [0.8, -0.5, 0.3]
    plant.set_params(IDS, np.array([values]))
    plant.reset(IDS, qpos[None], qvel[None], SEEDS, model.key("home").ctrl[None], measured)
    return qpos, qvel


def test_quaternions_are_those_of_a_library() -> None:
    """Turns, products, inverses and rotated vectors, many at once."""
    rng = np.random.default_rng(0)
    one, other, vectors = rng.normal(size=(3, 20, 3))
    a, b = Rotation.from_rotvec(one), Rotation.from_rotvec(other)
    expected = (a * b).as_matrix()
    found = product(turn_by(one), turn_by(other))
    np.testing.assert_allclose(Rotation.from_quat(found, scalar_first=True).as_matrix(), expected)
    np.testing.assert_allclose(rotated(turn_by(one), vectors), a.apply(vectors))
    np.testing.assert_allclose(rotated(inverse(turn_by(one)), vectors), a.inv().apply(vectors))
    np.testing.assert_array_equal(turn_by(np.zeros(3)), [1, 0, 0, 0])


def test_a_mounting_turns_what_is_measured_and_nothing_else() -> None:
    """The orientation is the true one times the rotation; the gyro's axes are the part's."""
    plant = quad8("imu_mounting")
    qpos, qvel = started(plant, VALUES["imu_mounting"])
    said, spin = (values[0] for values in plant.measured(None))
    mount = Rotation.from_rotvec(VALUES["imu_mounting"])
    true = Rotation.from_quat(qpos[3:7], scalar_first=True)
    off = Rotation.from_quat(said[3:7], scalar_first=True).inv() * (true * mount)
    assert off.magnitude() < 1e-12
    np.testing.assert_allclose(spin[3:6], mount.inv().apply(qvel[3:6]))
    np.testing.assert_array_equal(said[7:], qpos[7:])
    np.testing.assert_array_equal(said[:3], qpos[:3])


@pytest.mark.parametrize("name", ["gyro_bias", "gyro_scale", "imu_mounting"])
def test_a_start_as_measured_is_measured_as_it_was(name: str) -> None:
    """What replays start from is turned into the truth, so that the sensors say it again."""
    plant = quad8(name)
    qpos, qvel = started(plant, VALUES[name], measured=True)
    said, spin = (values[0] for values in plant.measured(None))
    np.testing.assert_allclose(said[3:7], qpos[3:7], atol=1e-12)
    np.testing.assert_allclose(spin[3:6], qvel[3:6], atol=1e-12)
    assert np.allclose(plant.qpos[0, 3:7], qpos[3:7]) != (name == "imu_mounting")


@pytest.mark.parametrize("name", list(VALUES))
def test_a_neutral_effect_is_absent(name: str) -> None:
    """At neutral values what is measured is the truth, bit for bit."""
    plant, plain = quad8(name), quad8()
    for one, values in ((plant, plant.space.neutral.tolist()), (plain, [])):
        started(one, values)
        assert not one.step(None, one.nominal.key("home").ctrl[None], 20).any()
    for said, true in zip(plant.measured(None), (plain.qpos, plain.qvel), strict=True):
        np.testing.assert_array_equal(said, true)


def test_a_base_that_is_turned_back_stays_on_the_ground() -> None:
    """Its lowest sole is as high as with the turn that the IMU said."""
    plant = quad8("imu_mounting")
    qpos, _ = started(plant, [0.1, 0.0, 0.0], measured=True)
    model, data, low = plant.nominal, mujoco.MjData(plant.nominal), []
    feet = [i for i in range(model.ngeom) if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_SPHERE]
    for pose in (qpos, plant.qpos[0]):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        low.append(float((data.geom_xpos[feet, 2] - model.geom_size[feet, 0]).min()))
    assert abs(plant.qpos[0, 2] - qpos[2]) > 1e-3
    assert low[1] == pytest.approx(low[0], abs=1e-3)


def test_a_late_imu_says_what_was_true_before() -> None:
    """Along a path the turn is that of 12 ms ago; joints are not late."""
    plain, late = quad8(), quad8("imu_delay")
    steps = 60
    paths = []
    for plant, values in ((plain, []), (late, VALUES["imu_delay"])):
        started(plant, values)
        ctrl = np.tile(plant.nominal.key("home").ctrl, (1, steps, 1))
        paths.append(rollout(plant, ctrl)[0])
    shift = round(VALUES["imu_delay"][0] / plain.nominal.opt.timestep)
    np.testing.assert_allclose(paths[1][shift:, 3:7], paths[0][:-shift, 3:7], atol=1e-9)
    np.testing.assert_array_equal(paths[1][:, 7:], paths[0][:, 7:])
    assert np.abs(np.diff(paths[0][:, 3:7], axis=0)).max() > 1e-4


def test_bias_and_scale_are_the_gyros_alone() -> None:
    """Measured speed is true times scale plus bias; the orientation stays."""
    plant = quad8("gyro_scale", "gyro_bias")
    qpos, qvel = started(plant, [*VALUES["gyro_scale"], *VALUES["gyro_bias"]])
    said, spin = (values[0] for values in plant.measured(None))
    np.testing.assert_allclose(spin[3:6], 1.3 * qvel[3:6] + VALUES["gyro_bias"])
    np.testing.assert_array_equal(said, qpos)
    np.testing.assert_array_equal(spin[6:], qvel[6:])


def test_only_a_floating_base_with_an_imu_has_them() -> None:
    """An arm is refused; a search tries them where an IMU says how the base turns."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / "bench1.xml"))
    for name in VALUES:
        with pytest.raises(EffectError, match="no free joint"):
            Plant(spec, [make(name)], 1, 1)
    model = quad8().nominal
    for feels in (False, True):
        scale = RobotScale(model, feels=feels)
        assert bool(make("imu_mounting").variants(scale)) == feels
    for name, values in VALUES.items():
        probes = make(name).probes(scale)
        moved = np.abs(probes.reshape(len(probes), -1) - (name == "gyro_scale")).max(axis=0)
        assert len(moved) == len(values) and (moved > 0).all()  # a fit starts with each of them
