"""Legged robots: what they observe, earn and end by, and that a robot can compute it too."""

import inspect
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from torchrl.envs.utils import check_env_specs

from envs.errors import TaskError
from envs.mujoco import MujocoEnv
from envs.simulation import Simulation
from envs.tasks import Hopper2, Quad8, Quad12, ServoTask
from envs.tasks.base import CommandState

TASKS = [Quad8, Quad12, Hopper2]
Make = Callable[..., ServoTask]


def start(task: ServoTask, rows: int) -> Simulation:
    """Return a simulation whose rows have begun."""
    sim = Simulation(task, rows, threads=1)
    sim.reset(np.arange(rows), sim.space.points(rows), np.arange(rows, dtype=np.uint64))
    return sim


@pytest.mark.parametrize("make", TASKS)
def test_measurements_give_what_the_simulation_gives(make: Make) -> None:
    """All that the robot needs is in angles, speeds, torques, IMU, tracker and commands."""
    task, rng = make("ideal"), np.random.default_rng(0)
    sim = start(task, 4)
    for _ in range(15):
        before = sim.state()
        action = rng.uniform(sim.action_low, sim.action_high, (4, sim.action_size))
        step = sim.step(None, action)
    after = sim.state()
    assert after.command is not None
    free = not isinstance(task, Hopper2)
    qpos = after.qpos
    position = qpos[:, :3] if free else np.column_stack([qpos[:, 0], 0 * qpos[:, 0], qpos[:, 1]])
    position = position + np.array([0, 0, 0.0 if free else 0.1133])
    made = task.state_from_measurement(
        qpos[:, task.q],
        after.qvel[:, task.v],
        after.command,
        orientation=qpos[:, 3:7] if free else None,
        gyro=after.qvel[:, 3:6] if free else None,
        position=position,
        torque=task.torque(after),
    )
    np.testing.assert_allclose(task.observe(made), step.observation, atol=1e-12)
    reward = task.reward(before, made, action, step.terminated)
    np.testing.assert_allclose(reward, step.reward, atol=1e-9)
    np.testing.assert_array_equal(task.terminated(made), step.terminated)


@pytest.mark.parametrize("make", TASKS)
def test_a_state_without_tracking_earns_no_distance(make: Make) -> None:
    """An untracked robot stays where it was: the reward is the price of energy alone."""
    task = make("servo")
    n = len(task.machine.low)
    command = CommandState(np.zeros(1), np.zeros((1, n)), np.zeros((1, n)))
    state = task.state_from_measurement(
        np.zeros((1, n)), np.ones((1, n)), command, torque=np.full((1, n), 0.1)
    )
    reward = task.reward(state, state, np.zeros((1, n)), np.zeros(1, bool))
    np.testing.assert_allclose(reward, -0.005 * 0.1 * n * task.dt)


@pytest.mark.parametrize(("make", "joints"), [(Quad8, 8), (Quad12, 12)])
def test_a_quadruped_sees_its_joints_and_the_phase(make: Make, joints: int) -> None:
    """Roll, pitch, its angles 2.5 ms old, sine and cosine of the phase, in this order."""
    sim = start(make("servo"), 2)
    for _ in range(5):
        step = sim.step(None, np.zeros((2, joints)))
    assert step.observation.shape == (2, joints + 4)
    angles = sim.plant.qpos[:, 7:] - 0.0025 * sim.plant.qvel[:, 6:]
    np.testing.assert_allclose(step.observation[:, 2:-2], angles, atol=1.5e-3)
    phase = 2 * np.pi * 2.0 * 5 * 0.02
    np.testing.assert_allclose(step.observation[:, -2:], [[np.sin(phase), np.cos(phase)]] * 2)


@pytest.mark.parametrize("make", [Quad8, Quad12])
def test_a_quadruped_falls_by_tilting(make: Make) -> None:
    """Past 0.6 rad of roll or pitch it is over, whatever the yaw."""
    task = make()
    quaternions = []
    for roll, pitch, yaw in ((0.0, 0.0, 3.0), (0.59, 0.0, 0.0), (0.61, 0.0, 0.0), (0, -0.61, 0)):
        r, p, y = np.array([roll, pitch, yaw]) / 2
        quaternions.append(
            [
                np.cos(r) * np.cos(p) * np.cos(y) + np.sin(r) * np.sin(p) * np.sin(y),
                np.sin(r) * np.cos(p) * np.cos(y) - np.cos(r) * np.sin(p) * np.sin(y),
                np.cos(r) * np.sin(p) * np.cos(y) + np.sin(r) * np.cos(p) * np.sin(y),
                np.cos(r) * np.cos(p) * np.sin(y) - np.sin(r) * np.sin(p) * np.cos(y),
            ]
        )
    still = np.zeros((4, len(task.q)))
    command = CommandState(np.zeros(4), still, still)
    state = task.state_from_measurement(still, still, command, orientation=np.array(quaternions))
    np.testing.assert_array_equal(task.terminated(state), [False, False, True, True])


