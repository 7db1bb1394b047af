"""Effects that only a camera sees."""

import numpy as np
import pytest

from envs.effects import make
from envs.errors import EffectError
from envs.simulation import Simulation
from envs.tasks import Hopper, InvertedPendulum

LOOKS = ("colour", "light_level", "light_direction", "camera_shift", "camera_turn")


def test_the_physics_does_not_notice() -> None:
    """With the wildest looks Hopper moves as without, to the last bit."""
    effects = [make(name, where="torso" if name == "colour" else None) for name in LOOKS]
    ends = []
    for some in ((), effects):
        simulation = Simulation(Hopper(), 2, some)
        values = simulation.space.points(2) + 0.7
        simulation.reset(np.arange(2), values, np.arange(2).astype(np.uint64))
        for _ in range(20):
            simulation.step(None, np.full((2, 3), 0.5))
        ends.append(simulation.plant.qpos.copy())
    np.testing.assert_array_equal(ends[0], ends[1])


def test_a_camera_that_turns_right_sees_to_its_right() -> None:
    """Half a turn looks back; a quarter to the right looks along the camera's own right."""
    simulation = Simulation(Hopper(), 3, [make("camera_turn")])
    axes = simulation.plant.batch.bind("cam_xmat")
    values = np.array([[0.0, 0.0], [np.pi / 2, 0.0], [0.0, np.pi / 4]])
    simulation.reset(np.arange(3), values, np.zeros(3, np.uint64))
    frames = axes[:, 0].reshape(3, 3, 3)  # columns: right, up, back
    np.testing.assert_allclose(-frames[1][:, 2], frames[0][:, 0], atol=1e-12)
    up = (-frames[0][:, 2] + frames[0][:, 1]) / np.sqrt(2)
    np.testing.assert_allclose(-frames[2][:, 2], up, atol=1e-12)


def test_lights_turn_about_the_worlds_axes() -> None:
    """A light from above that is turned about x by a quarter shines along +y."""
    simulation = Simulation(Hopper(), 1, [make("light_direction")])
    beams = simulation.plant.batch.bind("light_xdir")
    simulation.reset(np.arange(1), np.array([[np.pi / 2, 0.0]]), np.zeros(1, np.uint64))
    np.testing.assert_allclose(beams[0, 0], [0.0, 1.0, 0.0], atol=1e-9)


def test_what_has_no_camera_or_light_is_told() -> None:
    """An effect on what the model lacks is refused by name."""
    with pytest.raises(EffectError, match="the model has no camera; add one"):
        Simulation(InvertedPendulum(), 1, [make("camera_shift")])
