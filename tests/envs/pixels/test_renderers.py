"""Two ways to draw: rays and OpenGL."""

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.pixels.gl import GLRenderer
from envs.pixels.rays import RayRenderer
from envs.simulation import Simulation
from envs.tasks import Ant, HopperPolito, Task
from envs.tasks.base import State

SIZE = 84


def started(task: Task, rows: int = 4, steps: int = 5, effects: tuple = ()) -> Simulation:
    """Return a simulation whose rows have moved apart."""
    simulation = Simulation(task, rows, effects)
    every = np.arange(rows)
    simulation.reset(every, simulation.space.points(rows), every.astype(np.uint64))
    rng = np.random.default_rng(0)
    for _ in range(steps):
        simulation.step(None, rng.uniform(-1, 1, (rows, simulation.action_size)))
    return simulation


class Ball(HopperPolito):
    """A white ball of 0.5 m, 1 m above a black floor, 4 m before a camera at its height."""

    def spec(self) -> mujoco.MjSpec:
        """Return the scene."""
        return mujoco.MjSpec.from_string(
            """<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0"/></visual><worldbody>
            <geom type="plane" size="5 5 .1" rgba="0 0 0 1"/>
            <body name="torso" pos="0 0 1"><joint name="slide" type="slide" axis="1 0 0"/>
            <geom name="ball" size=".5" rgba="1 1 1 1"/></body>
            <camera name="track" pos="0 -4 1" xyaxes="1 0 0 0 0 1" fovy="45"/></worldbody>
            <actuator><motor joint="slide" ctrlrange="-1 1"/></actuator></mujoco>"""
        )

    def observe(self, state: State) -> np.ndarray:
        """Return the position."""
        return state.qpos


def test_a_ball_covers_the_pixels_that_geometry_says() -> None:
    """Its outline is the circle of angular radius asin(r / d); the floor begins at the horizon."""
    simulation = Simulation(Ball(), 1)
    simulation.reset(np.arange(1), np.zeros((1, 0)), np.zeros(1, np.uint64))
    simulation.set_state(np.arange(1), np.zeros((1, 1)), np.zeros((1, 1)))
    image = RayRenderer(simulation, SIZE).render(None)[0]
    at = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    x, y = np.meshgrid(at, -at)
    radius = np.hypot(x, y) * np.tan(np.deg2rad(22.5))  # of each pixel's ray, at distance 1
    ball = radius < np.tan(np.arcsin(0.5 / 4))
    assert (image[ball] == 255).all()
    floor = ~ball & (y < 0)
    assert (image[floor] == 0).all()
    assert (image[~ball & (y > 0)] > 0).all()


def test_drawing_some_rows_is_drawing_all_and_picking() -> None:
    """A row's image does not depend on which other rows are drawn with it."""
    renderer = RayRenderer(started(HopperPolito()), SIZE)
    every = renderer.render(None)
    np.testing.assert_array_equal(renderer.render(np.array([1, 3])), every[[1, 3]])
    assert (every[0] != every[1]).any()


@pytest.mark.render
@pytest.mark.parametrize("task", [HopperPolito(), Ant()])
def test_rays_and_gl_show_the_robot_at_the_same_place(task: Task) -> None:
    """What moves between two states is the same part of the image in both renderers."""
    simulation = started(task, rows=2, steps=12)
    rays, gl = RayRenderer(simulation, SIZE), GLRenderer(simulation, SIZE, processes=1)
    try:
        masks = []
        for renderer in (rays, gl):
            image = renderer.render(None).astype(int)
            # the robot's colour is a brown: red well above blue; floor and sky are not
            masks.append(image[..., 0] - image[..., 2] > 12)
    finally:
        gl.close()
    overlap = (masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum()
    assert masks[0].sum() > 50
    assert overlap > 0.6


@pytest.mark.render
def test_gl_draws_all_rows_in_several_processes() -> None:
    """How many processes draw changes no pixel; a closed renderer says so."""
    simulation = started(HopperPolito())
    images = []
    for processes in (1, 2):
        renderer = GLRenderer(simulation, SIZE, processes=processes)
        images.append(renderer.render(None))
        renderer.close()
    np.testing.assert_array_equal(images[0], images[1])
    assert images[0].std() > 10
    with pytest.raises(ValueError, match="closed"):
        renderer.render(None)


@pytest.mark.parametrize("kind", ["rays", pytest.param("gl", marks=pytest.mark.render)])
def test_looks_differ_from_row_to_row(kind: str) -> None:
    """Colours, light and camera follow the parameters of each row."""
    effects = (make("colour", where="torso"), make("light_level"), make("camera_shift"))
    simulation = Simulation(HopperPolito(), 4, effects)
    values = simulation.space.points(4)
    values[1, simulation.space.index("colour.torso.red")] = -0.5
    values[2, simulation.space.index("light_level")] = 0.3
    values[3, simulation.space.index("camera_shift.right")] = 0.5
    every = np.arange(4)
    simulation.reset(every, values, np.zeros(4, np.uint64))
    renderer = RayRenderer(simulation, SIZE) if kind == "rays" else GLRenderer(simulation, SIZE)
    plain, red, dark, shifted = renderer.render(None).astype(int)
    renderer.close()
    assert (plain != red).any(-1).sum() > 10
    assert ((plain - red)[..., 1:] == 0).all() and ((plain - red)[..., 0] >= 0).all()
    assert dark[-20:].sum() < 0.6 * plain[-20:].sum()  # the floor
    brown = (plain[..., 0] - plain[..., 2] > 12).nonzero()[1].mean()
    moved = (shifted[..., 0] - shifted[..., 2] > 12).nonzero()[1].mean()
    assert moved < brown - 5


@pytest.mark.parametrize("task", [HopperPolito(), Ant()])
def test_looking_changes_nothing(task: Task) -> None:
    """Rows that are drawn move exactly as rows that nobody looks at."""
    ends = []
    for looked_at in (False, True):
        simulation = started(task)
        renderer = RayRenderer(simulation, 16) if looked_at else None
        rng = np.random.default_rng(1)
        for _ in range(30):
            simulation.step(None, rng.uniform(-1, 1, (4, simulation.action_size)))
            if renderer is not None:
                renderer.render(None)
        ends.append((simulation.plant.qpos.copy(), simulation.plant.qvel.copy()))
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    np.testing.assert_array_equal(ends[0][1], ends[1][1])