def test_speed_beyond_the_cap_is_not_paid() -> None:
    """A robot twice as fast as the cap earns what one at the cap earns."""
    for task in (Quad8(), Quad12(), Hopper2()):
        n = len(task.machine.low)
        still, command = (
            np.zeros((2, n)),
            CommandState(np.zeros(2), np.zeros((2, n)), np.zeros((2, n))),
        )
        way = np.array([[1.0, 0, 0.2], [2.0, 0, 0.2]]) * task.fastest * task.dt
        before = task.state_from_measurement(still, still, command, position=0 * way)
        after = task.state_from_measurement(still, still, command, position=way)
        reward = task.reward(before, after, still, np.zeros(2, bool))
        np.testing.assert_allclose(reward, task.fastest * task.dt)


def test_height_is_paid_above_a_straight_leg() -> None:
    """Standing on a straight leg earns nothing, 10 mm higher a tenth a second."""
    task = Hopper2(goal="height")
    still = np.zeros((3, 2))
    command = CommandState(np.zeros(3), still, still)
    heights = np.array([[0, 0, 0.1], [0, 0, 0.128], [0, 0, 0.138]])
    state = task.state_from_measurement(still, still, command, position=heights)
    reward = task.reward(state, state, still, np.zeros(3, bool))
    np.testing.assert_allclose(reward, [0, 0, 0.1 * task.dt], atol=1e-12)


@pytest.mark.parametrize("fidelity", ["ideal", "servo"])
@pytest.mark.parametrize("make", TASKS)
def test_an_episode_starts_at_rest(make: Make, fidelity: str) -> None:
    """Robots that hold the pose at home stay where their episodes start, sagged as they are."""
    task = make(fidelity)
    model = task.spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = task.start, task.rest(model)
    mujoco.mj_step(model, data, 500)
    np.testing.assert_allclose(data.qpos[task.q], task.start[task.q], atol=5e-3)
    sag = np.abs(task.start[task.q] - model.key("home").qpos[task.q]).max()
    assert (sag > 0.015) == (fidelity == "servo")


@pytest.mark.parametrize("make", TASKS)
def test_a_task_keeps_what_it_was_made_of(make: Make) -> None:
    """Another of the same arguments, but one, can be made of a task: a variant of its robot."""
    task = make("ideal", seconds=1.0)
    arguments = {name: getattr(task, name) for name in inspect.signature(make).parameters}
    other = make(**{**arguments, "fidelity": "servo"})
    assert (other.fidelity, other.max_steps) == ("servo", task.max_steps)


def test_a_wrong_goal_is_refused() -> None:
    """The nearest goal is named."""
    with pytest.raises(TaskError, match="distance"):
        Hopper2(goal="distanc")  # type: ignore[arg-type]


@pytest.mark.parametrize("make", TASKS)
def test_it_is_a_torchrl_environment(make: Make) -> None:
    """TorchRL's own check of specs passes."""
    check_env_specs(MujocoEnv(make("servo"), 3))


@pytest.mark.parametrize("make", TASKS)
def test_an_episode_depends_on_its_seed_alone(make: Make) -> None:
    """A row gives the same rewards alone and among others, whatever came before in it."""
    rng = np.random.default_rng(2)
    many, one = start(make("servo"), 3), start(make("servo"), 1)
    actions = rng.uniform(-0.3, 0.3, (20, many.action_size))
    for _ in range(7):
        many.step(None, rng.uniform(-0.3, 0.3, (3, many.action_size)))
    seed, row = np.array([9], np.uint64), np.array([1])
    a = many.reset(row, many.space.points(1), seed)
    b = one.reset(np.arange(1), one.space.points(1), seed)
    np.testing.assert_array_equal(a, b)
    for action in actions:
        x, y = many.step(row, action[None]), one.step(None, action[None])
        np.testing.assert_array_equal(x.observation, y.observation)
        np.testing.assert_array_equal(x.reward, y.reward)
